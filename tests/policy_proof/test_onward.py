"""What follows of admissible requests: `kept` and `for ever`: models where it fails, and exact runs."""

from fractions import Fraction
from functools import reduce
from pathlib import Path
from random import Random

import pytest
from oracles.exact_random import conjuncts, run
from oracles.exact_runs import premises
from selection import quick_among

from dl2c.env.opening import compilation_of
from dl2c.ir.printer import print_number
from dl2c.parse import tree
from dl2c.parse.parser import parse_formula
from dl2c.policy_proof.onward import Onward, onward
from dl2c.resolve.shape import written_variables
from dl2c.resolve.symbols import mentioned, nodes
from dl2c.source import Source
from dl2c.verify.prove import Limits
from dl2c.verify.theorem import theorem_of

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

CART = """Theorem "cart"
ProgramVariables
  /* @var: bound=[0:10] */ Real x;
  /* @var: bound=[-1:1] */ Real v;
  Real t;
End.
Problem
  x = 5 & v = 0 -> [{
    v := *; ?-1 <= v & v <= 1 GUARD; t := 0;
    {x' = v, t' = 1 & t <= 1}
  }*@invariant(INVARIANT)] x >= -100
End.
End.
"""


def answers(text: str, **fixed: int) -> Onward:
    found = compilation_of(Source("cart.kyx", text), {})
    values = {name: Fraction(value) for name, value in fixed.items()}
    return onward(found.parsed.entry, found.unbounded, values, Limits(10.0, 10.0, 1))


def cart(guard: str = "", invariant: str = "-1 <= v & v <= 1") -> str:
    return CART.replace("GUARD", guard).replace("INVARIANT", invariant)


INSIDE = "& 0 <= x + v & x + v <= 10"


def test_guards_keep_the_bounds() -> None:
    assert answers(cart(INSIDE)) == Onward("proved", "proved")


def test_bounds_are_left() -> None:
    assert answers(cart()) == Onward("unknown", "until the bounds are left")


@pytest.mark.parametrize(
    "invariant",
    [
        pytest.param("x >= 5", id="left by a step"),
        pytest.param("x >= 6", id="not so at the beginning"),
        pytest.param("v >= -1 & v^2 < 1", id="left at the end of what is admissible"),
    ],
)
def test_what_is_no_invariant_goes_on_for_no_time(invariant: str) -> None:
    assert answers(cart(INSIDE, invariant)).lasting == "unknown"


def test_a_value_that_changes_does_not_stay_fixed() -> None:
    assert answers(cart(INSIDE), x=5) == Onward("proved", "unknown")


def test_without_an_invariant_nothing_is_said() -> None:
    assert answers(cart(INSIDE).replace("@invariant(-1 <= v & v <= 1)", "")) == Onward()


@pytest.mark.parametrize("name", quick_among(("bouncing_ball", "thermostat", "watertank"), ("watertank",)))
def test_steps_of_examples_end_within_the_bounds(name: str) -> None:
    """Where that is proved, no exact run from J and the bounds, for any time, leaves the bounds."""
    path = EXAMPLES / f"{name}.kyx"
    found = compilation_of(str(path), {})
    values = {c.name: c.value for c in found.unbounded.constants if c.value is not None}
    assert onward(found.parsed.entry, found.unbounded, values, Limits(20.0, 20.0, 1)) == Onward(
        "proved", "proved"
    )
    formula = theorem_of(found.parsed.entry, {}).formula
    (loop,) = (n for n in nodes(formula) if isinstance(n, tree.Loop))
    given, _ = premises(formula)
    changed = written_variables((loop,))
    steady = [part for f in given for part in conjuncts(f) if not changed.intersection(mentioned(part))]
    inside = [
        parse_formula(f"{v.name} {op} {print_number(end)}")
        for v in (*found.unbounded.constants, *(v for v in found.unbounded.variables if v.observed))
        for op, end in ((">=", v.bound.low), ("<=", v.bound.high))
        if end is not None
    ]
    start, end = reduce(tree.And, [*steady, *loop.invariants, *inside]), reduce(tree.And, inside)
    claim = tree.Imply(start, tree.Box(tree.Loop(loop.child), end))
    random = Random(1)
    runs = [run(claim, random, start) for _ in range(150)]
    assert sum(r.ended for r in runs) > 50
    assert [r.finding for r in runs if r.finding is not None] == []
