"""Monitors and distances are those that KeYmaera X's own tests expect."""

import json
from dataclasses import replace

import pytest
from conftest import shared
from oracles.modelplex import WITHOUT_SOURCE, equal_metric, expectations, listed, verdict

SAMPLES = 1_000_000
"""States on which monitors must agree that Z3 cannot compare in time."""


@pytest.mark.slow
def test_monitors_are_those_of_modelplex() -> None:
    """Z3 proves it, but for those that take it too long: at least one form of the fixed-wing aircraft's."""
    found = {(e.test, e.text): verdict(e, 10.0, SAMPLES) for e in expectations(shared("oracle").parent)}
    for (test, _), how in found.items():
        print(f"{how}: {test}")
    for test, reason in WITHOUT_SOURCE.items():
        print(f"not compared: {test}: {reason}")
    verdicts = list(found.values())
    assert len(found) == 37 and set(verdicts) <= {"equivalent", "agree"}, verdicts
    assert verdicts.count("agree") <= 3


def test_every_expectation_has_a_model_or_a_reason() -> None:
    folder = shared("oracle").parent
    every = {(one["test"], text) for one in listed(folder) for text in one["expected"]}
    compared = {(e.test, e.text) for e in expectations(folder)}
    assert len(every) == 43
    assert {test for test, _ in every - compared} == set(WITHOUT_SOURCE)


def test_monitors_that_are_not_those_of_modelplex_are_told_apart() -> None:
    """With strict inequalities in place of the others, or one frame condition less."""
    listed_ = [e for e in expectations(shared("oracle").parent) if "<=" in e.text]
    chosen = [replace(e, text=e.text.replace("<=", "<", 1)) for e in listed_ if len(e.text) < 500]
    found = [verdict(e, 3.0) for e in chosen]
    assert found.count("different") >= 0.8 * len(found) >= 10, found


def test_distances_are_those_of_keymaera() -> None:
    """With the other sign: theirs is negative inside."""
    pairs = json.loads(shared("oracle/metric.json").read_text(encoding="utf-8"))
    assert len(pairs) == 9
    assert [pair for pair in pairs if not equal_metric(*pair)] == []


def test_another_distance_is_told_apart() -> None:
    assert not equal_metric("x >= y & a < b", "max(y-x,b-a) < 0")
