"""Polynomials with rational coefficients, independently of dl2c: products of roots, Sturm sequences."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import comb

Rational = int | Fraction


def from_roots(roots: Sequence[Rational], scale: Rational = 1) -> list[Fraction]:
    """c0, c1, ... of scale * (s - r0) * (s - r1) * ..."""
    c = [Fraction(scale)]
    for r in roots:
        c = [a - r * b for a, b in zip([Fraction(0), *c], [*c, Fraction(0)], strict=True)]
    return c


def bernstein(c: Sequence[Fraction]) -> list[Fraction]:
    """Bernstein coefficients on [0,1] from c0, c1, ..., by the definition."""
    d = len(c) - 1
    return [
        sum((Fraction(comb(i, k), comb(d, k)) * c[k] for k in range(i + 1)), Fraction(0))
        for i in range(d + 1)
    ]


def at(b: Sequence[Rational | float], s: Fraction) -> Fraction:
    """The value of a Bernstein curve, by the definition."""
    d = len(b) - 1
    return sum((Fraction(x) * comb(d, i) * s**i * (1 - s) ** (d - i) for i, x in enumerate(b)), Fraction(0))


def sign(value: Rational) -> int:
    return (value > 0) - (value < 0)


def monomial(b: Sequence[Rational | float]) -> list[Fraction]:
    """c0, c1, ... by expanding every Bernstein polynomial."""
    d = len(b) - 1
    c = [Fraction(0)] * (d + 1)
    for i, x in enumerate(b):
        for j in range(d - i + 1):
            c[i + j] += Fraction(x) * comb(d, i) * comb(d - i, j) * (-1) ** j
    return c


def value(c: Sequence[Fraction], s: Fraction) -> Fraction:
    return sum((x * s**k for k, x in enumerate(c)), Fraction(0))


def sturm(c: Sequence[Fraction]) -> list[list[Fraction]]:
    """The Sturm sequence of a polynomial that is not zero."""
    chain = [_trimmed(c), _trimmed([k * x for k, x in enumerate(c)][1:])]
    while chain[-1]:
        rest, q = list(chain[-2]), chain[-1]
        while len(rest) >= len(q):
            factor, shift = rest[-1] / q[-1], len(rest) - len(q)
            rest = _trimmed(
                [x - factor * (q[k - shift] if k >= shift else 0) for k, x in enumerate(rest)][:-1]
            )
        chain.append([-x / abs(rest[-1]) for x in rest])
    return chain[:-1]


def count(chain: Sequence[Sequence[Fraction]], low: Fraction, high: Fraction) -> int:
    """How many different zeros are in (low, high), whose ends are no multiple zeros."""
    return _changes(chain, low) - _changes(chain, high)


def _changes(chain: Sequence[Sequence[Fraction]], s: Fraction) -> int:
    signs = [x for x in (sign(value(c, s)) for c in chain) if x]
    return sum(x != y for x, y in pairwise(signs))


def _trimmed(c: Sequence[Fraction]) -> list[Fraction]:
    n = len(c)
    while n and c[n - 1] == 0:
        n -= 1
    return list(c[:n])
