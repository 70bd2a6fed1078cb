"""Intervals that hold whatever doubles the same operations compute from doubles inside.

cgen/runtime/hull.h operation for operation. Ends are finite; where a value between them may be
undefined or infinite both are NaN, for which no condition holds.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

from dl2c.ir.functions import FUNCTIONS as LIBRARY
from dl2c.ir.functions import greatest, least

Hull: TypeAlias = tuple[float, float]

TINY = 2.0**-1000
"""Smaller numbers count as zero."""

LIBM_ERROR = 2.0**-50
"""How far functions of libm may be off, relative to the result, or to 1 for sin and cos."""

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


def value(function: Callable[..., float], *args: float) -> float:
    """A function of libm as C has it: NaN or infinity instead of an exception."""
    try:
        return function(*args)
    except OverflowError:
        return math.inf
    except (ValueError, ZeroDivisionError):
        return math.nan


def sqrt(a: Hull) -> Hull:
    return hull_of(value(math.sqrt, a[0]), value(math.sqrt, a[1]))


def _grown(low: float, high: float) -> Hull:
    """What a growing function of libm gives at the ends."""
    return hull_of(low - (abs(low) * LIBM_ERROR + SMALLEST), high + (abs(high) * LIBM_ERROR + SMALLEST))


def rising(a: Hull, function: Callable[[float], float]) -> Hull:
    """Of a function of libm that grows."""
    return _grown(value(function, a[0]), value(function, a[1]))


def tan(a: Hull) -> Hull:
    if not (a[0] > -1.57 and a[1] < 1.57):
        return UNKNOWN
    return _grown(math.tan(a[0]), math.tan(a[1]))


def power(a: Hull, b: Hull) -> Hull:
    """A power of a positive base is monotone in the base and in the exponent."""
    if not a[0] > 0 or not math.isfinite(b[0]):
        return UNKNOWN
    low, high = _four(*(value(math.pow, x, y) for x in a for y in b))
    return _grown(low, high)


def _wave(a: Hull, function: Callable[[float], float]) -> Hull:
    """Sine and cosine change no faster than their argument: from the middle by half the width at most."""
    middle = a[0] + 0.5 * (a[1] - a[0])
    reach = greatest(middle - a[0], a[1] - middle) + LIBM_ERROR
    if reach >= 2:
        return -1.0, 1.0
    at_middle = value(function, middle)
    return hull_of(greatest(-1.0, at_middle - reach), least(1.0, at_middle + reach))


def sin(a: Hull) -> Hull:
    return _wave(a, math.sin)


def cos(a: Hull) -> Hull:
    return _wave(a, math.cos)


FUNCTIONS: dict[str, Callable[..., Hull]] = {
    "neg": neg, "add": add, "sub": sub, "mul": mul, "div": div, "square": square, "abs": absolute,
    "min": minimum, "max": maximum, "sqrt": sqrt, "sin": sin, "cos": cos, "tan": tan, "pow": power,
    **{n: partial(rising, function=row.value) for n, row in LIBRARY.items() if row.rising is not None},
}  # fmt: skip
"""By the names that operations have in dL."""
