"""The paper's evaluation: its closed forms, and all of it with hardly any training."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dl2c import cli
from dl2c.experiments.paper.closed_forms import Course, fastest_time, guarded_drive, violation_time
from dl2c.experiments.paper.statistics import mean_over_seeds, rate_over_seeds

POSITIVE = st.floats(0.1, 10)
COURSES = st.tuples(st.floats(0.01, 100), st.floats(0.1, 0.5), POSITIVE, POSITIVE, st.floats(2, 30))


@given(st.floats(0.01, 100), st.floats(0, 10), POSITIVE, POSITIVE)
def test_the_stopping_distance_is_what_is_left_at_the_predicted_end(
    d: float, v: float, A: float, b: float
) -> None:
    d += v**2 / (2 * b)
    t = float(violation_time(*(np.array(x) for x in (d, v, A, b))))
    assert t > 0
    assert math.isclose((v + A * t) ** 2 / (2 * b), d - v * t - A * t**2 / 2, rel_tol=1e-9, abs_tol=1e-9)


def driven(d: float, ep: float, A: float, b: float, Vmax: float, step: float) -> float:
    """The time of a drive under the guards, decision by decision, each held for `step`."""
    x, v, time = 0.0, 0.0, 0.0
    while x <= d:
        a = A if v + A * ep <= Vmax else 0.0
        x, v, time = x + v * step + a * step**2 / 2, v + a * step, time + step
    return time + v / b


@given(COURSES)
def test_the_closed_form_is_the_drive(course: tuple[float, ...]) -> None:
    d, ep, A, b, Vmax = course
    Vmax += 2 * A * ep
    found = guarded_drive(Course(*(np.array(x) for x in (d, ep, A, b, Vmax))))
    near = [driven(d * (1 + e), ep, A, b, Vmax * (1 + f), ep) for e in (-1e-9, 1e-9) for f in (-1e-9, 1e-9)]
    assert any(math.isclose(float(found.time), t, rel_tol=1e-6) for t in near)


@given(COURSES)
def test_no_run_is_faster_than_the_infimum(course: tuple[float, ...]) -> None:
    """Those that decide every `ep` seconds, and those that decide more often."""
    d, ep, A, b, Vmax = course
    Vmax += 2 * A * ep
    least = float(fastest_time(Course(*(np.array(x) for x in (d, ep, A, b, Vmax)))))
    assert all(driven(d, ep, A, b, Vmax, ep / n) >= least * (1 - 1e-9) for n in (1, 2, 3, 7))


def test_intervals_know_that_seeds_differ() -> None:
    alike = [np.array([True, True, True, False] * 25)] * 4
    apart = [np.ones(100, bool)] * 3 + [np.zeros(100, bool)]
    assert rate_over_seeds(alike).value == rate_over_seeds(apart).value == 0.75
    assert rate_over_seeds(apart).low < 0.1 < 0.7 < rate_over_seeds(alike).low
    assert rate_over_seeds([np.ones(50, bool)]).high == 1
    assert math.isnan(mean_over_seeds([np.zeros(0)]).value)
    assert mean_over_seeds([np.array([1.0]), np.array([3.0])]).high == pytest.approx(2 + 12.7062)


@pytest.mark.slow
def test_the_whole_evaluation_runs(capsys: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whatever was learned: it is safe, ends when predicted, and with masks takes the optimum's time."""
    pytest.importorskip("sb3_contrib")
    monkeypatch.setattr("sys.argv", ["dl2c", "paper", "--quick", "-o", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code
    text = capsys.readouterr().out
    for name in ("table.md", "table.json", "fig1.png", "fig2.png", "fig3.png"):
        assert (tmp_path / name).stat().st_size > 1000
    found = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))
    assert all(c["met"] for c in found["criteria"]) and "**no**" not in text
    masked = {run["policy"]: run for run in found["test_3"] if run["masked"]}
    assert [run["success"]["value"] for run in masked.values()] == [1, 1, 1]
    assert all(abs(run["time_of_optimum"]["value"] - 1) < 1e-9 for run in masked.values())
    assert {seed["error"] < 1e-9 for seed in found["test_2"]} == {True}


def test_a_missed_criterion_is_a_failure(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("sb3_contrib")
    from dl2c.experiments.paper import criteria

    missed = criteria.Criterion("this", "that", "nothing", False)
    monkeypatch.setattr(criteria, "criteria", lambda results, proper: [missed])
    monkeypatch.setattr("dl2c.experiments.paper.experiments.experiments", lambda *_: None)
    monkeypatch.setattr("dl2c.experiments.paper.table.data", lambda *_: {})
    monkeypatch.setattr("dl2c.experiments.paper.table.markdown", lambda *_: "")
    monkeypatch.setattr("dl2c.experiments.paper.figures.figures", lambda *_: [])
    monkeypatch.setattr("sys.argv", ["dl2c", "paper", "-o", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
