"""Doubles by number: neighbours, rounding to one side, and where a test begins to hold.

A test is a function of a double. The same operations in the same order as cgen/runtime/admissible.h.
"""

import math
import struct
from collections.abc import Callable
from fractions import Fraction

Passing = Callable[[float], bool]


def ordinal(value: float) -> int:
    """Doubles numbered in order: neighbours differ by one, both zeros are 0."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return bits if bits >= 0 else -(bits & (2**63 - 1))


def from_ordinal(number: int) -> float:
    (value,) = struct.unpack("<d", struct.pack("<q", abs(number)))
    return math.copysign(value, number)


def rounded_up(value: Fraction) -> float:
    """The least double that is not smaller."""
    near = float(value)
    return near if Fraction(near) >= value else math.nextafter(near, math.inf)


def rounded_down(value: Fraction) -> float:
    return -rounded_up(-value)


def outermost(test: Passing, start: float, middle: float, inner: float, outer: float) -> float | None:
    """The passing double nearest to the limit `outer`, searched from `start`.

    Where the start does not pass, a passing value is looked for on its inner side, up to `middle` if
    that passes, else to the limit `inner`, then on its outer side. Steps of 1, 2, 4, ... units in the
    last place bracket the end of the passing values, then bisection finds it. None if no tried value
    passes.
    """
    here = ordinal(start)
    if not test(start):
        failing, passing = bracket(test, here, ordinal(middle if test(middle) else inner), True)
        if passing is not None:
            return from_ordinal(bisected(test, passing, failing))
        _, passing = bracket(test, here, ordinal(outer), True)
        if passing is None:
            return None
        here = passing
    return from_ordinal(edge(test, here, ordinal(outer)))


def edge(test: Passing, here: int, limit: int) -> int:
    """The last passing double from a passing one towards a limit."""
    last, failing = bracket(test, here, limit, False)
    return last if failing is None else bisected(test, last, failing)


def bracket(test: Passing, here: int, limit: int, wanted: bool) -> tuple[int, int | None]:
    """Towards the limit: the last value tried before the test becomes `wanted`, the first where it is."""
    direction = 1 if limit > here else -1
    step = 1
    while here != limit:
        there = here + direction * min(step, abs(limit - here))
        if test(from_ordinal(there)) == wanted:
            return here, there
        here = there
        step *= 2
    return here, None


def bisected(test: Passing, inside: int, outside: int) -> int:
    """The passing double next to a failing one, between one of each."""
    while abs(inside - outside) > 1:
        distance = abs(inside - outside) // 2
        middle = outside + (distance if inside > outside else -distance)
        if test(from_ordinal(middle)):
            inside = middle
        else:
            outside = middle
    return inside
