"""`dl2c report`: one page about a training."""

from pathlib import Path
from typing import Annotated

import typer

from dl2c.commands.arguments import Film
from dl2c.commands.completion import models
from dl2c.commands.failures import CommandError
from dl2c.commands.verbosity import talkative
from dl2c.commands.waiting import working
from dl2c.outputs import write_output


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
) -> None:
    """Write one HTML page that needs nothing else: curves, episodes, tables, the model, versions, seeds.

    With --film also a film of the trained policy's first episode.
    """
    from dl2c.report.film import check_film, write_film
    from dl2c.report.page import first_episode
    from dl2c.report.page import report as write
    from dl2c.report.trained import RunError, read_trained

    if film is not None:
        check_film(film)
    try:
        trained = read_trained(run, model)
    except RunError as problem:
        raise CommandError(str(problem)) from None
    path = output or run / "report.html"
    with working(f"looking at {run}"):
        text = write(trained, episodes)
    write_output(path, text)
    print(path)
    if film is not None:
        with working(f"making {film}"):
            write_film(first_episode(trained), film)
        print(film)
