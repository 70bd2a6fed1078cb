"""`dl2c train`: train a policy and evaluate it."""

import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dl2c.commands.completion import models, words
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet
from dl2c.commands.waiting import progress, working
from dl2c.training.run import ALGORITHMS, Algorithm, Run, Settings
from dl2c.work import require_memory_for_torch

if TYPE_CHECKING:
    from dl2c.training.provable import Taught, Verify
    from dl2c.training.run import Evaluation

OUTPUT = Path("build/train")
TRAINING = 1024**3
"""Bytes of address space that PyTorch takes with the smallest of trainings."""

Model = Annotated[
    str | None,
    typer.Argument(
        help="A .kyx file, or example:NAME; needed unless the configuration names one.",
        show_default=False,
        autocompletion=models,
    ),
]
Algo = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(ALGORITHMS), help="How to learn; default ppo.", autocompletion=words(*ALGORITHMS)
    ),
]
Config = Annotated[
    Path | None, typer.Option(metavar="YAML", help="File with these settings; flags win over it.")
]
Hyper = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE", help="Hyperparameter of Stable-Baselines3, or net_arch. May be repeated."
    ),
]
Resume = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Go on with this training or checkpoint.")
]


Steps = Annotated[int | None, typer.Option(min=1, help="Environment steps, in all.")]
Environments = Annotated[int | None, typer.Option(min=1, help="Environments stepped together.")]
Seed = Annotated[int | None, typer.Option(min=0, help="The same seed gives the same policy; default 0.")]
Normalize = Annotated[
    bool | None,
    typer.Option("--normalize/--no-normalize", help="Normalise observations with VecNormalize."),
]
EvalEvery = Annotated[int | None, typer.Option(min=0, help="Steps between evaluations; 0: none.")]
EvalEpisodes = Annotated[int | None, typer.Option(min=1, help="Episodes of each evaluation.")]
CheckpointEvery = Annotated[int | None, typer.Option(min=0, help="Steps between checkpoints; 0: none.")]
TensorBoard = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Log for TensorBoard, if that is installed.")
]
Provable = Annotated[
    bool,
    typer.Option(
        "--provable",
        help="Then teach the policy until `verify --policy` proves it, with proof.json and certificate.json. "
        "Exit code 3 where that does not succeed.",
    ),
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help=f"Folder for the results; default {OUTPUT}.")
]


@dataclass(frozen=True, slots=True)
class Wanted:
    """A training as configuration and flags ask for it together."""

    model: str
    algo: Algorithm
    seed: int
    output: Path
    settings: Settings
    options: Mapping[str, Any]
    resume: Path | None
    tensorboard: Path | None


