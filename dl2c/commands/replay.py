"""`dl2c replay`: a recorded episode once more, bit for bit, and what it violates."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dl2c.commands.arguments import Film, check_film
from dl2c.commands.completion import models
from dl2c.commands.failures import CommandError, as_data, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet, talkative
from dl2c.commands.waiting import working
from dl2c.diagnostics import render
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.report.episode import Episode

Other = Annotated[
    str | None,
    typer.Option("--model", help="Replay on this model instead of the recorded text.", autocompletion=models),
]


@talkative
def replay(
    file: Annotated[Path, typer.Argument(help="What `dl2c falsify` or `dl2c rollout` wrote.")],
    model: Other = None,
    plot: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the episode.")] = None,
    film: Film = None,
    json: Json = False,
) -> None:
    """Replay a recorded episode, say whether every state is the same to the last bit, and what it violates.

    One from a page whose model calls functions such as sin is checked step by step, within 1e-12. Exit code
    0: the same. Exit code 1: it differs, as it may with another model.
    """
    from dl2c.env.opening import source_of
    from dl2c.native.errors import ResetFailed
    from dl2c.report import episode as episodes
    from dl2c.report.blame import blamed, model_of

    check_film(film)
    try:
        recorded = episodes.read_episode(file)
        with working(f"replaying {file}"):
            found = episodes.replay(recorded, None if model is None else source_of(model))
    except (episodes.EpisodeError, ValueError, TypeError, ResetFailed) as problem:
        raise CommandError(f"{problem}" if str(file) in str(problem) else f"{file}: {problem}") from None
    different, steps = episodes.difference(recorded, found), False
    if different and model is None:
        different, steps = _by_steps(recorded, different)
    conditions = blamed(found, model_of(found))
    changed = _changed(recorded, found)
    _draw(found, plot, film)
    if json:
        told = {"steps": len(found.moments), "status": found.status, "reason": found.reason}
        told |= {"difference": different, "step_by_step": steps, "model": changed}
        told |= {"conditions": as_data(conditions)}
        print(to_json(told))
    else:
        for condition in conditions:
            print(render(condition), end="\n\n")
        if changed and not quiet():
            print(changed)
        print(_summary(found, different, steps))
    if different:
        raise typer.Exit(1)


def _by_steps(recorded: "Episode", different: str) -> tuple[str, bool]:
    """The difference of an episode whose bits differ; and whether it was checked step by step instead."""
    from dl2c.report.stepwise import is_inexact, stepwise_difference

    return (stepwise_difference(recorded), True) if is_inexact(recorded) else (different, False)


def _summary(found: "Episode", different: str, steps: bool) -> str:
    end = f"{found.status}: {found.reason}" if found.reason else "not ended"
    same = "every state is as recorded, bit for bit"
    if steps:
        same = (
            "each step is as recorded, within 1e-12 from the state before it (sin and the like differ here)"
        )
    return f"{len(found.moments)} steps, {end}; {different or same}"


def _changed(recorded: "Episode", found: "Episode") -> str:
    """What to know about the model: whether it is the recorded one, and whether its file still is."""
    name, text = recorded.source.name, recorded.source.text
    if found.source.text != text:
        return f"{found.source.name} is another model than the recorded text of {name}"
    try:
        same = not Path(name).is_file() or Source.read(name).text == text
    except OSError:
        same = True
    return "" if same else f"{name} has changed since: `--model {name}` replays the episode on what it is now"


def _draw(found: "Episode", plot: Path | None, film: Path | None) -> None:
    if plot is not None:
        from dl2c.report.pictures import draw_episode

        draw_episode(found, plot)
    if film is not None:
        from dl2c.report.film import write_film

        with working(f"making {film}"):
            write_film([found], film)
