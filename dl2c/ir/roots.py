"""All zeros of margins along a piece of a flow, and when a formula first fails.

A margin is a polynomial on [0,1] by its Bernstein coefficients, all doubles or all rationals.
In doubles the results are those of cgen/runtime/roots.h, which says what is certain, to the
last bit; in rationals no zero is missed and no two are merged.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from typing import TypeAlias

from dl2c.ir.evaluate import Value, literal
from dl2c.ir.roots_exact import exact_zeros
from dl2c.ir.roots_float import float_zeros

MAX_DEGREE = 24

Curve: TypeAlias = Sequence[Value]
"""Bernstein coefficients on [0,1], finite, at least one and at most `MAX_DEGREE` + 1."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A place in (0,1] where a margin is zero: its sign is 0 at `at` and `after` just after."""

    at: Value
    margin: int
    after: int


@dataclass(frozen=True, slots=True)
class Exit:
    """Where a formula first fails, with the signs at and just after that place; at 1 if it does not.

    With `holds` it is still true at `at` and fails just after.
    """

    found: bool
    holds: bool
    at: Value
    sign_at: tuple[int, ...]
    sign_after: tuple[int, ...]


def curve_of(coefficients: Sequence[Value], length: Value) -> list[Value]:
    """Monomial c0 + c1*t + ... on [0, length] into Bernstein form on [0,1]."""
    degree = len(coefficients) - 1
    power = literal(Fraction(1), isinstance(length, Fraction))
    b: list[Value] = []
    for k, c in enumerate(coefficients):
        b.append(c * power / comb(degree, k))
        power = power * length
    for k in range(degree, 0, -1):
        for i in range(k, degree + 1):
            b[i] = b[i] + b[i - 1]
    return b


def curve_at(curve: Curve, s: Value) -> Value:
    """The value at s in [0,1]."""
    b = list(curve)
    for k in range(len(b) - 1, 0, -1):
        for i in range(k):
            b[i] = b[i] * (1 - s) + b[i + 1] * s
    return b[0]


def sign_after(curve: Curve) -> int:
    """The sign just after 0: that of the first coefficient that is not zero; 0 if all are."""
    return next((1 if b > 0 else -1 for b in curve if b != 0), 0)


def crossings(curves: Sequence[Curve], start: Sequence[int]) -> list[Crossing]:
    """All zeros of all curves in (0,1], sorted by `at` (then margin).

    `start` has the sign of each margin just after 0; 0 means that it stays zero.
    """
    found: list[Crossing] = []
    for margin, (curve, sign) in enumerate(zip(curves, start, strict=True)):
        assert 1 <= len(curve) <= MAX_DEGREE + 1
        found += [Crossing(at, margin, after) for at, after in _zeros(curve, sign)]
    return sorted(found, key=lambda c: (c.at, c.margin))


def _zeros(curve: Curve, start: int) -> Sequence[tuple[Value, int]]:
    if isinstance(curve[0], float):
        return float_zeros([float(b) for b in curve], start)
    return exact_zeros([Fraction(b) for b in curve], start)


def first_exit(
    crossed: Sequence[Crossing],
    at0: Sequence[int],
    start: Sequence[int],
    holds: Callable[[Sequence[int]], bool],
    exact: bool = False,
) -> Exit:
    """When a formula that (normally) holds first fails.

    at0: signs at 0; start: signs just after 0; `holds` evaluates the formula on signs. What comes
    just after 1 is not looked at.
    """
    zero, one = literal(Fraction(0), exact), literal(Fraction(1), exact)
    now, after = tuple(at0), tuple(start)
    if not holds(now):
        return Exit(True, False, zero, now, after)
    if not holds(after):
        return Exit(True, True, zero, now, after)
    k = 0
    while k < len(crossed):
        at = crossed[k].at
        on, beyond = list(after), list(after)
        while k < len(crossed) and crossed[k].at == at:
            on[crossed[k].margin] = 0
            beyond[crossed[k].margin] = crossed[k].after
            k += 1
        now, after = tuple(on), tuple(beyond)
        if not holds(now):
            return Exit(True, False, at, now, after)
        if at == 1:
            return Exit(False, True, at, now, after)
        if not holds(after):
            return Exit(True, True, at, now, after)
    return Exit(False, True, one, after, after)
