"""Zeros of one Bernstein curve with rational coefficients, exactly.

Multiple zeros are made simple first, so that halving always separates them (Descartes).
A zero is returned exactly where its interval contains a short rational that is a zero, otherwise
as the low end of an interval of relative width 2^-80 at most. The result depends on the zero, not
on the curve.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import comb

BITS = 80
"""Intervals that hold a zero become shorter than 2^-BITS of their high end."""

AT_ONCE = Fraction(1, 2**1074)
"""The zero that stands for a change of sign right after 0."""

Polynomial = list[Fraction]
"""Coefficients c0, c1, ... of powers, without trailing zeros; the zero polynomial is empty."""

Interval = tuple[Fraction, Fraction]
"""An open interval with one zero inside and none at its ends; or the zero itself, as both ends."""


def exact_zeros(curve: Sequence[Fraction], start: int) -> list[tuple[Fraction, int]]:
    """Zeros in (0,1] in order, each with the sign just after it. `start` is the sign just after 0."""
    p = _monomial(curve)
    if start == 0 or not p:
        return []
    first = next(1 if c > 0 else -1 for c in p if c != 0)
    found = [(AT_ONCE, first)] if first != start else []
    if all(first * b > 0 for b in curve):
        return found
    simple = _quotient(p, _divisor(p, _derivative(p)))
    if simple[0] == 0:
        del simple[0]
    places = [_narrowed(simple, i) for i in _isolated(simple, Fraction(0), Fraction(1))]
    for k, (low, high) in enumerate(places):
        beyond = places[k + 1][0] if k + 1 < len(places) else Fraction(1)
        after = _sign(p, (high + beyond) / 2) if high < 1 else _sign_after_end(p, high == low)
        found.append((low, after))
    return found


def _sign_after_end(p: Polynomial, zero: bool) -> int:
    """The sign at 1. If 1 is a zero, the sign just after it: that of the first nonzero derivative."""
    while zero and _value(p, Fraction(1)) == 0:
        p = _derivative(p)
    return _sign(p, Fraction(1))


def _isolated(p: Polynomial, low: Fraction, high: Fraction) -> list[Interval]:
    """Intervals of all zeros in (low, high] of a polynomial with simple zeros, in order."""
    b = _bernstein(p, low, high)
    ending = [(high, high)] if b[-1] == 0 else []
    signs = [x > 0 for x in b if x != 0]
    variations = sum(x != y for x, y in pairwise(signs))
    if variations == 0:
        return ending
    if variations == 1 and b[0] != 0 and not ending:
        return [(low, high)]
    middle = (low + high) / 2
    return [*_isolated(p, low, middle), *_isolated(p, middle, high)]


def _narrowed(p: Polynomial, interval: Interval) -> Interval:
    """The interval halved until it is short, or the zero itself."""
    low, high = interval
    if low == high:
        return interval
    before = _sign(p, low)
    while high - low > high / 2**BITS:
        middle = (low + high) / 2
        sign = _sign(p, middle)
        if sign == 0:
            return middle, middle
        low, high = (middle, high) if sign == before else (low, middle)
    guess = simplest(low, high)
    return (guess, guess) if _value(p, guess) == 0 else (low, high)


def simplest(low: Fraction, high: Fraction) -> Fraction:
    """The rational of the smallest denominator in [low, high], 0 <= low <= high."""
    whole = -(-low.numerator // low.denominator)
    if whole <= high:
        return Fraction(whole)
    return whole - 1 + 1 / simplest(1 / (high - whole + 1), 1 / (low - whole + 1))


def _monomial(curve: Sequence[Fraction]) -> Polynomial:
    """Coefficients of powers from Bernstein coefficients on [0,1]: differences times binomials."""
    b, degree = list(curve), len(curve) - 1
    for k in range(1, degree + 1):
        for i in range(degree, k - 1, -1):
            b[i] -= b[i - 1]
    return _trimmed([x * comb(degree, k) for k, x in enumerate(b)])


def _bernstein(p: Polynomial, low: Fraction, high: Fraction) -> list[Fraction]:
    """Bernstein coefficients on [low, high]."""
    b, degree = list(p), len(p) - 1
    for k in range(degree):
        for i in range(degree - 1, k - 1, -1):
            b[i] += low * b[i + 1]
    b = [x * (high - low) ** k / comb(degree, k) for k, x in enumerate(b)]
    for k in range(degree, 0, -1):
        for i in range(k, degree + 1):
            b[i] += b[i - 1]
    return b


def _value(p: Polynomial, s: Fraction) -> Fraction:
    value = Fraction(0)
    for c in reversed(p):
        value = value * s + c
    return value


def _sign(p: Polynomial, s: Fraction) -> int:
    value = _value(p, s)
    return (value > 0) - (value < 0)


def _derivative(p: Polynomial) -> Polynomial:
    return [k * c for k, c in enumerate(p)][1:]


def _divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    """The greatest common divisor, with leading coefficient 1."""
    while q:
        q = [c / q[-1] for c in q]
        p, q = q, _divided(p, q)[1]
    return [c / p[-1] for c in p]


def _quotient(p: Polynomial, q: Polynomial) -> Polynomial:
    return _divided(p, q)[0]


def _divided(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder."""
    rest, quotient = list(p), [Fraction(0)] * (len(p) - len(q) + 1)
    for k in reversed(range(len(quotient))):
        quotient[k] = rest[k + len(q) - 1] / q[-1]
        for i, c in enumerate(q):
            rest[k + i] -= quotient[k] * c
    return quotient, _trimmed(rest[: len(q) - 1])


def _trimmed(p: Polynomial) -> Polynomial:
    while p and p[-1] == 0:
        p.pop()
    return p
