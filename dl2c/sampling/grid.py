"""Names that are drawn on a grid, so that what linear equalities define from them is exact in doubles.

The definitions of a chart come in; the grid goes out: for each name that is drawn an exponent k, and it is
rounded to a multiple of 2^k. Sums of such multiples, and products with dyadic numbers, are exact as long as
they have at most 53 bits.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TypeAlias

from dl2c.interval.arithmetic import Box, Interval, evaluate, magnitude
from dl2c.ir.logic import symbols
from dl2c.ir.model import Add, Call, Compare, Div, Mul, Neg, Number, Sub, Symbol, Term
from dl2c.sampling.equalities.root_of import Definition, RootOf, names_of

Grid: TypeAlias = Mapping[Symbol, int]
"""Exponents: a name is a multiple of two to this power."""

BITS = 53
COARSEST = 16
"""Bits that the grid may have less than doubles of the largest size."""


def grid_of(
    definitions: Sequence[tuple[Symbol, Definition]], equalities: Sequence[Compare], box: Box
) -> Grid:
    """The finest grid on which all definitions are exact, and both sides of the equalities that they
    solve; empty where there is none."""
    defined = {s for s, _ in definitions}
    drawn = {s for _, t in definitions for s in names_of(t)} - defined
    largest = max((magnitude(box[s]).high for s in drawn | defined), default=math.inf)
    if not drawn or not math.isfinite(largest):
        return {}
    solved = [side for e in equalities if symbols(e) <= drawn | defined for side in (e.left, e.right)]
    finest = math.frexp(largest)[1] - (BITS - 2)
    for exponent in range(finest, finest + COARSEST):
        grid = dict.fromkeys(drawn, exponent)
        if all(_is_on(box[s], exponent) for s in drawn) and _is_exact(definitions, solved, grid, box):
            return grid
    return {}


def _is_exact(
    definitions: Sequence[tuple[Symbol, Definition]], solved: Sequence[Term], grid: Grid, box: Box
) -> bool:
    known = dict(grid)
    for symbol, term in definitions:
        exponent = None if isinstance(term, RootOf) else granule(term, known, box)
        if exponent is None:
            return False
        known[symbol] = exponent
    return all(granule(side, known, box) is not None for side in solved)


def _is_on(around: Interval, exponent: int) -> bool:
    """Whether a name that has only one value has it on the grid."""
    return around.low < around.high or math.fmod(around.low, math.ldexp(1.0, exponent)) == 0


def granule(term: Term, grid: Grid, box: Box) -> int | None:
    """An exponent of which the value in doubles is an exact multiple; None where it may be rounded."""
    match term:
        case Number(value):
            return _trailing(value)
        case Symbol():
            return grid.get(term)
        case Neg(child) | Call("abs", (child,)):
            return granule(child, grid, box)
        case Add(left, right) | Sub(left, right) | Mul(left, right):
            a, b = granule(left, grid, box), granule(right, grid, box)
            if a is None or b is None:
                return None
            return _fitting(term, a + b if isinstance(term, Mul) else min(a, b), box)
        case Div(left, Number(value)) if abs(value.numerator) == 1 or value.denominator == 1:
            a, below = granule(left, grid, box), _trailing(value)
            if a is None or below is None or abs(value) != Fraction(2) ** below:
                return None
            return _fitting(term, a - below, box)
        case _:
            return None


def _fitting(term: Term, exponent: int, box: Box) -> int | None:
    """The exponent, if multiples of that size are doubles."""
    around = evaluate(term, box)
    fits = not around.empty and magnitude(around).high <= math.ldexp(1.0, exponent + BITS)
    return exponent if fits and exponent > -1000 else None


def _trailing(value: Fraction) -> int | None:
    """The exponent of the largest power of two that divides a double."""
    if value.denominator & (value.denominator - 1) or abs(value.numerator) >= 2**BITS:
        return None
    above = value.numerator & -value.numerator
    return above.bit_length() - value.denominator.bit_length() if above else 0


def rounding(exponent: int) -> float:
    """Adding this number and subtracting it again rounds to the grid."""
    return math.ldexp(1.5, exponent + BITS - 1)
