"""Conditions over smooth margins hold where the conditions hold, which an exact evaluator judges."""

from fractions import Fraction

import pytest
from generators.ir_builder import formula as ir_formula
from hypothesis import assume
from hypothesis import strategies as st
from oracles.ir import SYMBOLS, formulas, holds, leaves
from selection import few_and_many_examples

from dl2c.ir.logic import atoms, operands, symbols
from dl2c.ir.margins import TooManyCases, smooth
from dl2c.ir.model import ZERO, Call, Compare, Div, Formula, Symbol, Term

small = st.one_of(
    st.sampled_from([Fraction(n) for n in (0, 1, -1, 2)]), st.fractions(-4, 4, max_denominator=3)
)
quotients = st.builds(Div, leaves, leaves)
choices = st.recursive(
    st.one_of(leaves, quotients),
    lambda inner: st.builds(
        lambda name, *args: Call(name, args), st.sampled_from(("min", "max")), inner, inner
    ),
    max_leaves=4,
)
choosing = st.builds(Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), choices, choices)
points = st.fixed_dictionaries(dict.fromkeys(SYMBOLS, small))
moving = st.sets(st.sampled_from(SYMBOLS))


def kinked(term: Term, moves: set[Symbol]) -> bool:
    own = isinstance(term, Call) and not symbols(term).isdisjoint(moves)
    return own or any(kinked(t, moves) for t in operands(term))


@few_and_many_examples(100, 400, st.one_of(formulas, choosing), points, moving, st.booleans())
def test_the_condition_holds_where_it_held(
    formula: Formula, point: dict[Symbol, Fraction], moves: set[Symbol], as_written: bool
) -> None:
    try:
        made = smooth(formula, lambda term: not symbols(term).isdisjoint(moves), as_written)
    except TooManyCases:
        assume(False)
        raise
    assert holds(made, point) == holds(formula, point)
    assert all(atom.right == ZERO and not kinked(atom.left, moves) for atom in atoms(made))


@pytest.mark.parametrize(
    "text",
    [
        "max(-1, x/x) >= y",
        "min(2, y/x) <= 3",
        "abs(x/x) + max(y, -1) >= -1",
        "1/max(x, 0) >= -1",
        "max(-1, 1/abs(x)) >= y",
    ],
)
def test_a_condition_without_value_is_false_where_the_larger_term_has_one(text: str) -> None:
    point = {**dict.fromkeys(SYMBOLS, Fraction(0)), SYMBOLS[1]: Fraction(-2)}
    formula = ir_formula(text)
    assert not holds(formula, point)
    assert not holds(smooth(formula, lambda _: True), point)
    assert holds(smooth(formula, lambda _: True), {s: v if v else Fraction(1) for s, v in point.items()})
