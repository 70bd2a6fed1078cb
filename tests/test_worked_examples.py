"""Every line of every table in examples/rewards/README.md is run."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from both_forms import Both
from conftest import REPOSITORY

FOLDER = REPOSITORY / "examples" / "rewards"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
TABLE = re.compile(r"^\| `(\w+\.kyx)` before \|(.*)\|\n\|[-| ]+\|\n((?:\|.*\|\n)+)", re.M)


@dataclass(frozen=True)
class Line:
    """One step of a table: `cells` by the title of their column."""

    file: str
    before: str
    cells: dict[str, str]


def values(text: str) -> dict[str, float]:
    """`x=1, v=2`"""
    pairs = [part.split("=") for part in text.split(",") if part.strip()]
    return {name.strip(): float(number) for name, number in pairs}


def episodes() -> list[list[Line]]:
    """The lines of all tables; one with an empty first cell belongs to the episode above."""
    found: list[list[Line]] = []
    for file, titles, rows in TABLE.findall(README):
        columns = ["before", *(title.strip() for title in titles.split("|"))]
        for row in rows.splitlines():
            cells = dict(zip(columns, (cell.strip() for cell in row.split("|")[1:-1]), strict=True))
            line = Line(file, cells.pop("before"), cells)
            if line.before:
                found.append([])
            found[-1].append(line)
    return found


EPISODES = episodes()


@cache
def model(file: str, option: str) -> Both:
    options = dict([option.split("=")]) if option else {}
    return Both(str(FOLDER / file), **options)


@pytest.mark.parametrize("lines", EPISODES, ids=[f"{e[0].file} {e[0].before}" for e in EPISODES])
def test_a_line_is_what_happens(lines: list[Line]) -> None:
    both = model(lines[0].file, lines[0].cells.get("options", ""))
    both.begin(**values(lines[0].before))
    for line in lines:
        seen = both.step()
        cells = line.cells
        after = values(cells["after"])
        assert {name: seen.state[name] for name in after} == pytest.approx(after, abs=1e-7)
        assert seen.reward == pytest.approx(float(cells["reward"]), abs=1e-7)
        assert seen.duration == pytest.approx(float(cells["seconds"]), abs=1e-7)
        assert seen.cost == int(cells["cost"])
        flag, status, reason = seen.ending
        told = [flag, status, reason] if flag else ["goes on", *([status] if status != "none" else [])]
        assert cells["episode"] == ", ".join(told)
        assert seen.success == (None if not flag else status == "success")


def test_the_readme_shows_every_model_and_what_it_says() -> None:
    files = {path.name for path in FOLDER.glob("*.kyx")}
    assert {lines[0].file for lines in EPISODES} == files
    assert len(EPISODES) >= 20
    texts = " ".join(Path(path).read_text(encoding="ascii") for path in FOLDER.glob("*.kyx"))
    shown = re.findall(r"/\* (@.*?) \*/", README, flags=re.S)
    written = {" ".join(a.split()) for a in re.findall(r"/\* (@.*?) \*/", texts, flags=re.S)}
    assert shown and {" ".join(a.split()) for a in shown} <= written
    assert "examples/rewards/README.md" in (REPOSITORY / "README.md").read_text(encoding="utf-8")
