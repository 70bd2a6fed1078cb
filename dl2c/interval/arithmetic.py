"""Outward-rounded interval arithmetic over IEEE doubles.

IR terms and a box (an interval for every symbol) come in; an enclosure of every real
value that the term takes on the box goes out. Partial operations never fail: they
enclose the values they have and report whether some or all points have none.
Assumes that libm is within four units in the last place; `+ - * / sqrt` need nothing,
their endpoints are the exact bounds rounded once.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias, assert_never

from dl2c.interval.rounding import (
    INF,
    MAX,
    add_down,
    add_up,
    div_down,
    div_up,
    mul_down,
    mul_up,
    power_down,
    power_up,
    root_down,
    root_up,
    sqrt_down,
    sqrt_up,
)
from dl2c.ir.functions import FUNCTIONS, libm
from dl2c.ir.logic import COMPARISONS, fold
from dl2c.ir.model import (
    Add,
    Binary,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
)

LIBM_ULPS = 4
LARGEST_ANGLE = 1e6
"""Beyond this the periodic functions are enclosed by their whole range."""


class Interval(NamedTuple):
    """All reals from `low` to `high`; infinite endpoints stand for no limit.

    `total` tells whether the enclosed term is defined on the whole box. `low > high`
    holds no number: the term is defined nowhere.
    """

    low: float
    high: float
    total: bool = True

    @property
    def empty(self) -> bool:
        return self.low > self.high

    def contains(self, value: float | Fraction) -> bool:
        return self.low <= value <= self.high


EMPTY = Interval(INF, -INF, False)
WHOLE = Interval(-INF, INF)
UNIT = Interval(-1.0, 1.0)

Box: TypeAlias = Mapping[Symbol, Interval]
Verdict: TypeAlias = Literal["true", "false", "unknown"]


def evaluate(term: Term, box: Box) -> Interval:
    """An enclosure of the term's real values over the box, which has every symbol of the term."""
    match term:
        case Number(value):
            return enclosure(value)
        case Symbol():
            return box[term]
        case Neg(child):
            return negated(evaluate(child, box))
        case Mul(left, right) if left == right:
            return power(evaluate(left, box), 2)
        case Binary():
            return OPERATIONS[type(term)](evaluate(term.left, box), evaluate(term.right, box))
        case Pow(child, exponent):
            return power(evaluate(child, box), exponent)
        case Call(function, args):
            return applied(function, tuple(evaluate(a, box) for a in args))
        case _:
            assert_never(term)


def truth(formula: Formula, box: Box) -> Verdict:
    """Whether the formula holds everywhere on the box, nowhere, or neither is proved.

    An atom with an undefined subterm is false.
    """

    def decided(atom: Compare) -> Verdict:
        left, right = atom.left, atom.right
        if isinstance(left, Number) and isinstance(right, Number):
            return "true" if COMPARISONS[atom.op](left.value, right.value) else "false"
        return compared(atom.op, evaluate(left, box), evaluate(right, box))

    return fold(formula, lambda value: "true" if value else "false", decided, _all, _any)


def _all(verdicts: Iterable[Verdict]) -> Verdict:
    found = set(verdicts)
    return "false" if "false" in found else "unknown" if "unknown" in found else "true"


def _any(verdicts: Iterable[Verdict]) -> Verdict:
    found = set(verdicts)
    return "true" if "true" in found else "unknown" if "unknown" in found else "false"


def compared(op: Comparison, a: Interval, b: Interval) -> Verdict:
    """Whether `op` holds between all, no or some values of two terms."""
    if a.empty or b.empty:
        return "false"
    always, never = _decided(op, a, b)
    return "false" if never else "true" if always and a.total and b.total else "unknown"


