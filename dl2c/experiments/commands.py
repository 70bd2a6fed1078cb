"""The commands that measure the product, added to those of `dl2c.cli`: bench, paper, study, demo."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from dl2c.cli import app, main
from dl2c.commands.arguments import Model
from dl2c.commands.failures import to_json
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
    seconds: Annotated[float, typer.Option(min=0, help="CPU seconds to measure for, in all.")] = 20.0,
    require: Annotated[
        list[str] | None,
        typer.Option(metavar="ROW[/ROW]=RATIO", help="Exit with 1 if a row is slower than this."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the table, and how speed grows.")
    ] = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Compare the speed of a model in C with scipy's solve_ivp and others, as ratios."""
    from dl2c.experiments.bench.command import compare, comparison_data, draw_comparison, show_comparison

    with working(f"measuring {model}") as note:
        comparison = compare(model, options, seconds, require or (), note, plot is not None)
    print(to_json(comparison_data(comparison))) if json else show_comparison(comparison)
    if plot is not None:
        draw_comparison(comparison, plot)
    if not all(map(comparison.met, comparison.requirements)):
        raise typer.Exit(1)


app.command()(talkative(paper))
app.command()(study)


@app.command()
@talkative
def demo() -> None:
    """Train on the waypoint example and compare with policies that do not learn (some minutes)."""
    from dl2c.experiments.demo import main as run

    run()
