"""What `dl2c verify` says of each example, within seconds."""

import os
import time
from pathlib import Path

import pytest
from selection import quick_among
from slowness import slowness

from dl2c.options import Options
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove

FOLDER = Path(__file__).resolve().parents[2] / "examples"

ANSWERS = dict.fromkeys(
    (
        "acc",
        "bouncing_ball",
        "dubins",
        "etcs",
        "forced_acceleration",
        "paper/dict_to_box",
        "paper/safe_lock",
        "passive_safety",
        "pendulum",
        "rewards/ball",
        "rewards/distance",
        "rewards/ends",
        "rewards/soft_ball",
        "rewards/sum",
        "static_safety",
        "static_safety_line",
        "thermostat",
        "watertank",
    ),
    "proved",
) | {"evasion": "not checked", "rewards/deadline": "refuted", "waypoint": "not checked"}

UNSAFE = {"forced_acceleration", "rewards/ball", "rewards/ends", "rewards/soft_ball", "rewards/sum"}
"""Models that violate a `@safety` predicate, which is no part of their theorem."""

QUICK = {"evasion", "rewards/deadline", "rewards/soft_ball", "watertank"}
"""One or two of each answer."""

EACH = 3.0
"""Seconds for a question: all that are needed take less."""

SECONDS = dict.fromkeys(ANSWERS, 60.0) | {"waypoint": 15.0}
"""For a theorem. Where something is not checked the search goes on until the end."""


def test_every_example_is_in_the_table() -> None:
    assert sorted(ANSWERS) == sorted(
        path.relative_to(FOLDER).with_suffix("").as_posix() for path in FOLDER.rglob("*.kyx")
    )


@pytest.mark.parametrize("name", quick_among(sorted(ANSWERS), QUICK))
def test_an_example_is_what_the_readme_says(name: str) -> None:
    limits = Limits(EACH * slowness(), SECONDS[name], jobs=min(2, os.cpu_count() or 1))
    begun = time.monotonic()
    report = prove(Source.read(FOLDER / f"{name}.kyx"), Options(), limits)
    assert report.answer == ANSWERS[name]
    assert time.monotonic() - begun < SECONDS[name] + 5
    left = {(o.kind, o.answer) for o in report.obligations if o.answer != "proved"}
    match name:
        case "waypoint" | "evasion":  # what a diamond says
            assert left == {("program", "not checked")}
        case "rewards/deadline":
            assert report.counterexample is not None
        case _:
            assert {kind for kind, _ in left} == ({"safety"} if name in UNSAFE else set())


def test_the_readme_has_every_model() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8").partition("## What is proved")[2]
    table = text.partition("\n## ")[0]
    names = {name.removeprefix("rewards/") for name in ANSWERS}
    assert not [name for name in names if f"`{name}`" not in table and f"`rewards/{name}`" not in table]
