"""Zeros of the polynomials that tests make of an input, in doubles or rationals.

Of degree 1 and 2 by formula. Of higher degrees between the turning points, which are the zeros of the
derivative, by bisection: the same operations in the same order as cgen/runtime/zeros.h.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import nan, sqrt

from dl2c.ir.doubles import bisected, from_ordinal, ordinal
from dl2c.ir.evaluate import Value, square_root

TOUCH = 2.0**-48
"""A value counts as zero if it is no further from it than this, relative to the terms that make it."""

MAX_DEGREE = 12
"""Of a polynomial in an input; for higher degrees bisection takes too long."""

HALVINGS = 64
"""Of an interval of rationals."""


def zero_count(degree: int) -> int:
    """How many values `zeros` gives at most."""
    return degree if degree <= 2 else 2 * degree + 1


def zeros(c: Sequence[Value], low: Value, high: Value, near: bool, exact: bool) -> list[Value]:
    """Where c0 + c1*u + ... is zero for u from `low` to `high`; up to degree 2 anywhere. Where it turns
    and nearly touches zero too, and if `near`, wherever it turns.
    """
    c = list(c) if exact else [float(x) for x in c]
    while len(c) > 3 and c[-1] == 0:
        c.pop()
    if len(c) <= 3:
        return [] if not near and misses(c, exact) else roots(c, exact)
    rows = [c]
    while len(rows[-1]) > 3:
        rows.append([k * x for k, x in enumerate(rows[-1])][1:])
    turns = sorted(r for r in roots(rows.pop(), exact) if low < r < high)
    while len(rows) > 1:
        turns = _crossings(rows.pop(), [low, *turns, high], exact)
    found = [t for t in turns if near or _touches(c, t, exact)]
    found += [end for end in (low, high) if _touches(c, end, exact)]
    return [*found, *_crossings(c, [low, *turns, high], exact)]


def _crossings(c: Sequence[Value], places: Sequence[Value], exact: bool) -> list[Value]:
    """Where the sign changes between two neighbouring places, and those between the ends that are zeros."""
    found: list[Value] = []
    for k, (a, b) in enumerate(pairwise(places), 2):
        below, after = _value(c, a), _value(c, b)
        if after == 0 and k < len(places):
            found.append(b)
        if (below < 0 < after) or (after < 0 < below):
            found.append(_bisected(c, a, b, below < 0, exact))
    return found


def _bisected(c: Sequence[Value], a: Value, b: Value, below: bool, exact: bool) -> Value:
    """Where it first has the sign that it has at b, up to the last bit or by halving."""
    if exact:
        for _ in range(HALVINGS):
            middle = (a + b) / 2
            a, b = (middle, b) if (_value(c, middle) < 0) == below else (a, middle)
        return b

    def passed(tried: float) -> bool:
        return (_value(c, tried) < 0) != below

    return from_ordinal(bisected(passed, ordinal(float(b)), ordinal(float(a))))


def _value(c: Sequence[Value], at: Value) -> Value:
    value = c[-1]
    for x in reversed(c[:-1]):
        value = value * at + x
    return value


def _touches(c: Sequence[Value], at: Value, exact: bool) -> bool:
    size = _value([abs(x) for x in c], abs(at))
    return abs(_value(c, at)) <= (0 if exact else TOUCH) * size


def roots(c: Sequence[Value], exact: bool) -> list[Value]:
    """Where c0 + c1*u + c2*u^2 is zero; where it is nearest to zero if that is nowhere."""
    c0, c1, c2 = (*c, *[Fraction(0)] * 3)[:3] if exact else (*map(float, c), 0.0, 0.0, 0.0)[:3]
    if c2 == 0:
        return [] if c1 == 0 else [-c0 / c1]
    inner = c1 * c1 - 4 * c2 * c0
    if not inner > 0:
        return [_ratio(-c1, 2 * c2)]
    root = square_root(inner) if exact else sqrt(inner)
    sum_ = c1 - root if c1 < 0 else c1 + root
    return [_ratio(-sum_, 2 * c2), _ratio(-2 * c0, sum_)]


def misses(c: Sequence[Value], exact: bool) -> bool:
    """Whether a square has no root, not even one that rounding may have taken from it."""
    if len(c) < 3 or c[2] == 0:
        return False
    square = c[1] * c[1]
    return square - 4 * c[2] * c[0] < -square * (0 if exact else TOUCH)


def _ratio(a: Value, b: Value) -> Value:
    return a / b if b != 0 else nan
