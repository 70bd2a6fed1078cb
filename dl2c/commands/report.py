"""`dl2c report`: one page about a training."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer

from dl2c.commands.arguments import Film, check_film
from dl2c.commands.completion import models
from dl2c.commands.failures import CommandError
from dl2c.commands.verbosity import talkative
from dl2c.commands.waiting import working
from dl2c.outputs import write_output

if TYPE_CHECKING:
    from dl2c.report.episode import Episode
    from dl2c.report.trained import Trained


@talkative
def report(
    run: Annotated[Path, typer.Argument(help="A folder that `dl2c train` wrote.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="HTML", help="Default: report.html in the folder."),
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="The model, where the folder does not hold it.", autocompletion=models)
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each evaluation.")] = 200,
    film: Film = None,
    play: Annotated[
        Path | None,
        typer.Option(metavar="HTML", help="A page in which one drives by hand, or lets the policy drive."),
    ] = None,
) -> None:
    """Write one HTML page that needs nothing else: curves, episodes, tables, the model, versions, seeds.

    With --film also a film of the trained policy's first episode, with --play also a page of `dl2c play`; the
    report links both.
    """
    from dl2c.report.trained import RunError, read_trained

    check_film(film)
    if play is not None:
        from dl2c.play.wasm import require_zig

        require_zig()
    try:
        trained = read_trained(run, model)
    except RunError as problem:
        raise CommandError(str(problem)) from None
    from dl2c.report import page

    path = output or run / "report.html"
    beside = {"A film of the first episode": film, "A page in which the model is driven": play}
    with working(f"looking at {run}"):
        measured = page.measure(trained, episodes)
        write_output(path, page.report(trained, measured, _links(path, beside)))
    print(path)
    if film is not None:
        _write_film(measured.seen[:1], film)
    if play is not None:
        _write_page(trained, play)


def _links(page: Path, beside: Mapping[str, Path | None]) -> dict[str, str]:
    """What stands beside a page, by addresses from there."""
    folder = page.absolute().parent
    places = {title: os.path.relpath(path.absolute(), folder) for title, path in beside.items() if path}
    return {title: quote(Path(place).as_posix()) for title, place in places.items()}


def _write_film(episodes: "list[Episode]", path: Path) -> None:
    from dl2c.report.film import write_film

    with working(f"making {path}"):
        write_film(episodes, path)
    print(path)


def _write_page(trained: "Trained", path: Path) -> None:
    from dl2c.commands.policy import policy_for
    from dl2c.play.build import playable
    from dl2c.play.page import page_of

    with working(f"making {path}") as note:
        policy, options = policy_for(trained.source, trained.folder, trained.options, trusted=True)
        write_output(path, page_of(playable(trained.source, options, policy, note)))
    print(path)
