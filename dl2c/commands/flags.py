"""The options of an environment as command-line flags, made from their records."""

import inspect
from collections.abc import Callable
from functools import cache, wraps
from typing import Annotated, Any

import typer

from dl2c.commands.completion import words
from dl2c.commands.verbosity import FLAGS, with_parameters
from dl2c.options import OPTIONS, Option, UnknownOption, current, deprecation
from dl2c.progress import LOG

Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]


def model_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command a flag for every option; it receives those given as the mapping `options`.

    Gives it those of verbosity.py too.
    """
    flagged, flags = _flags()
    own = [p for p in inspect.signature(command).parameters.values() if p.name != "options"]
    settable = _parameter("set_", list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=_SET))

    @wraps(command)
    def run(**arguments: Any) -> None:
        given = {o.name: value for o in flagged if (value := arguments.pop(o.name)) is not None}
        options = {name: _current(name, value) for name, value in given.items()}
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
    return current(name, value)


_SET = "Fix a constant of the model. May be repeated."


@cache
def _flags() -> tuple[tuple[Option, ...], tuple[inspect.Parameter, ...]]:
    """The options that have flags of their own, and these."""
    flagged = tuple(option for option in OPTIONS.values() if option.kind != "constants")
    return flagged, tuple(map(_flag, flagged))


def _flag(option: Option) -> inspect.Parameter:
    """The flag of one option; numbers stay text, so that decimals are read exactly."""
    match option.kind:
        case "boolean":
            both = f"{option.flag}/--no-{option.flag.removeprefix('--')}"
            return _parameter(option.name, bool | None, typer.Option(both, help=option.help))
        case "integer":
            return _parameter(option.name, int | None, typer.Option(option.flag, help=option.help))
        case "word":
            complete = words(*option.words)
            metavar = "|".join(option.words)
            listed = typer.Option(option.flag, metavar=metavar, help=option.help, autocompletion=complete)
            return _parameter(option.name, str | None, listed)
        case _:
            return _parameter(option.name, str | None, typer.Option(option.flag, help=option.help))


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
