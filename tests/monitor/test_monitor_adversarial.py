"""The sound monitor against exact arithmetic, on very many states as close to a boundary as can be."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from monitor.test_monitor_sound import MODELS, QUICK, random_row
from monitor.test_target import steps
from numpy.typing import NDArray
from oracles.exact_truth import Row, exact_check
from selection import quick_among
from target_program import Asked, on_host

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.check import KINDS, OUT_OF_RANGE, Check
from dl2c.report.trace import questions

EXAMPLES = sorted(set(MODELS) - {"operations", "functions", "pendulum"})
"""Whole numbers give the truth of these; campaigns/test_controller_relation.py judges the pendulum too."""
STATES, FEW = 1_000_000, 400
AROUND = 40
"""States around each end of a bisection, each number off by 2 units in the last place at most."""

Rows = NDArray[np.floating]
Holds = Callable[[Row], bool]


def beginnings(unit: Unit, check: Check, rng: random.Random, holds: Holds) -> list[list[float]]:
    """States of a rollout, and random ones, that satisfy a check; all where none does, as an equality of
    computed values that doubles do not have.
    """
    steps_ = list(steps(unit, 200))
    asked = [q.line.split()[1:] for q in questions(unit, steps_) if q.check == check]
    found = [list(map(float, numbers)) for numbers in rng.sample(asked, min(len(asked), 200))]
    for _ in range(2000):
        parts = random_row(check, rng.choice(check.cases), unit, rng)
        found.append([v for part in parts for v in part.values()])
    return [row for row in found if holds(row)] or found


def near_boundaries(unit: Unit, check: Check, rng: random.Random, count: int, holds: Holds) -> Iterator[Rows]:
    """At least so many states around points where the check changes its truth, which bisection finds along
    a line on which one number changes, its copy in the state after with it. Some begin where two or three
    numbers are equal.
    """
    starts = beginnings(unit, check, rng, holds)
    size = len(unit.monitor.model.variables)
    noise = np.random.default_rng(rng.randrange(2**32))
    kind = np.float32 if unit.single else np.float64
    made = tried = 0
    while made < 1.6 * count:
        tried += 1
        assert tried < 200 * count, "there are no boundaries"
        start = np.array(rng.choice(starts), kind)
        k = rng.randrange(len(start))
        copied = check.transition and k < size and start[k] == start[k + size]
        moved = [k, k + size] if copied else [k]
        reach = rng.choice([1e-3, 1.0, 30.0]) * (1 + abs(start[k]))
        glued = rng.random() < 0.1
        if glued:
            start[rng.choices(range(len(start)), k=2)] = start[rng.randrange(len(start))]
        far = start[k] + kind(rng.uniform(-reach, reach))
        ends = bisected(start, moved, far, holds) if holds(start.tolist()) else [start]
        ends = ends or [start] * glued
        for end in ends:
            rows = np.repeat(end[None], AROUND, axis=0)
            off = noise.integers(-2, 3, rows.shape) * (noise.random(rows.shape) < 0.3)
            rows = (rows + off * np.spacing(rows)).astype(kind)
            if check.transition:
                equal = end[:size] == end[size : 2 * size]
                rows[:, size : 2 * size][:, equal] = rows[:, :size][:, equal]
            made += len(rows)
            yield rows


def bisected(start: Rows, moved: list[int], far: float, holds: Holds) -> list[Rows]:
    """Two neighbouring states of which one satisfies the check, if it does not hold at the far end."""
    near, end = start, start.copy()
    end[moved] = far
    if not np.isfinite(end).all() or holds(end.tolist()):
        return []
    while True:
        middle = near.copy()
        middle[moved] = (near[moved[0]] + end[moved[0]]) / 2
        if middle[moved[0]] in (near[moved[0]], end[moved[0]]):
            return [near, end]
        near, end = (middle, end) if holds(middle.tolist()) else (near, middle)


def verdicts_of(asked: Asked, check: Check, rows: Rows) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Numbers of conditions, and what is unknown."""
    size = len(asked.unit.monitor.model.variables)
    states = rows if check.transition else np.concatenate([rows[:, :size], rows], axis=1)
    which = np.full((len(rows), 1), KINDS.index(check.kind), rows.dtype)
    said = asked.verdicts(np.concatenate([which, states], axis=1))
    return said["id"], said["value"] != 0


@pytest.mark.parametrize("states", [FEW, pytest.param(STATES, marks=pytest.mark.slow)])
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("example", quick_among(EXAMPLES, QUICK))
def test_no_verdict_is_wrong(
    example: str, real: str, states: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """How often the plain form is satisfied where the model is not is printed beside."""
    units = [unit_of(f"example:{example}", {}, real=real, sound=sound) for sound in (True, False)]
    sound, plain = (on_host(u, tmp_path / str(u.sound)) for u in units)
    rng = random.Random(example)
    wrong = missed = total = unknown = 0
    checks = units[0].monitor.checks
    for check in checks:
        holds = exact_check(units[0].monitor.model, check)
        rows = np.concatenate(list(near_boundaries(units[0], check, rng, states // len(checks) + 1, holds)))
        truth = np.fromiter((holds(row) for row in map(np.ndarray.tolist, rows)), bool, len(rows))
        (id_, open_), (plain_id, _) = (verdicts_of(asked, check, rows) for asked in (sound, plain))
        judged = id_ != OUT_OF_RANGE
        wrong += int((judged & ~open_ & ((id_ == 0) != truth)).sum())
        missed += int((judged & (plain_id == 0) & ~truth).sum())
        total, unknown = total + int(judged.sum()), unknown + int((judged & open_).sum())
    with capsys.disabled():
        print(f"\n{example} {real}: {total} states, {wrong} wrong, {unknown} unknown; plain: {missed} not")
    assert wrong == 0
    assert total >= states
