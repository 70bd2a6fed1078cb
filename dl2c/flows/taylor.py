"""Taylor models of quantities along a stretch of motion: cgen/runtime/taylor.h operation for operation.

A model is a polynomial of degree 4 in the time u from -1 to 1, and a bound of how far the quantity is
from it (taylor.h says what is certain).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from dl2c.flows import hull
from dl2c.flows.hull import UNKNOWN, Hull
from dl2c.ir.functions import FUNCTIONS as LIBRARY
from dl2c.ir.functions import SLOP, TINY, geometric_rest

ORDER = 4
LACKS_DIGITS = 1
"""Rounding decides whether the quantity has a value: shorter stretches do not help."""
LACKS_VALUE = 2
"""It has no value anywhere on the stretch."""
FINE = 8.0
"""An error is that of rounding where it is at most so many times as large."""
ROUND_UP = 1.0 + 2.0**-49
"""Sums of bounds are rounded up by this factor."""

ZEROS = (0.0,) * (ORDER + 1)
INF = math.inf


@dataclass(frozen=True, slots=True)
class Taylor:
    """The polynomial's coefficients `c`; `r` bounds how far it is from the quantity, and `e` is what
    rounding has in that; `hull` holds the quantity too. `lacks` are flags."""

    c: tuple[float, ...]
    r: float
    e: float
    hull: Hull
    lacks: int = 0

    @property
    def spread(self) -> float:
        """How far the polynomial goes from its middle, without the middle."""
        c = self.c
        return abs(c[1]) + abs(c[2]) + abs(c[3]) + abs(c[4])

    @property
    def size(self) -> float:
        """The largest value that the polynomial may have."""
        return abs(self.c[0]) + self.spread

    @property
    def deviation(self) -> float:
        """The largest deviation of the quantity from its middle."""
        return (self.spread + self.r) * ROUND_UP

    def at(self, u: float) -> float:
        c = self.c
        return (((c[4] * u + c[3]) * u + c[2]) * u + c[1]) * u + c[0]


def number(a: float) -> Taylor:
    """A number known exactly."""
    off, lacks = (0.0, 0) if math.isfinite(a) else (INF, LACKS_VALUE)
    return Taylor((a, 0.0, 0.0, 0.0, 0.0), off, off, hull.hull_of(a, a), lacks)


def of_polynomial(b: Sequence[float], end: float, middle: float, half: float) -> Taylor:
    """Along the stretch [middle - half, middle + half] of b[0] + b[1]*s + ..., which is `end` at s = 1."""
    b = list(b)
    degree = len(b) - 1
    if all(c == 0 for c in b[1:]) and end == b[0]:
        return number(b[0])
    reach = middle + half
    size, last = abs(b[degree]), b[degree]
    for i in range(degree - 1, -1, -1):
        size = size * reach + abs(b[i])
        last = last + b[i]
    for i in range(degree):
        for j in range(degree - 1, i - 1, -1):
            b[j] += middle * b[j + 1]
    c = [b[0], 0.0, 0.0, 0.0, 0.0]
    r, power = 0.0, half
    for i in range(1, degree + 1):
        term = b[i] * power
        if i <= ORDER:
            c[i] = term
        else:
            r += abs(term)
        power *= half
    e = (degree + 1) * size * SLOP
    if reach >= 1:
        e += abs(end - last)
    made = Taylor(tuple(c), (r + e) * ROUND_UP, e, UNKNOWN)
    beyond = made.spread + made.r
    return replace(made, hull=hull.out(hull.hull_of(c[0] - beyond, c[0] + beyond)))


def neg(a: Taylor) -> Taylor:
    return replace(a, c=tuple(-c for c in a.c), hull=hull.neg(a.hull))


def _summed(c: Sequence[float], a: Taylor, b: Taylor, enclosed: Hull) -> Taylor:
    """A sum with what rounding adds to it."""
    made = Taylor(tuple(c), 0.0, 0.0, hull.out(enclosed), a.lacks | b.lacks)
    slop = made.size * SLOP + TINY
    return replace(made, r=(a.r + b.r + slop) * ROUND_UP, e=(a.e + b.e + slop) * ROUND_UP)


def add(a: Taylor, b: Taylor) -> Taylor:
    return _summed([x + y for x, y in zip(a.c, b.c, strict=True)], a, b, hull.add(a.hull, b.hull))


def sub(a: Taylor, b: Taylor) -> Taylor:
    return _summed([x - y for x, y in zip(a.c, b.c, strict=True)], a, b, hull.sub(a.hull, b.hull))


def _product(a: Taylor, b: Taylor, enclosed: Hull = UNKNOWN) -> Taylor:
    c = [0.0] * (ORDER + 1)
    over = 0.0
    for i in range(ORDER + 1):
        for j in range(ORDER + 1):
            term = a.c[i] * b.c[j]
            if i + j <= ORDER:
                c[i + j] += term
            else:
                over += abs(term)
    first, second = a.size, b.size
    slop = first * second * SLOP + TINY
    r = (over + first * b.r + a.r * (second + b.r) + slop) * ROUND_UP
    e = (first * b.e + a.e * (second + b.e) + slop) * ROUND_UP
    return Taylor(tuple(c), r, e, hull.out(enclosed), a.lacks | b.lacks)


def mul(a: Taylor, b: Taylor) -> Taylor:
    return _product(a, b, hull.mul(a.hull, b.hull))


def square(a: Taylor) -> Taylor:
    return _product(a, a, hull.square(a.hull))


def _known(a: Taylor) -> Taylor:
    """With infinite bounds where they are not numbers."""
    return a if math.isfinite(a.r) else replace(a, r=INF, e=INF)


def unknown(lacks: int, enclosed: Hull) -> Taylor:
    """Known by its hull alone."""
    return Taylor(ZEROS, INF, INF, hull.out(enclosed), lacks)


def _lacks(a: Taylor, some: bool = True) -> int:
    """What a function of a model lacks that does not have a value for all numbers near it; `some`: it may
    have one on the stretch."""
    rounding = math.isfinite(a.r) and a.spread <= a.r and a.r <= FINE * a.e
    return a.lacks | (LACKS_DIGITS if rounding else 0) | (0 if some else LACKS_VALUE)


def compose(a: Taylor, f: Sequence[float], tail: float, noise: float, enclosed: Hull) -> Taylor:
    """A function by its Taylor polynomial `f` about the model's middle, which leaves out `tail`; its
    coefficients are off by `noise`."""
    rest = replace(a, c=(0.0, *a.c[1:]))
    t = Taylor((f[ORDER], 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, UNKNOWN)
    for k in range(ORDER - 1, -1, -1):
        t = _product(t, rest)
        t = replace(t, c=(t.c[0] + f[k], *t.c[1:]))
    rounding = (16.0 * abs(f[0]) + t.size) * SLOP
    slop = rounding + noise + TINY
    r, e = (t.r + tail + slop) * ROUND_UP, (t.e + slop) * ROUND_UP
    return _known(replace(t, r=r, e=e, hull=hull.out(enclosed)))


def _inverse(a: Taylor) -> Taylor:
    enclosed = hull.div((1.0, 1.0), a.hull)
    middle = a.c[0]
    if not abs(middle) > TINY:
        return unknown(_lacks(a), enclosed)
    q = a.deviation / abs(middle)
    if not q < 0.999:
        return unknown(_lacks(a), enclosed)
    f = [1.0 / middle]
    for _ in range(ORDER):
        f.append(-f[-1] / middle)
    return compose(a, f, abs(f[0]) * geometric_rest(q), 0.0, enclosed)


def div(a: Taylor, b: Taylor) -> Taylor:
    return _known(replace(_product(a, _inverse(b)), hull=hull.out(hull.div(a.hull, b.hull))))


def absolute(a: Taylor) -> Taylor:
    if a.hull[0] >= 0:
        return a
    return neg(a) if a.hull[1] <= 0 else unknown(a.lacks, hull.absolute(a.hull))


def minimum(a: Taylor, b: Taylor) -> Taylor:
    if a.hull[1] < b.hull[0]:
        return a
    return b if b.hull[1] < a.hull[0] else unknown(a.lacks | b.lacks, hull.minimum(a.hull, b.hull))


def maximum(a: Taylor, b: Taylor) -> Taylor:
    if a.hull[0] > b.hull[1]:
        return a
    return b if b.hull[0] > a.hull[1] else unknown(a.lacks | b.lacks, hull.maximum(a.hull, b.hull))


def of_library(a: Taylor, name: str) -> Taylor:
    """A function by the series of its row."""
    row, enclosed = LIBRARY[name], hull.FUNCTIONS[name](a.hull)
    assert row.series is not None
    series = row.series(a.c[0], a.deviation)
    if series is None:
        return unknown(_lacks(a, not (a.hull[0] > row.among[1] or a.hull[1] < row.among[0])), enclosed)
    return compose(a, *series, enclosed)


def tan(a: Taylor) -> Taylor:
    quotient = div(of_library(a, "sin"), of_library(a, "cos"))
    return replace(quotient, hull=hull.out(hull.FUNCTIONS["tan"](a.hull)))


def _log(a: Taylor) -> Taylor:
    lacks = _lacks(a, not a.hull[1] <= 0)
    middle = a.c[0]
    if not middle > TINY:
        return unknown(lacks, UNKNOWN)
    q = a.deviation / middle
    if not q < 0.999:
        return unknown(lacks, UNKNOWN)
    f = [math.log(middle)]
    power = 1.0 / middle
    for k in range(1, ORDER + 1):
        f.append(power / k)
        power = -power / middle
    return compose(a, f, 0.2 * geometric_rest(q), 16.0 * SLOP, UNKNOWN)


def power(a: Taylor, b: Taylor) -> Taylor:
    """A power of a positive base."""
    found = of_library(_product(b, _log(a)), "exp")
    return replace(found, hull=hull.out(hull.power(a.hull, b.hull)))


def sign(a: Taylor) -> int:
    """The sign that the quantity has all along; 0 if it may have several."""
    if a.hull[0] > 0:
        return 1
    if a.hull[1] < 0:
        return -1
    side = -1.0 if a.c[0] < 0 else 1.0
    slope = abs(a.c[1])
    bend = side * a.c[2]
    if bend > 0 and slope < 2.0 * bend:
        lowest = side * a.c[0] - slope * slope / (4.0 * bend)
    else:
        lowest = side * a.c[0] - slope + bend
    rest = abs(a.c[3]) + abs(a.c[4]) + a.r
    slop = a.size * SLOP
    return int(side) if lowest > rest + slop else 0


FUNCTIONS: dict[str, Callable[..., Taylor]] = {
    **{name: partial(of_library, name=name) for name, row in LIBRARY.items() if row.series is not None},
    "neg": neg, "add": add, "sub": sub, "mul": mul, "div": div, "square": square, "abs": absolute,
    "min": minimum, "max": maximum, "tan": tan, "pow": power,
}  # fmt: skip
"""By the names that operations have in dL."""
