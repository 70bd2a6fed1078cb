"""Intervals that hold whatever doubles the same operations compute from doubles inside.

cgen/runtime/hull.h operation for operation. Ends are finite; where a value between them may be
undefined or infinite both are NaN, for which no condition holds.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

from dl2c.ir.functions import FUNCTIONS as LIBRARY
from dl2c.ir.functions import SLOP, TINY, Function, greatest, least, libm

Hull: TypeAlias = tuple[float, float]

UNKNOWN: Hull = (math.nan, math.nan)
SMALLEST = 2.0**-1022


def hull_of(low: float, high: float) -> Hull:
    """Between two values, if they are finite."""
    return (low, high) if math.isfinite(high - low) else UNKNOWN


def out(a: Hull) -> Hull:
    """Ends that were rounded once, moved outwards by more than that."""
    return a[0] - (abs(a[0]) * 2.0**-52 + TINY), a[1] + (abs(a[1]) * 2.0**-52 + TINY)


def neg(a: Hull) -> Hull:
    return -a[1], -a[0]


def add(a: Hull, b: Hull) -> Hull:
    return hull_of(a[0] + b[0], a[1] + b[1])


def sub(a: Hull, b: Hull) -> Hull:
    return hull_of(a[0] - b[1], a[1] - b[0])


def _four(a: float, b: float, c: float, d: float) -> Hull:
    """Between the least and the largest of four values."""
    if not math.isfinite(a + b + c + d):
        return UNKNOWN
    return hull_of(least(least(a, b), least(c, d)), greatest(greatest(a, b), greatest(c, d)))


def mul(a: Hull, b: Hull) -> Hull:
    return _four(a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])


def div(a: Hull, b: Hull) -> Hull:
    if not (b[0] > 0 or b[1] < 0):
        return UNKNOWN
    return _four(a[0] / b[0], a[0] / b[1], a[1] / b[0], a[1] / b[1])


def absolute(a: Hull) -> Hull:
    low = a[0] if a[0] > 0 else -a[1] if a[1] < 0 else 0.0
    return hull_of(low, greatest(-a[0], a[1]))


def square(a: Hull) -> Hull:
    low, high = absolute(a)
    return hull_of(low * low, high * high)


def minimum(a: Hull, b: Hull) -> Hull:
    return (least(a[0], b[0]), least(a[1], b[1])) if math.isfinite(a[0] + b[0]) else UNKNOWN


def maximum(a: Hull, b: Hull) -> Hull:
    return (greatest(a[0], b[0]), greatest(a[1], b[1])) if math.isfinite(a[0] + b[0]) else UNKNOWN


def sqrt(a: Hull) -> Hull:
    return hull_of(libm(math.sqrt, a[0]), libm(math.sqrt, a[1]))


def _widened(low: float, high: float) -> Hull:
    """Around values of libm."""
    return hull_of(low - (abs(low) * SLOP + SMALLEST), high + (abs(high) * SLOP + SMALLEST))


def power(a: Hull, b: Hull) -> Hull:
    """A power of a positive base is monotone in the base and in the exponent."""
    if not a[0] > 0 or not math.isfinite(b[0]):
        return UNKNOWN
    low, high = _four(*(libm(math.pow, x, y) for x in a for y in b))
    return _widened(low, high)


def _wave(a: Hull, function: Callable[[float], float]) -> Hull:
    """Sine and cosine change no faster than their argument: from the middle by half the width at most."""
    middle = a[0] + 0.5 * (a[1] - a[0])
    reach = greatest(middle - a[0], a[1] - middle) + SLOP
    if reach >= 2:
        return -1.0, 1.0
    at_middle = libm(function, middle)
    return hull_of(greatest(-1.0, at_middle - reach), least(1.0, at_middle + reach))


def _of_library(a: Hull, row: Function) -> Hull:
    if row.crest is not None:
        return _wave(a, row.value)
    assert row.ends is not None
    if row.has_poles and not (a[0] > -1.57 and a[1] < 1.57):
        return UNKNOWN
    return _widened(*row.ends(*a))


FUNCTIONS: dict[str, Callable[..., Hull]] = {
    **{name: partial(_of_library, row=row) for name, row in LIBRARY.items()},
    "neg": neg, "add": add, "sub": sub, "mul": mul, "div": div, "square": square, "abs": absolute,
    "min": minimum, "max": maximum, "sqrt": sqrt, "pow": power,
}  # fmt: skip
"""By the names that operations have in dL."""
