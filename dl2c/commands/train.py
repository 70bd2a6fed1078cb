"""`dl2c train`: train a policy and evaluate it."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dl2c.commands.arguments import Model, Seed
from dl2c.commands.completion import words
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json
from dl2c.commands.waiting import progress

if TYPE_CHECKING:
    from dl2c.training.evaluation import Evaluation

Algorithm = Annotated[
    str, typer.Option(help="ppo or maskable-ppo.", autocompletion=words("ppo", "maskable-ppo"))
]


def train(
    model: Model,
    algo: Algorithm = "ppo",
    steps: Annotated[int, typer.Option(min=1, help="Environment steps.")] = 400_000,
    n_envs: Annotated[int, typer.Option(min=1, help="Environments stepped together.")] = 64,
    seed: Seed = 0,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")] = Path(
        "build/train"
    ),
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Train a policy; writes policy.zip, run.json and curve.png and evaluates the result."""
    from dl2c.training.evaluation import evaluate
    from dl2c.training.plots import plot_curves
    from dl2c.training.ppo import train as learn
    from dl2c.training.run import Settings

    if algo not in ("ppo", "maskable-ppo"):
        raise CommandError(f"no algorithm {algo!r}; there is ppo, maskable-ppo")
    settings = Settings(steps=steps, n_envs=n_envs)
    with progress(steps) as note:
        run = learn(model, algo, seed=seed, directory=output, settings=settings, progress=note, **options)
    plot_curves({algo: [run.curve]}, output / "curve.png")
    found = evaluate(run.policy, model, masked=algo == "maskable-ppo", **options)
    print(
        to_json({"policy": str(run.policy)} | asdict(found)) if json else f"{run.policy}: {_sentence(found)}"
    )


def _sentence(found: "Evaluation") -> str:
    def percent(name: str) -> str:
        e = asdict(found)[name]
        return f"{e['value']:.1%} [{e['low']:.1%}, {e['high']:.1%}]"

    text = f"{found.episodes} episodes: success {percent('success')}, violations {percent('violations')}"
    if math.isnan(found.travel_time.value):
        return text
    return f"{text}, mean duration of successes {found.travel_time.value:.3g} s"
