"""`dl2c paper`: the evaluation of the paper "Gymnasium dL"."""

from pathlib import Path
from typing import Annotated

import typer

from dl2c.commands.failures import to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet
from dl2c.outputs import write_output


def paper(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for table and figures.")] = Path(
        "build/paper"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Train hardly at all, and ask for no success of what is learned.")
    ] = False,
    json: Json = False,
) -> None:
    """Reproduce the paper's evaluation; exits with 1 if a criterion is missed (some minutes)."""
    from rich.console import Console
    from rich.progress import Progress

    from dl2c.experiments.paper.criteria import criteria
    from dl2c.experiments.paper.experiments import FULL, QUICK, experiments
    from dl2c.experiments.paper.figures import figures
    from dl2c.experiments.paper.table import data, markdown

    budget = QUICK if quick else FULL
    console = Console(stderr=True)
    with Progress(console=console, disable=quiet() or not console.is_terminal) as bar:
        task = bar.add_task("training")
        results = experiments(budget, output, lambda done, of: bar.update(task, completed=done, total=of))
    checks = criteria(results, budget.proper)
    content = data(results, checks)
    text = markdown(results, checks)
    write_output(output / "table.md", text)
    write_output(output / "table.json", to_json(content) + "\n")
    drawn = figures(results, output)
    print(to_json(content) if json else text)
    if not json:
        print(f"wrote {', '.join(map(str, (output / 'table.md', output / 'table.json', *drawn)))}")
    if not all(check.met for check in checks):
        raise typer.Exit(1)
