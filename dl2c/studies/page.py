"""A study as a page in Markdown, and as data: the model's own words, its annotations, tables, curves."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dl2c.env.opening import source_of
from dl2c.studies.measured import Measured, Result
from dl2c.training.evaluation import Estimate
from dl2c.training.plots import plot_curves

ANNOTATED = re.compile(r"/\* @.*?\*/[^\S\n]*\n?[^\n]*", re.DOTALL)
"""An annotation and the line that it belongs to."""


def write_page(result: Result, folder: Path) -> Path:
    """Write page.md and curves.png to the folder."""
    plot_curves({name: [run.curve] for name, run in result.runs.items()}, folder / "curves.png")
    path = folder / "page.md"
    path.write_text("\n".join(_page(result)), encoding="utf-8")
    return path


def _page(result: Result) -> Iterator[str]:
    study = result.study
    text = source_of(f"example:{study.example}").text
    steps = study.settings.steps
    yield f"# {study.title}\n"
    yield f"{_first_comment(text)}\n"
    yield f"## What is proved\n\n{study.proved}\n"
    yield f"```text\n{_problem(text)}\n```\n"
    yield f"## What is left to learn\n\n{study.learned}\n"
    yield f"```text\n{_annotations(text)}\n```\n"
    yield "## What was found\n"
    yield _table(result)
    yield READING.format(steps=f"{steps:,}", endured=f"{result.endured.steps:,}", n=result.endured.violations)
    yield "![learning curves](curves.png)\n"
    yield f"Again: `dl2c study {study.example}`\n"


READING = """\
Every row is of the same initial states, with 95 % intervals. With guards, alternatives that are not enabled
are replaced by ones that are; without, asking for one ends the episode (blocked). Values of continuous
decisions are moved to admissible ones in both. Trained for {steps} steps each. In {endured} steps of the
policy learned with guards a safety predicate failed {n} times.
"""


def _first_comment(text: str) -> str:
    found = re.match(r"/\*(.*?)\*/", text, re.DOTALL)
    assert found is not None, "examples begin with a comment"
    return re.sub(r"^ \* ?", "", found[1], flags=re.MULTILINE).strip()


def _problem(text: str) -> str:
    return text[text.index("\nProblem") :].split("\nEnd.", maxsplit=1)[0].strip()


def _annotations(text: str) -> str:
    return "\n".join(found.strip() for found in ANNOTATED.findall(text))


def _table(result: Result) -> str:
    goal = result.study.has_goal
    head = ["policy", "guards", *(["success"] if goal else []), "violations", "blocked", "mean return"]
    lines: list[Sequence[str]] = [head, ["---"] * len(head)]
    lines += [_row(row, goal) for row in result.rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _row(row: Measured, goal: bool) -> Sequence[str]:
    found = row.found
    rates = [*([found.success] if goal else []), found.violations, found.blocked]
    held = "yes" if row.guarded else "no"
    return [row.policy, held, *map(_percent, rates), _number(found.episode_return)]


def _percent(e: Estimate) -> str:
    return f"{e.value:.1%} [{e.low:.1%}, {e.high:.1%}]"


def _number(e: Estimate) -> str:
    return "" if math.isnan(e.value) else f"{e.value:.1f} [{e.low:.1f}, {e.high:.1f}]"


def data(result: Result) -> dict[str, Any]:
    """The same for programs."""
    return {
        "example": result.study.example,
        "rows": [asdict(row) for row in result.rows],
        "endured": asdict(result.endured),
        "seconds": {name: run.seconds for name, run in result.runs.items()},
    }
