"""`dl2c falsify`: look for a violation of a model, make it small, write it for `dl2c replay`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from dl2c.commands.arguments import Model
from dl2c.commands.completion import words
from dl2c.commands.failures import CommandError, as_data, to_json
from dl2c.commands.flags import Json
from dl2c.commands.waiting import counting
from dl2c.diagnostics import render

if TYPE_CHECKING:
    from dl2c.report.episode import Episode
    from dl2c.report.falsify import Falsified

Output = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="JSON", help="File for it. Default: build/counterexamples/MODEL.json."
    ),
]
What = Annotated[
    str,
    typer.Option(
        metavar="safety|failure|postcondition",
        help="What to look for: a @safety predicate that fails, an episode that ends in failure, "
        "a false postcondition.",
        autocompletion=words("safety", "failure", "postcondition"),
    ),
]


def falsify(
    model: Model,
    target: What = "safety",
    episodes: Annotated[int, typer.Option(min=1, help="How many episodes to try.")] = 10_000,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each, at most.")] = 200,
    n_envs: Annotated[int, typer.Option(min=1, help="Environments stepped together.")] = 250,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search.")] = 0,
    output: Output = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Look for a violation among initial states and actions.

    Exit code 0: nothing found, which proves nothing. Exit code 1: found, and written to a file.
    """
    from dl2c.report.falsify import NothingToFalsify
    from dl2c.report.falsify import falsify as search
    from dl2c.report.search import Target

    if target not in get_args(Target):
        raise CommandError(f"no target {target!r}; there is {', '.join(get_args(Target))}")
    size: dict[str, Any] = {"episodes": episodes, "steps": steps, "n_envs": n_envs}
    kind: Any = target
    try:
        with counting(episodes, "episodes") as note:
            found = search(model, target=kind, seed=seed, note=note, **size, **options)
    except NothingToFalsify as problem:
        raise CommandError(str(problem)) from None
    if found.episode is not None:
        _found(found, found.episode, output, json)
        raise typer.Exit(1)
    nothing = f"nothing found in {found.episodes} episodes, which proves nothing"
    print(to_json({"found": False, "episodes": found.episodes}) if json else nothing)


def _found(found: "Falsified", episode: "Episode", output: Path | None, json: bool) -> None:
    """Write a counterexample and say what it violates."""
    from dl2c.emit.names import file_stem
    from dl2c.report.episode import write_episode

    path = output or Path("build/counterexamples", f"{file_stem(Path(episode.source.name).stem)}.json")
    write_episode(episode, path)
    steps = len(episode.moments)
    if json:
        told = {"found": True, "episodes": found.episodes, "steps": steps, "file": str(path)}
        print(to_json(told | {"conditions": as_data(found.conditions), "worst": as_data(found.worst)}))
        return
    for condition in found.conditions:
        print(render(condition), end="\n\n")
    print(f"found within {found.episodes} episodes: steps {steps}, before it was made small {found.steps};")
    if found.worst:
        print(f"the worst one found, at the end of its step: {'; '.join(d.label for d in found.worst)};")
    print(f"replay it with `dl2c replay {path}`")
