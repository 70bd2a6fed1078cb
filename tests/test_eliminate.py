"""Quantifiers are replaced by equivalent conditions, exactly; where that is not done, a place says why."""

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ir_builder import formula, term
from ir_oracle import holds
from kyx_builder import codes, lowered, resolved

from dl2c.diagnostics import CompileError
from dl2c.ir.eliminate import Quantifier, eliminated
from dl2c.ir.evaluate import truth
from dl2c.ir.logic import atoms, symbols
from dl2c.ir.lower_terms import lower_formula, lower_predicate
from dl2c.ir.model import Add, And, Call, Compare, Div, Formula, Mul, Neg, Number, Or, Sub, Symbol, Term
from dl2c.ir.printer import print_formula
from dl2c.parse.parser import parse_formula
from dl2c.smt.terms import condition, z3
from dl2c.source import NOWHERE

X, P, Q = (Symbol(name, "variable") for name in "xpq")
SCOPE = {name: Symbol(name, "variable") for name in ("a", "b", "c", "v", "x", "y", "z", "ep", "m")}


def quantified(everything: bool, body: Formula) -> Formula:
    return eliminated(Quantifier(everything, "x", X, NOWHERE), body)


def without(text: str) -> Formula:
    """The condition that a formula as users write it is lowered to."""
    return lower_formula(parse_formula(text), SCOPE)


def printed(text: str) -> str:
    return print_formula(without(text))


# The law --------------------------------------------------------------------------

numbers = st.sampled_from([Fraction(n) for n in (-2, -1, 0, 1, 2, 3)] + [Fraction(1, 2)])
coefficients = st.one_of(
    numbers.map(Number),
    st.sampled_from((P, Q, Neg(P), Add(P, Q), Sub(Q, Number(Fraction(1))), Mul(P, Q), Div(P, Q))),
)


@st.composite
def quadratics(draw: st.DrawFn, degree: int = 2) -> Term:
    result: Term = draw(coefficients)
    for power in range(1, draw(st.integers(0, degree)) + 1):
        monomial = X if power == 1 else Mul(X, X)
        result = Add(Mul(draw(coefficients), monomial), result)
    return result


lines = quadratics(1)
sides = st.one_of(
    quadratics(),
    quadratics(),
    quadratics(),
    lines.map(lambda t: Call("abs", (t,))),
    st.builds(lambda f, a, b: Call(f, (a, b)), st.sampled_from(("min", "max")), lines, lines),
    st.builds(Div, lines, lines),
    st.builds(Mul, lines, lines),
    st.builds(lambda a, b: Mul(a, Call("abs", (b,))), coefficients, lines),
)
comparisons = st.builds(
    Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), sides, st.one_of(lines, coefficients)
)
bodies = st.recursive(
    comparisons,
    lambda inner: st.builds(
        lambda make, parts: make(tuple(parts)),
        st.sampled_from((And, Or)),
        st.lists(inner, min_size=2, max_size=3),
    ),
    max_leaves=4,
)
values = st.sampled_from([Fraction(n, d) for n in range(-4, 5) for d in (1, 2)])


def decided_by_z3(everything: bool, body: Formula, at: dict[Symbol, Fraction]) -> bool:
    """For some or every x, by Z3's procedure for polynomials in one unknown."""
    context = z3.Context()
    solver = z3.SolverFor("QF_NRA", ctx=context)
    true = condition(body, context)
    solver.add(z3.Not(true) if everything else true)
    for symbol, value in at.items():
        solver.add(z3.Real(symbol.name, context) == z3.RealVal(str(value), context))
    answer = solver.check()
    assert answer != z3.unknown
    return (answer == z3.sat) != everything


@settings(max_examples=400, deadline=None)
@given(st.booleans(), bodies, st.lists(st.tuples(values, values), min_size=3, max_size=3))
@example(True, formula("x*x > p or x/q > 1"), [(Fraction(0), Fraction(0)), (Fraction(-1), Fraction(2))])
def test_the_result_holds_where_the_quantified_formula_does(
    everything: bool, body: Formula, points: list[tuple[Fraction, Fraction]]
) -> None:
    try:
        result = quantified(everything, body)
    except CompileError as refused:
        assert set(codes(refused)) == {"quantifier"}
        return
    assert X not in symbols(result)
    for p, q in points:
        at = {P: p, Q: q}
        assert holds(result, at) == decided_by_z3(everything, body, at), (print_formula(result), at)


@settings(max_examples=100, deadline=None)
@given(st.booleans(), bodies)
def test_an_undefined_part_makes_no_difference(everything: bool, body: Formula) -> None:
    """At q = 0 the coefficient p/q has no value: atoms that have it are false for every x."""
    try:
        result = quantified(everything, body)
    except CompileError:
        return
    for p in (Fraction(-1), Fraction(0), Fraction(2)):
        at = {P: p, Q: Fraction(0)}
        assert holds(result, at) == decided_by_z3(everything, body, at), print_formula(result)
