"""`dl2c study`: train on shipped examples with their guards and without, and write a page about each."""

from pathlib import Path
from typing import Annotated

import typer

from dl2c.commands.completion import words
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import talkative
from dl2c.commands.waiting import working
from dl2c.outputs import write_output


@talkative
def study(
    examples: Annotated[
        list[str] | None,
        typer.Argument(
            help="Which of acc, etcs, passive_safety, pendulum, static_safety, watertank; all without any.",
            autocompletion=words("acc", "etcs", "passive_safety", "pendulum", "static_safety", "watertank"),
        ),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for a folder of each.")] = Path(
        "build/studies"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Train hardly at all.")] = False,
    json: Json = False,
) -> None:
    """Study examples: what is proved, what is learned, and what guards cost and buy (minutes each).

    Exits with 1 if a guarded policy violates a safety predicate.
    """
    from dl2c.experiments.studies.catalogue import STUDIES, study_of
    from dl2c.experiments.studies.measured import measure
    from dl2c.experiments.studies.page import data, write_page

    names = examples or [s.example for s in STUDIES]
    chosen = [s for name in names if (s := study_of(name)) is not None]
    if unknown := sorted(set(names) - {s.example for s in chosen}):
        there = ", ".join(sorted(s.example for s in STUDIES))
        raise CommandError(f"no study of {', '.join(unknown)}; there is {there}")
    found: list[dict[str, object]] = []
    for one in chosen:
        folder = output / one.example
        with working(f"studying {one.example}"):
            result = measure(one.quick(), folder, episodes=8, steps=800) if quick else measure(one, folder)
        found.append(data(result))
        write_output(folder / "results.json", to_json(found[-1]) + "\n")
        page = write_page(result, folder)
        if not json:
            print(page)
        failed = result.endured.violations or any(r.guarded and r.found.violations.value for r in result.rows)
        if failed:
            raise CommandError(f"{one.example}: a guarded policy violated what is proved")
    if json:
        print(to_json(found))