def train(
    model: Model = None,
    algo: Algo = None,
    config: Config = None,
    steps: Steps = None,
    n_envs: Environments = None,
    seed: Seed = None,
    hyper: Hyper = None,
    normalize: Normalize = None,
    eval_every: EvalEvery = None,
    eval_episodes: EvalEpisodes = None,
    checkpoint_every: CheckpointEvery = None,
    resume: Resume = None,
    tensorboard: TensorBoard = None,
    provable: Provable = False,
    output: Output = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Train a policy; writes it with run.json and curve.png to a folder, and evaluates the result.

    Ctrl-C ends the training early and keeps what there is.
    """
    given = {
        "model": model,
        "algo": algo,
        "steps": steps,
        "n_envs": n_envs,
        "seed": seed,
        "output": output,
        "normalize": normalize,
        "eval_every": eval_every,
        "eval_episodes": eval_episodes,
        "checkpoint_every": checkpoint_every,
        "tensorboard": tensorboard,
    }
    wanted = _wanted({k: v for k, v in given.items() if v is not None}, hyper or [], config, resume, options)
    if provable:
        raise typer.Exit(_provable(wanted, json))
    _present(wanted, _trained(wanted), json)


# Policies that are proved --------------------------------------------------------------------------

SMALL = {"net_arch": [32, 32], "activation": "relu"}
"""Networks that are quickly proved, and of relu, for which certificates can be checked. With these PPO learns
less in large steps, so that they are trained with `CAREFUL` and as many environments as belong to it.
"""


def _provable(wanted: Wanted, json: bool) -> int:
    """Train a policy and teach it until it is proved; the exit code."""
    from dl2c.commands.policy import Asked, blank, verifier
    from dl2c.commands.verify import UNDECIDED, show_policy
    from dl2c.training.hyper import CAREFUL, CAREFUL_ENVS, complete

    if wanted.algo != "ppo" or wanted.settings.normalize:
        raise CommandError("--provable is for ppo without --normalize")
    given = wanted.settings
    hyper = CAREFUL | SMALL | dict(given.hyper)
    wanted = replace(wanted, settings=replace(given, n_envs=given.n_envs or CAREFUL_ENVS, hyper=hyper))
    chosen = complete(wanted.algo, wanted.settings).hyper
    network = partial(blank, hidden=chosen["net_arch"], activation=chosen["activation"])
    verify = verifier(wanted.model, Asked(wanted.output), wanted.options, network)
    run = _trained(wanted)
    if run.interrupted:
        _present(wanted, run, json)
        return UNDECIDED
    found = _taught(wanted, verify)
    _present(wanted, run, json, {"proof": found.to_json()})
    if not json and not quiet():
        show_policy(found.report)
    return 0 if found.report.answer == "proved" else UNDECIDED


def _taught(wanted: Wanted, verify: "Verify") -> "Taught":
    """Teach the policy in the folder of a training, and write it back with its proof."""
    from dl2c.env.opening import compilation_of, source_of
    from dl2c.env.sb3 import Dl2cVecEnv
    from dl2c.ir.liveness import overwritten
    from dl2c.training.provable import ENVIRONMENTS, teach_saved

    model = compilation_of(wanted.model, wanted.options).unbounded
    idle = [v.name for v in model.variables if overwritten(model.body, v.name, model.flows)]
    env = Dl2cVecEnv(source_of(wanted.model), ENVIRONMENTS, **wanted.options)
    with working("teaching the policy") as note:
        found = teach_saved(wanted.output, env, verify, note, wanted.seed, idle)
    env.close()
    return found


# Plain trainings -----------------------------------------------------------------------------------


def _wanted(
    flags: dict[str, Any],
    hyper: list[str],
    config: Path | None,
    resume: Path | None,
    options: Mapping[str, Any],
) -> Wanted:
    """Flags over the configuration over the training that is resumed."""
    from dl2c.training.configured import read_configuration
    from dl2c.training.hyper import parsed

    asked = ({} if config is None else read_configuration(config)) | flags
    asked["hyper"] = asked.get("hyper", {}) | parsed(hyper)
    asked["options"] = asked.get("options", {}) | dict(options)
    settings = Settings()
    if resume is not None:
        asked, settings = _resumed(asked, resume)
    algo = asked.get("algo", "ppo")
    if algo not in ALGORITHMS:
        raise CommandError(f"no algorithm {algo!r}; there is {', '.join(ALGORITHMS)}")
    if "model" not in asked:
        raise CommandError("name a model: a .kyx file, or example:NAME")
    names = ("steps", "n_envs", "normalize", "checkpoint_every", "threads")
    names += ("eval_every", "eval_episodes", "eval_options")
    changes = {name: asked[name] for name in names if name in asked}
    return Wanted(
        model=asked["model"],
        algo=algo,
        seed=asked.get("seed", 0),
        output=Path(asked.get("output", resume or OUTPUT)),
        settings=replace(settings, hyper=asked["hyper"], **changes),
        options=asked["options"],
        resume=resume,
        tensorboard=Path(asked["tensorboard"]) if "tensorboard" in asked else None,
    )


def _resumed(asked: dict[str, Any], folder: Path) -> tuple[dict[str, Any], Settings]:
    """What a training that goes on keeps: all but its length, and what is written how often."""
    from dl2c.training.folders import read_run

    earlier = read_run(folder).given
    kept = {"algo": earlier.algo, "seed": earlier.seed, "hyper": dict(earlier.settings.hyper)}
    kept |= {"n_envs": earlier.settings.n_envs, "normalize": earlier.settings.normalize}
    changed = [k for k in kept if asked.get(k, kept[k]) not in (kept[k], {})]
    if changed:
        raise CommandError(f"a training goes on with its own {', '.join(changed)}; leave that out")
    return asked | kept | {"options": dict(earlier.options) | asked["options"]}, earlier.settings


def _trained(wanted: Wanted) -> Run:
    require_memory_for_torch(TRAINING)
    from dl2c.training.hyper import complete
    from dl2c.training.learning import train as learn

    settings = complete(wanted.algo, wanted.settings)
    with progress(settings.steps or 0) as note:
        return learn(
            wanted.model,
            wanted.algo,
            seed=wanted.seed,
            directory=wanted.output,
            settings=settings,
            progress=note,
            resume=wanted.resume,
            tensorboard=wanted.tensorboard,
            **wanted.options,
        )


def _present(wanted: Wanted, run: Run, json: bool, more: Mapping[str, Any] = MappingProxyType({})) -> None:
    from dl2c.training.evaluation import evaluate
    from dl2c.training.plots import plot_curves

    plot_curves({wanted.algo: [run.curve]}, wanted.output / "curve.png")
    masked = wanted.algo == "maskable-ppo"
    options = {**wanted.options, **wanted.settings.eval_options}
    found = evaluate(wanted.output, wanted.model, masked=masked, **options)
    random = evaluate("random", wanted.model, masked=masked, **options)
    steps = run.curve[-1].steps if run.curve else 0
    if run.interrupted and not quiet():
        print(f"stopped after {steps} steps; --resume {wanted.output} goes on", file=sys.stderr)
    if json:
        data = {"policy": str(run.policy), "interrupted": run.interrupted, "steps": steps}
        print(to_json(data | asdict(found) | {"random": asdict(random)} | dict(more)))
        return
    print(f"{run.policy}: {_length(wanted, run, steps)}, then {found.episodes} episodes")
    for line in _table({"random": random, "trained": found}):
        print(line)


def _length(wanted: Wanted, run: Run, steps: int) -> str:
    """How long the training was, and why not as long as was asked for."""
    from dl2c.training.hyper import complete

    settings = complete(wanted.algo, wanted.settings)
    text = f"{steps:,} steps in {run.seconds:.0f} s"
    if run.interrupted or steps == settings.steps or wanted.algo == "sac":
        return text
    return f"{text} ({settings.hyper['n_steps'] * (settings.n_envs or 1):,} at a time)"


def _table(rows: "Mapping[str, Evaluation]") -> list[str]:
    """What policies achieved, with 95 % intervals, in aligned columns."""
    lines: list[tuple[str, ...]] = [
        ("policy", "success", "violations", "blocked", "return", "time to success / s")
    ]
    for name, found in rows.items():
        rates = (e.shown(".1%") for e in (found.success, found.violations, found.blocked))
        means = (e.shown(".4g") for e in (found.episode_return, found.travel_time))
        lines.append((name, *rates, *means))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines]
