"""Laws of interval arithmetic and contraction, against exact evaluation with fractions."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import pytest
from generators.ir_builder import formula, term
from hypothesis import given
from hypothesis import strategies as st
from oracles.ir import SYMBOLS, X, Y, exact, formulas, holds, points_in_boxes, terms
from selection import few_and_many_examples

from dl2c.interval.arithmetic import Interval, enclosure, evaluate, truth
from dl2c.interval.contract import contract
from dl2c.ir.model import (
    Call,
)

# Laws -------------------------------------------------------------------------


@few_and_many_examples(75, 300, terms, points_in_boxes())
def test_evaluate_encloses_the_value(t, drawn):
    point, box = drawn
    value, around = exact(t, point), evaluate(t, box)
    if value is None:
        assert not around.total
    else:
        assert around.contains(value)


@few_and_many_examples(75, 300, formulas, points_in_boxes())
def test_truth_is_never_wrong(f, drawn):
    point, box = drawn
    assert truth(f, box) in ("unknown", "true" if holds(f, point) else "false")


@few_and_many_examples(75, 300, formulas, points_in_boxes())
def test_contract_keeps_every_satisfying_point(f, drawn):
    point, box = drawn
    kept = contract(f, box)
    if kept is not None:
        assert all(box[s].low <= kept[s].low and kept[s].high <= box[s].high for s in SYMBOLS)
    if holds(f, point):
        assert kept is not None
        assert all(kept[s].contains(point[s]) for s in SYMBOLS)


@given(st.fractions(0, 10**6), st.floats(0, 10))
def test_sqrt_is_enclosed(value, width):
    around = enclosure(value)
    result = evaluate(Call("sqrt", (X,)), {X: Interval(around.low - width, around.high)})
    assert Fraction(result.high) ** 2 >= value
    assert evaluate(Call("sqrt", (X,)), {X: around}).low ** 2 <= value * (1 + Fraction(1, 2**50))


def _taylor(name: str, x: Fraction) -> Decimal:
    """exp, sin or cos to 40 digits."""
    with localcontext() as context:
        context.prec = 60
        value = Decimal(x.numerator) / Decimal(x.denominator)
        if name == "exp":
            return value.exp()
        total, power, n = Decimal(0), Decimal(1), 0
        while n < 120:
            if n % 2 == (name == "sin"):
                total += power if n % 4 < 2 else -power
            n += 1
            power = power * value / n
        return total


@given(st.sampled_from(("exp", "sin", "cos")), st.floats(-9, 9), st.floats(0, 4), st.floats(0, 4))
def test_transcendental_functions_are_enclosed(name, x, below, above):
    around = evaluate(Call(name, (X,)), {X: Interval(x - below, x + above)})
    assert around.contains(Fraction(_taylor(name, Fraction(x))))


@pytest.mark.parametrize("name", ["tan", "tanh", "arctan", "arcsin", "exp", "sin", "cos"])
@given(x=st.floats(-1, 1), below=st.floats(0, 3), above=st.floats(0, 3))
def test_functions_enclose_libm(name, x, below, above):
    value = getattr(math, {"arctan": "atan", "arcsin": "asin"}.get(name, name))(x)
    assert evaluate(Call(name, (X,)), {X: Interval(x - below, x + above)}).contains(value)


# Single facts -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "box", "low", "high", "total"),
    [
        ("x - 1", (0.0, 1.0), -1.0, 0.0, True),
        ("x * x", (-1.0, 2.0), 0.0, 4.0, True),
        ("0 * x", (-math.inf, math.inf), 0.0, 0.0, True),
        ("1 / x", (0.0, 2.0), 0.5, math.inf, False),
        ("1 / x", (-4.0, 0.0), -math.inf, -0.25, False),
        ("1 / x", (-1.0, 1.0), -math.inf, math.inf, False),
        ("sqrt(x)", (-1.0, 4.0), 0.0, 2.0, False),
        ("x**3", (-2.0, 1.0), -8.0, 1.0, True),
        ("sin(x)", (1.0, 2.0), math.sin(1.0), 1.0, True),
        ("pow(x, 2)", (4.0, 9.0), 16.0, 81.0, True),
    ],
)
def test_enclosures_are_tight(text, box, low, high, total):
    result = evaluate(term(text), {X: Interval(*box)})
    assert result.total == total
    assert (result.low, result.high) == pytest.approx((low, high), rel=1e-14)


@pytest.mark.parametrize(
    "text", ["1/(x - x) > 5", "sqrt(-1 - x) >= 0", "arcsin(2 + x) != 0", "1/(x - 2*x) == 7"]
)
def test_undefined_atoms_are_false(text):
    box = {X: Interval(0.0, 1.0)}
    assert truth(formula(text), box) in ("false", "unknown")
    assert truth(formula("1/(0*x) > 5"), box) == "false"
    assert truth(formula("1/(0*x) <= 5"), box) == "false"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x + 2 == 3", (1.0, 1.0)),
        ("2*x <= 4 and x >= 1", (1.0, 2.0)),
        ("x**2 <= 9 and x <= 0", (-3.0, 0.0)),
        ("abs(x) >= 2 and x >= -1", (2.0, 10.0)),
        ("sqrt(x) <= 2", (0.0, 4.0)),
        ("x*y == 1 and x >= 0", (1.0, 10.0)),
        ("min(x, 20) >= 3", (3.0, 10.0)),
        ("max(x, -4) <= 3", (-10.0, 3.0)),
        ("x == 1 or x == 4", (1.0, 4.0)),
        ("1/x >= 1", (0.0, 1.0)),
        ("x**3 == -8", (-2.0, -2.0)),
        ("max(x, y) == 5", (5.0, 5.0)),
        ("min(x, y + 6) == 5", (5.0, 10.0)),
        ("min(x, y + 8) == 5", (5.0, 5.0)),
    ],
)
def test_contraction_is_tight(text, expected):
    box = {X: Interval(-10.0, 10.0), Y: Interval(-1.0, 1.0)}
    kept = contract(formula(text), box)
    assert kept is not None
    assert (kept[X].low, kept[X].high) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "text", ["x > 10", "x*y > 10", "x < 1 and x > 1", "x**2 < 0 or abs(x) < 0", "0*x == 1"]
)
def test_contract_proves_emptiness(text):
    assert contract(formula(text), {X: Interval(-10.0, 10.0), Y: Interval(-1.0, 1.0)}) is None
