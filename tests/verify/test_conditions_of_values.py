"""Facts that say that terms have values are found before a question becomes hard for want of them."""

import time
from collections.abc import Sequence

import pytest
from generators.ir_builder import formula

from dl2c.ir.model import Formula
from dl2c.smt.portfolio import Portfolio
from dl2c.verify.arithmetic.prover import Prover

BRAKES = ("v >= 0", "ep > 0", "v + a*ep < 0")


@pytest.mark.parametrize(
    "facts, found",
    [
        ((*BRAKES, "x > v**2/(2*a)"), ["2*a != 0"]),
        ((*BRAKES, "x > -(v/a)", "y > sqrt(-a)"), ["a != 0", "-a >= 0"]),
        (("v >= 0", "ep > 0", "v + a*ep <= 0", "x > v/a"), []),
        ((*BRAKES, "x > v/ep"), []),
        ((*BRAKES, "x > v"), []),
        (("x > 1/y", "z > 1/(y*y + 1)"), ["y*y + 1 != 0"]),
        (("x < 0", "x > 0", "x > 1/y"), ["y != 0"]),
    ],
)
def test_what_facts_imply_is_found(facts: Sequence[str], found: list[str]) -> None:
    with Portfolio(1) as solvers:
        until = time.monotonic() + 60
        prover, given = Prover(solvers, 10.0, until), [formula(f) for f in facts]
        assert set(prover._conditions(given, until)) == {formula(f) for f in found}
        assert prover._conditions(given, 0.0) == []


def decided(facts: Sequence[Formula], goal: Formula, if_defined: bool) -> str:
    with Portfolio(1) as solvers:
        prover = Prover(solvers, 5.0, time.monotonic() + 60, if_defined=if_defined)
        return prover.decide(facts, goal).verdict


@pytest.mark.parametrize("if_defined, answers", [(False, ("unsat", "sat")), (True, ("unsat", "unsat"))])
def test_what_they_do_not_imply_is_not_assumed(if_defined: bool, answers: tuple[str, str]) -> None:
    """A quotient may be any number where its divisor may be zero."""
    sure = [formula(f) for f in (*BRAKES, "x*x*x + y > v/a", "y < 1 - x*x*x")]
    unsure = [formula(f) for f in ("v >= 1", "x > v/a", "x <= 0")]
    goal = formula("a*a*a*a*a < 0")
    assert decided(sure, goal, if_defined) == answers[0]
    assert decided(unsure, goal, if_defined) == answers[1]
