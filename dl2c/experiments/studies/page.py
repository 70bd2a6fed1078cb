"""A study as a page in Markdown, and as data: the model's problem and annotations, tables, curves."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import dedent
from typing import Any

from dl2c.experiments.studies.judged import Judgement
from dl2c.experiments.studies.measured import Measured, Result
from dl2c.outputs import write_output
from dl2c.picture.figure import episode_figure, save
from dl2c.report.blame import model_of
from dl2c.report.pictures import episodes_of, track_of
from dl2c.training.evaluation import FIRST_SEED
from dl2c.training.plots import plot_curves
from dl2c.training.run import Estimate

ANNOTATED = re.compile(r"[^\S\n]*/\* @.*?\*/[^\S\n]*\n?[^\n]*", re.DOTALL)
"""An annotation and the line that it belongs to."""

SCENE = re.compile(r"[^\S\n]*/\* @scene.*?\*/[^\S\n]*\n", re.DOTALL)
"""A `@scene` annotation: it is for pictures, learning does not depend on it."""


SHOWN = 4
"""Episodes in the picture of what the policy does."""


def write_page(result: Result, folder: Path) -> Path:
    """Write page.md, curves.png and episodes.png to the folder; the path of the page. Raises `OSError`."""
    study = result.study
    plot_curves({name: [run.curve] for name, run in result.runs.items()}, folder / "curves.png")
    policy = result.runs["with guards"].policy
    seen = episodes_of(policy, study.guarded, SHOWN, FIRST_SEED, **study.options)
    figure = episode_figure(model_of(seen[0]), list(map(track_of, seen)))
    save(figure, folder / "episodes.png")
    path = folder / "page.md"
    write_output(path, "\n".join(_page(result)))
    return path


def _page(result: Result) -> Iterator[str]:
    study = result.study
    text = study.guarded.text
    yield f"# {study.title}\n"
    yield f"{_first_comment(text)}\n"
    yield f"## What is proved\n\n{study.proved}\n"
    yield f"```text\n{problem(text)}\n```\n"
    yield f"## What is left to learn\n\n{study.learned}\n"
    yield f"```text\n{annotations(text)}\n```\n"
    yield "## What guards cost and buy\n"
    yield f"The guard is\n\n```text\n{study.guard}\n```\n"
    yield f"and the model without guards has `{study.instead}` in place of it; all else is the same.\n"
    yield _table(result)
    yield f"{study.found}\n"
    yield READING.format(
        steps=f"{study.settings.steps:,}", endured=f"{result.endured.steps:,}", n=result.endured.violations
    )
    yield "![Learning curves of both trainings](curves.png)\n"
    yield "## What the policy does\n"
    yield "Four episodes of the policy learned with guards; events of the first are marked, others faint.\n"
    yield "![Episodes of the policy learned with guards](episodes.png)\n"
    yield "## Is the policy itself proved?\n"
    yield from _judgement(result.judgement)
    yield f"To repeat this study: `dl2c study {study.example}`\n"


READING = """\
All rows were measured from the same initial states; brackets hold 95 % intervals. A violation is an episode
in which a safety predicate failed. Both policies were trained for {steps} steps with the same settings. The
policy learned with guards was followed for {endured} steps in the model with its guards: safety predicates
failed in {n} of them.
"""


def _judgement(found: Judgement) -> Iterator[str]:
    """What holds of the policy learned with guards where nothing corrects its requests."""
    if found.reason:
        yield f"Nothing can be proved of it: {found.reason}.\n"
        return
    yield "`dl2c verify --policy` asks whether it ever requests what the model does not admit.\n"
    yield _lines([["claim", "answer"], ["---", "---"], *map(list, found.claims.items())])
    what = "What it takes has admissible values" if found.shares else "Its request is admissible"
    share = f"{what} in {_percent(found.admissible)} of states drawn within the bounds"
    if found.claims["admissible"] == "unknown":
        share += f"; {found.decided:.1%} of their volume is decided"
    yield f"{share}.\n"
    if found.state:
        yield f"In this state it is not, so that guards act:\n\n```text\n{_listed(found.state)}\n```\n"
        asks = "takes, for which no values are admissible," if found.shares else "asks for"
        yield f"The policy {asks}\n\n```text\n{_listed(found.request)}\n```\n"


def _listed(values: Mapping[str, str]) -> str:
    """Names with values of few digits, or with words."""
    return ", ".join(f"{name} = {_short(value)}" for name, value in values.items())


def _short(text: str) -> str:
    return f"{float(text):.4g}" if re.fullmatch(r"-?[\d.e+-]+", text) else text


def _first_comment(text: str) -> str:
    found = re.match(r"/\*(.*?)\*/", text, re.DOTALL)
    assert found is not None, "examples begin with a comment"
    return re.sub(r"^ \* ?", "", found[1], flags=re.MULTILINE).strip()


def problem(text: str) -> str:
    """The text of the model from `Problem` to its `End.`"""
    return text[text.index("\nProblem") :].split("\nEnd.", maxsplit=1)[0].strip()


def annotations(text: str) -> str:
    """All annotations of a model but `@scene`, each with the line that it belongs to."""
    return "\n".join(dedent(found) for found in ANNOTATED.findall(SCENE.sub("", text)))


def _table(result: Result) -> str:
    goal = result.study.has_goal
    head = ["policy", "model", *(["success"] if goal else []), "violations", "mean return"]
    return _lines([head, ["---"] * len(head), *(_row(row, goal) for row in result.rows)])


def _lines(lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _row(row: Measured, goal: bool) -> Sequence[str]:
    found = row.found
    rates = [*([found.success] if goal else []), found.violations]
    model = "with guards" if row.guarded else "without"
    return [row.policy, model, *map(_percent, rates), _number(found.episode_return)]


def _percent(e: Estimate) -> str:
    return f"{e.value:.1%} [{e.low:.1%}, {e.high:.1%}]"


def _number(e: Estimate) -> str:
    return "" if math.isnan(e.value) else f"{e.value:.1f} [{e.low:.1f}, {e.high:.1f}]"


def data(result: Result) -> dict[str, Any]:
    """What a study measured, for JSON: rows, the long run with guards, what is proved of the policy, and the
    seconds of each training.
    """
    return {
        "example": result.study.example,
        "rows": [asdict(row) for row in result.rows],
        "endured": asdict(result.endured),
        "judgement": asdict(result.judgement),
        "seconds": {name: run.seconds for name, run in result.runs.items()},
    }
