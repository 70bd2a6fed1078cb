"""All zeros of polynomial margins along a piece of a flow, in exact arithmetic.

A margin is a polynomial on [0,1] by its Bernstein coefficients. No zero is missed and no two are merged.
"""

from collections.abc import Sequence
from fractions import Fraction
from math import comb
from typing import TypeAlias

from dl2c.flows.events import Crossing
from dl2c.flows.roots_exact import exact_zeros

Curve: TypeAlias = Sequence[Fraction]
"""Bernstein coefficients on [0,1], at least one."""


def curve_of(coefficients: Sequence[Fraction], length: Fraction) -> list[Fraction]:
    """Monomial c0 + c1*t + ... on [0, length] into Bernstein form on [0,1]."""
    degree = len(coefficients) - 1
    power = Fraction(1)
    b: list[Fraction] = []
    for k, c in enumerate(coefficients):
        b.append(c * power / comb(degree, k))
        power = power * length
    for k in range(degree, 0, -1):
        for i in range(k, degree + 1):
            b[i] = b[i] + b[i - 1]
    return b


def sign_after(curve: Curve) -> int:
    """The sign just after 0: that of the first coefficient that is not zero; 0 if all are."""
    return next((1 if b > 0 else -1 for b in curve if b != 0), 0)


def crossings(curves: Sequence[Curve], start: Sequence[int]) -> list[Crossing]:
    """All zeros of all curves in (0,1], sorted by `at` (then margin).

    `start` has the sign of each margin just after 0; 0 means that it stays zero.
    """
    found: list[Crossing] = []
    for margin, (curve, sign) in enumerate(zip(curves, start, strict=True)):
        found += [Crossing(at, margin, after) for at, after in exact_zeros(curve, sign)]
    return sorted(found, key=lambda c: (c.at, c.margin))
