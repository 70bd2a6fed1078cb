"""The options of an environment as command-line flags, made once from `Options`."""

import inspect
from collections.abc import Callable
from dataclasses import Field, fields
from functools import wraps
from typing import Annotated, Any, get_args

import typer

from dl2c.commands.completion import words
from dl2c.commands.verbosity import FLAGS, with_parameters
from dl2c.options import DEPRECATED, Options, UnknownOption, deprecation
from dl2c.progress import LOG

Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]

HELP = {
    "entry": "Entry of a KeYmaera X archive that holds several, by name or number.",
    "loop": "Which of several top-level loops is the episode's, counted from 1.",
    "default_bound": "LO:HI, limits of names that neither a bound nor the precondition limits.",
    "dt": "Longest time of a continuous evolution, in seconds.",
    "max_flow": "Seconds in which its domain may end a flow without a clock, in a problem without a loop.",
    "duration": "Flows last as long as they may, a random part of that, or one the agent chooses.",
    "safety_check": "Watch safety along the last motion of a step, after steps only, or along all motion.",
    "initial_distribution": "How initial states are drawn: uniformly, or near random targets, in C or by Z3.",
    "integrator": "How a differential equation is solved.",
    "stiff": "Solve with the method for stiff equations; auto: as the model suggests.",
    "rtol": "Relative tolerance of CVODES and dopri5.",
    "atol": "Absolute tolerance of CVODES and dopri5.",
    "tolerance": "Relative tolerance of annotated predicates.",
    "progress_failure": "When a progress predicate with on_failure fails.",
    "observe_constants": "Observe the sampled constants too.",
    "obs_dtype": "Type of observations and continuous actions.",
    "observation_bounds": "Limits of the observation space.",
    "action_format": "How decisions become an action space.",
    "action_map": "How continuous actions meet their admissible set.",
    "on_blocked": "What happens to a step whose requested run blocks.",
    "mask_depth": "Masks look up to the first motion of a step, or follow alternatives to its end.",
    "blocked_penalty": "Added to the reward of such a step.",
    "max_episode_steps": "Truncate episodes after so many steps; 0: never.",
    "stall_limit": "Truncate after so many zero-duration steps in a row; 0: never.",
    "monitor_every_step": "Judge every step by the exported monitor; a violation is an error.",
    "max_loop": "Iterations of while loops in one step after which it counts as diverged.",
    "max_repeat": "How often other loops inside a step may be repeated.",
    "native": "Tune for this machine's CPU.",
    "sundials": "Which SUNDIALS solves flows: that of casadi, or an installed one.",
}


UNFLAGGED = ("constants", "given")
"""`--set` gives constants; `given` is bookkeeping."""


def model_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command a flag for every option; it receives those given as the mapping `options`.

    Gives it those of verbosity.py too.
    """
    given_names = [f.name for f in fields(Options) if f.name not in UNFLAGGED]
    own = [p for p in inspect.signature(command).parameters.values() if p.name != "options"]
    flags = [_flag(f) for f in fields(Options) if f.name in given_names]
    settable = _parameter("set_", list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=_SET))

    @wraps(command)
    def run(**arguments: Any) -> None:
        options = {name: value for name in given_names if (value := arguments.pop(name)) is not None}
        options = {name: _current(name, value) for name, value in options.items()}
        if constants := arguments.pop("set_"):
            options["constants"] = dict(map(_constant, constants))
        for flag in FLAGS:
            arguments.pop(flag.name)
        command(**arguments, options=options)

    return with_parameters(run, (*own, *FLAGS, settable, *flags))


def _current(name: str, value: Any) -> Any:
    """A value under its present name; the use of an old one is said on stderr."""
    if old := deprecation(name, value):
        LOG.warning("warning: %s", old)
        return DEPRECATED[name, value]
    return value


_SET = "Fix a constant of the model. May be repeated."


def _flag(option: "Field[Any]") -> inspect.Parameter:
    """The flag of one option; numbers stay text, so that decimals are read exactly."""
    name = f"--{option.name.replace('_', '-')}"
    text = HELP.get(option.name, "")
    match option.name:
        case "observe_constants" | "monitor_every_step" | "native":
            both = f"{name}/--no-{name.removeprefix('--')}"
            return _parameter(option.name, bool | None, typer.Option(both, help=text))
        case "max_episode_steps" | "stall_limit" | "max_loop" | "max_repeat" | "loop":
            return _parameter(option.name, int | None, typer.Option(name, help=text))
        case _:
            known = get_args(option.type)
            if not (known and all(isinstance(w, str) for w in known)):
                return _parameter(option.name, str | None, typer.Option(name, help=text))
            listed = typer.Option(name, metavar="|".join(known), help=text, autocompletion=words(*known))
            return _parameter(option.name, str | None, listed)


def _parameter(name: str, kind: Any, option: Any) -> inspect.Parameter:
    option.rich_help_panel = "Environment"
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind, option]
    )


def _constant(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise UnknownOption(f"--set takes NAME=VALUE, not {text!r}")
    return name.strip(), value.strip()