def _decided(op: Comparison, a: Interval, b: Interval) -> tuple[bool, bool]:
    """Whether `op` holds for all pairs of values, and whether for none."""
    match op:
        case "<":
            return a.high < b.low, a.low >= b.high
        case "<=":
            return a.high <= b.low, a.low > b.high
        case ">" | ">=":
            return _decided("<" if op == ">" else "<=", b, a)
        case "=":
            return a.low == a.high == b.low == b.high, a.low > b.high or a.high < b.low
        case "!=":
            always, never = _decided("=", a, b)
            return never, always
        case _:
            assert_never(op)


# Sets and numbers -------------------------------------------------------------------------


@lru_cache(maxsize=4096)
def enclosure(value: Fraction) -> Interval:
    """The tightest interval around an exact number."""
    try:
        nearest = float(value)
    except OverflowError:
        return Interval(MAX, INF) if value > 0 else Interval(-INF, -MAX)
    low = nearest if nearest <= value else math.nextafter(nearest, -INF)
    high = nearest if nearest >= value else math.nextafter(nearest, INF)
    return Interval(low, high)


def meet(a: Interval, b: Interval) -> Interval:
    """What both hold; total where both are."""
    low = a.low if a.low >= b.low else b.low
    high = a.high if a.high <= b.high else b.high
    return Interval(low, high, a.total and b.total)


def hull_of(pieces: Iterable[Interval]) -> Interval:
    """The smallest interval around all; total where all are."""
    around = Interval(INF, -INF)
    for p in pieces:
        around = Interval(min(around.low, p.low), max(around.high, p.high), around.total and p.total)
    return around


# Operations on intervals ------------------------------------------------------


def negated(a: Interval) -> Interval:
    return Interval(-a.high, -a.low, a.total)


def plus(a: Interval, b: Interval) -> Interval:
    if a.empty or b.empty:
        return EMPTY
    return Interval(add_down(a.low, b.low), add_up(a.high, b.high), a.total and b.total)


def minus(a: Interval, b: Interval) -> Interval:
    return plus(a, negated(b))


def times(a: Interval, b: Interval) -> Interval:
    if a.empty or b.empty:
        return EMPTY
    total = a.total and b.total
    if a.low >= 0 and b.low >= 0:
        return Interval(mul_down(a.low, b.low), mul_up(a.high, b.high), total)
    corners = ((a.low, b.low), (a.low, b.high), (a.high, b.low), (a.high, b.high))
    products = [x * y for x, y in corners]
    least, most = min(products), max(products)
    if not -INF < least <= most < INF or any(map(math.isnan, products)):
        return Interval(min(mul_down(x, y) for x, y in corners), max(mul_up(x, y) for x, y in corners), total)
    return Interval(
        min(mul_down(x, y) for (x, y), p in zip(corners, products, strict=True) if p == least),
        max(mul_up(x, y) for (x, y), p in zip(corners, products, strict=True) if p == most),
        total,
    )


def quotients(a: Interval, b: Interval) -> tuple[Interval, ...]:
    """What a / b can be: one piece for the positive and one for the negative denominators."""
    pieces: list[Interval] = []
    if b.high > 0:
        pieces.append(_over_positive(a, max(b.low, 0.0), b.high))
    if b.low < 0:
        pieces.append(negated(_over_positive(a, max(-b.high, 0.0), -b.low)))
    return tuple(pieces)


def _over_positive(a: Interval, low: float, high: float) -> Interval:
    return Interval(
        div_down(a.low, high if a.low >= 0 else low),
        div_up(a.high, low if a.high >= 0 else high),
    )


def quotient(a: Interval, b: Interval) -> Interval:
    pieces = () if a.empty or b.empty else quotients(a, b)
    if not pieces:
        return EMPTY
    around = hull_of(pieces)
    return Interval(around.low, around.high, a.total and b.total and not b.contains(0.0))


OPERATIONS: Mapping[type[Binary], Callable[[Interval, Interval], Interval]] = {
    Add: plus,
    Sub: minus,
    Mul: times,
    Div: quotient,
}


