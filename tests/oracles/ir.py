"""An exact evaluator for IR that shares no code with dl2c, and random terms and formulas."""

import math
from fractions import Fraction

from hypothesis import strategies as st

from dl2c.interval.arithmetic import Interval, enclosure
from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)

X, Y, Z = SYMBOLS = tuple(Symbol(n, "variable") for n in "xyz")

# The oracle -------------------------------------------------------------------


def exact(t: Term, point: dict[Symbol, Fraction]) -> Fraction | None:
    """The real value, None where undefined; only rational operations."""
    match t:
        case Number(value):
            return value
        case Symbol():
            return point[t]
        case Pow(base, n):
            value = exact(base, point)
            return None if value is None else value**n
        case Neg(child):
            value = exact(child, point)
            return None if value is None else -value
        case Call(name, args):
            values = [exact(a, point) for a in args]
            return None if None in values else {"abs": abs, "min": min, "max": max}[name](*values)
    a, b = exact(t.left, point), exact(t.right, point)
    if a is None or b is None:
        return None
    match t:
        case Add():
            return a + b
        case Sub():
            return a - b
        case Mul():
            return a * b
        case Div():
            return None if b == 0 else a / b
    raise AssertionError(t)


def holds(f: Formula, point: dict[Symbol, Fraction]) -> bool:
    match f:
        case Truth(value):
            return value
        case And(children):
            return all(holds(c, point) for c in children)
        case Or(children):
            return any(holds(c, point) for c in children)
        case Compare(op, left, right):
            a, b = exact(left, point), exact(right, point)
            if a is None or b is None:
                return False
            return {"=": a == b, "!=": a != b, "<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[op]
    raise AssertionError(f)


# Strategies -------------------------------------------------------------------

fractions = st.one_of(
    st.integers(-3, 3).map(Fraction),
    st.fractions(-20, 20, max_denominator=50),
    st.floats(-1e6, 1e6).map(Fraction),
)
leaves = st.one_of(st.sampled_from(SYMBOLS), st.fractions(-5, 5, max_denominator=10).map(Number))


def _extended(inner: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
    binary = st.sampled_from((Add, Sub, Mul, Div))
    return st.one_of(
        st.builds(lambda make, a, b: make(a, b), binary, inner, inner),
        inner.map(Neg),
        st.builds(Pow, inner, st.integers(1, 4)),
        inner.map(lambda a: Call("abs", (a,))),
        st.builds(lambda name, a, b: Call(name, (a, b)), st.sampled_from(("min", "max")), inner, inner),
    )


terms = st.recursive(leaves, _extended, max_leaves=6)
comparisons = st.builds(Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), terms, terms)
formulas = st.recursive(
    comparisons,
    lambda inner: st.builds(
        lambda make, cs: make(tuple(cs)), st.sampled_from((And, Or)), st.lists(inner, min_size=1, max_size=3)
    ),
    max_leaves=4,
)


@st.composite
def points_in_boxes(draw: st.DrawFn) -> tuple[dict[Symbol, Fraction], dict[Symbol, Interval]]:
    """A point, and a box around it with double or infinite endpoints."""
    point, box = {}, {}
    for symbol in SYMBOLS:
        value = draw(fractions)
        around = enclosure(value)
        below, above = (
            draw(st.sampled_from((0.0, 0.5, 3.0, math.inf))),
            draw(st.sampled_from((0.0, 1.0, math.inf))),
        )
        point[symbol], box[symbol] = value, Interval(around.low - below, around.high + above)
    return point, box
