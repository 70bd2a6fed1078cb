"""The commands that measure the product, added to those of `dl2c.cli`: bench, paper, study, demo."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from dl2c.cli import app, main
from dl2c.commands.arguments import Model
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json, model_options
from dl2c.commands.verbosity import talkative
from dl2c.commands.waiting import working
from dl2c.experiments.paper.command import paper
from dl2c.experiments.studies.command import study

__all__ = ["app", "main"]


@app.command()
@model_options
def bench(
    model: Model,
    seconds: Annotated[float, typer.Option(min=0.01, help="CPU seconds to measure for, in all.")] = 20.0,
    require: Annotated[
        list[str] | None,
        typer.Option(metavar="ROW[/ROW]=RATIO", help="Exit with 1 if a row is slower than this."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the table, and how speed grows.")
    ] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Measure the search for proofs about a policy instead.")
    ] = False,
    policy: Annotated[
        Path | None,
        typer.Option(metavar="FILE|DIR", help="With --verify: this policy, not random numbers."),
    ] = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Compare the speed of a model in C with scipy's solve_ivp and others, as ratios."""
    from dl2c.experiments.bench import command

    if policy is not None and not verify:
        raise CommandError("--policy goes with --verify")
    with working(f"measuring {model}") as note:
        if verify:
            found = command.compare_boxes(model, policy, options, seconds, require or ())
        else:
            found = command.compare(model, options, seconds, require or (), note, plot is not None)
    print(to_json(command.comparison_data(found))) if json else command.show_comparison(found)
    if plot is not None:
        command.draw_comparison(found, plot)
    if not all(map(found.met, found.requirements)):
        raise typer.Exit(1)


app.command()(talkative(paper))
app.command()(study)


@app.command()
@talkative
def demo() -> None:
    """Train on the waypoint example and compare with policies that do not learn (some minutes)."""
    from dl2c.experiments.demo import main as run

    run()