def power(a: Interval, n: int) -> Interval:
    """a to a positive integer power."""
    assert n > 0
    if a.empty:
        return EMPTY
    if n % 2 == 0:
        m = magnitude(a)
        return Interval(power_down(m.low, n), power_up(m.high, n), a.total)
    low = power_down(a.low, n) if a.low >= 0 else -power_up(-a.low, n)
    high = power_up(a.high, n) if a.high >= 0 else -power_down(-a.high, n)
    return Interval(low, high, a.total)


def root(a: Interval, n: int) -> Interval:
    """An enclosure of the n-th roots of a's nonnegative part, which is not empty."""
    low, high = max(a.low, 0.0), a.high
    return Interval(root_down(low, n), root_up(high, n))


def magnitude(a: Interval) -> Interval:
    """The absolute values of a nonempty interval."""
    high = max(abs(a.low), abs(a.high))
    return Interval(0.0 if a.contains(0.0) else min(abs(a.low), abs(a.high)), high, a.total)


def applied(name: str, args: tuple[Interval, ...]) -> Interval:
    """An enclosure of a function's values."""
    if any(a.empty for a in args):
        return EMPTY
    a, b = args[0], args[-1]
    match name:
        case "abs":
            return magnitude(a)
        case "min":
            return Interval(min(a.low, b.low), min(a.high, b.high), a.total and b.total)
        case "max":
            return Interval(max(a.low, b.low), max(a.high, b.high), a.total and b.total)
        case "sqrt":
            if a.high < 0:
                return EMPTY
            return Interval(sqrt_down(max(a.low, 0.0)), sqrt_up(a.high), a.total and a.low >= 0)
        case "pow":
            return _real_power(a, b)
        case _:
            return _of_library(name, a)


def _padded(low: float, high: float, total: bool) -> Interval:
    """Values of libm, widened by its error."""
    below = low if math.isinf(low) else low - (LIBM_ULPS + 1) * math.ulp(low)
    above = high if math.isinf(high) else high + (LIBM_ULPS + 1) * math.ulp(high)
    return Interval(MAX if below == INF else below, above, total)


def _of_library(name: str, a: Interval) -> Interval:
    """Of a function of libm, from its values on what lies in its domain."""
    row = FUNCTIONS[name]
    if row.crest is not None:
        return _wave(row.value, row.crest, a)
    assert row.ends is not None
    if row.has_poles and _hits(math.pi / 2, math.pi, a):
        return Interval(-INF, INF, False)
    inside = meet(a, Interval(*row.among))
    if inside.empty:
        return EMPTY
    low, high = row.ends(inside.low, inside.high)
    return meet(_padded(low, high, a.total and inside == a), Interval(*row.between))


def _wave(function: Callable[[float], float], crest: float, a: Interval) -> Interval:
    """sin or cos, whose maxima lie at `crest` and every full turn from there."""
    if max(-a.low, a.high) > LARGEST_ANGLE:
        return Interval(-1.0, 1.0, a.total)
    ends = (function(a.low), function(a.high))
    low = -1.0 if _hits(crest + math.pi, math.tau, a) else min(ends)
    high = 1.0 if _hits(crest, math.tau, a) else max(ends)
    return meet(_padded(low, high, a.total), UNIT)


def _hits(phase: float, period: float, a: Interval) -> bool:
    """Whether a may contain `phase` plus a whole number of periods."""
    if max(-a.low, a.high) > LARGEST_ANGLE:
        return True
    margin = 1e-9
    return math.floor((a.high - phase) / period + margin) >= math.ceil((a.low - phase) / period - margin)


def _real_power(a: Interval, b: Interval) -> Interval:
    """exp(b * log(a)) where a > 0, extended to a = 0 where b > 0."""
    if a.low < 0 or (a.low == 0 and b.low <= 0):
        return Interval(-INF, INF, False)
    corners = [libm(math.pow, x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    return meet(_padded(min(corners), max(corners), a.total and b.total), Interval(0.0, INF))
