"""Numbers that are none, or hardly any, in every field: no undefined behaviour, and never satisfied."""

import random
from pathlib import Path

import numpy as np
import pytest
from monitor.test_monitor_adversarial import EXAMPLES, Rows, verdicts_of
from monitor.test_monitor_sound import random_row
from oracles.exact_truth import exact_check
from selection import few_and_many, quick_among
from target_program import on_host

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.check import OUT_OF_RANGE, Check

SANITIZED = ("-fsanitize=undefined,float-divide-by-zero,float-cast-overflow", "-fno-sanitize-recover=all")
FIRST = pytest.param("waypoint", "double", id="waypoint-double")
ALL = [
    pytest.param(e, r, marks=pytest.mark.slow) for e in [*EXAMPLES, "pendulum"] for r in ("double", "float")
]


def special(kind: type[np.floating]) -> tuple[list[float], list[float]]:
    """What is no number of a state, and what is an odd one."""
    ends = np.finfo(kind)
    tiny, normal, most = map(float, (ends.smallest_subnormal, ends.smallest_normal, ends.max))
    none = [np.nan, np.inf, -np.inf, most, -most]
    return none, [-0.0, tiny, -tiny, normal, -normal, float(np.nextafter(kind(normal), kind(0)))]


def random_rows(unit: Unit, check: Check, count: int) -> Rows:
    rng = random.Random(unit.stem)
    drawn = [random_row(check, rng.choice(check.cases), unit, rng) for _ in range(count)]
    rows = [[value for part in row for value in part.values()] for row in drawn]
    return np.array(rows, np.float32 if unit.single else np.float64)


def spoiled(rows: Rows, values: list[float]) -> Rows:
    """The rows with each of their numbers replaced by each of the values, and with all of them replaced."""
    found = [np.full_like(rows, value) for value in values]
    for k in range(rows.shape[1]):
        for value in values:
            found.append(rows.copy())
            found[-1][:, k] = value
    return np.concatenate(found)


@pytest.mark.parametrize(("example", "real"), [FIRST, *ALL])
def test_what_is_no_number_is_never_satisfied(example: str, real: str, tmp_path: Path) -> None:
    for sound in (False, True):
        unit = unit_of(f"example:{example}", {}, real=real, sound=sound)
        asked = on_host(unit, tmp_path / str(sound), *SANITIZED)
        none, odd = special(np.float32 if unit.single else np.float64)
        for check in unit.monitor.checks:
            starts = random_rows(unit, check, 10)
            ids, missed = verdicts_of(asked, check, spoiled(starts, none))
            assert (ids == OUT_OF_RANGE).all() and (sound or missed.all())
            rows = spoiled(starts, odd)
            ids, unknown = verdicts_of(asked, check, rows)
            if sound and example in EXAMPLES:
                holds = exact_check(unit.monitor.model, check)
                decided = (ids != OUT_OF_RANGE) & ~unknown
                assert ((ids == 0) == [holds(row) for row in rows.tolist()])[decided].all()


@pytest.mark.parametrize("count", few_and_many(300, 3000))
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("example", quick_among((*EXAMPLES, "pendulum"), ("acc", "pendulum", "waypoint")))
def test_of_usual_states_hardly_any_is_unknown(count: int, example: str, real: str, tmp_path: Path) -> None:
    unit = unit_of(f"example:{example}", {}, real=real, sound=True)
    asked = on_host(unit, tmp_path)
    for check in unit.monitor.checks:
        _, unknown = verdicts_of(asked, check, random_rows(unit, check, count))
        assert unknown.mean() < 0.01, check.kind
