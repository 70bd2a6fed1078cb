"""The exported C on its target: a Cortex-M4 gives the verdicts of the host, bit for bit."""

import hashlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from target_program import CROSS, HARD, QEMU, SOFT, Records, needed, on_host, on_target, record, records_of

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.check import KINDS
from dl2c.report.trace import questions
from dl2c.training.rollout import rollout

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
STATES, FEW = 100_000, 500
ROUNDED_FUNCTIONS = {"pendulum"}
"""Its conditions use cos, which C libraries round differently: margins may differ in their last bits."""


MANY = [pytest.param((e, STATES), marks=pytest.mark.slow, id=e) for e in EXAMPLES]


@pytest.fixture(scope="module", params=[pytest.param(("waypoint", FEW), id="waypoint-few"), *MANY])
def recorded(request: pytest.FixtureRequest) -> tuple[str, Records]:
    """An example, and what its monitor is asked about so many states of its rollouts."""
    needed(CROSS)
    needed(QEMU[0])
    example, states = request.param
    return example, records_of(asked(unit_of(f"example:{example}", {}), states))


def asked(unit: Unit, states: int) -> Iterator[list[float]]:
    """All that replay asks about the states, and whether each step as a whole is one of the controller."""
    rows = list(steps(unit, states))
    numbers = len(unit.monitor.model.variables)
    for question in questions(unit, rows):
        found = list(map(float, question.line.split()[1:]))
        twice = found if question.check.transition else [*found[:numbers], *found]
        yield [float(KINDS.index(question.check.kind)), *twice]
    names = [v.name for v in unit.monitor.model.variables]
    for before, now in pairwise(rows):
        parts = [{n: row[n] for n in names} for row in (before, now)]
        yield record("controller", [*parts, {c.name: now[c.name] for c in unit.parameters}])


def steps(unit: Unit, states: int) -> Iterator[dict[str, Any]]:
    """Rows of rollouts of the example that a unit watches."""
    example, rows = f"example:{Path(unit.monitor.model.source).stem}", 0
    while rows < states:
        for row in rollout("random", example, 20, seed=rows):
            rows += 1
            yield row | {"step": str(row["step"])}


@pytest.mark.parametrize("real", ["float", "double"])
@pytest.mark.parametrize("sound", [False, True], ids=["plain", "sound"])
def test_a_cortex_m4_gives_the_verdicts_of_the_host(
    recorded: tuple[str, Records], real: str, sound: bool, tmp_path: Path
) -> None:
    example, records = recorded
    unit = unit_of(f"example:{example}", {}, real=real, sound=sound)
    host = on_host(unit, tmp_path / "host").verdicts(records)
    assert len(host) == len(records) >= FEW and 0 in host["id"] and (host["id"] > 0).any()
    for name, floats in (("hard", HARD), ("soft", SOFT)):
        target = on_target(unit, tmp_path / name, floats).emulated(records)
        if example in ROUNDED_FUNCTIONS and not sound:
            assert digest(target["id"]) == digest(host["id"]), name
        else:
            assert digest(target) == digest(host), (name, differing(host, target))


def digest(verdicts: Any) -> str:
    return hashlib.sha256(verdicts.copy().tobytes()).hexdigest()


def differing(host: Any, target: Any) -> Any:
    """The first verdict that differs."""
    k = next(k for k, pair in enumerate(zip(host, target, strict=True)) if pair[0] != pair[1])
    return k, host[k], target[k]
