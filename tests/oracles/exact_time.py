"""Polynomials of one unknown, mostly time, with rational coefficients: what motion is made of.

A polynomial either stands for its values at all instants of [0, until], or is a germ: what is known of a
function just after instant 0, the coefficients beyond `order` cut off. Signs are decided by Sturm sequences,
those of germs by the first coefficient that is not zero. No part of the package is used.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import isqrt
from typing import Union

from oracles.exact_numbers import Unclear, Undefined
from oracles.sturm import count, sign, sturm, value

Coefficients = tuple[Fraction, ...]
Point = Callable[[Sequence[Fraction]], int]
"""A number, as the signs that polynomials have there."""
Number = Union["Poly", Fraction, int]

ZERO = Fraction(0)


@dataclass(frozen=True, slots=True)
class Poly:
    """c0 + c1*t + ...; a germ if `order` is not 0."""

    c: Coefficients
    order: int = 0
    until: Fraction | None = None

    def _with(self, c: Sequence[Fraction]) -> "Poly":
        return replace(self, c=trimmed(c[: self.order + 1] if self.order else c))

    def _lifted(self, other: object) -> "Poly":
        if isinstance(other, Poly):
            return other
        if isinstance(other, int | Fraction):
            return self._with((Fraction(other),))
        raise Unclear("an interval among polynomials")

    def __add__(self, other: Number) -> "Poly":
        a, b = self.c, self._lifted(other).c
        return self._with(
            [
                (a[k] if k < len(a) else ZERO) + (b[k] if k < len(b) else ZERO)
                for k in range(max(len(a), len(b)))
            ]
        )

    __radd__ = __add__

    def __neg__(self) -> "Poly":
        return self._with([-x for x in self.c])

    def __sub__(self, other: Number) -> "Poly":
        return self + -self._lifted(other)

    def __rsub__(self, other: Number) -> "Poly":
        return self._lifted(other) - self

    def __mul__(self, other: Number) -> "Poly":
        return self._with(product(self.c, self._lifted(other).c))

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> "Poly":
        divisor = self._lifted(other)
        if not divisor.c and not self.order:
            raise Undefined("division by zero")
        if len(divisor.c) == 1 and not self.order:
            return self._with([x / divisor.c[0] for x in self.c])
        if self.order and divisor.c and divisor.c[0] != 0:
            return self * divisor._inverse()
        raise Unclear("a quotient that is no polynomial")

    def __rtruediv__(self, other: Number) -> "Poly":
        return self._lifted(other) / self

    def _inverse(self) -> "Poly":
        """1 over a germ that is not zero at 0."""
        found = [1 / self.c[0]]
        for n in range(1, self.order + 1):
            known = sum((self.c[k] * found[n - k] for k in range(1, min(n, len(self.c) - 1) + 1)), ZERO)
            found.append(-known / self.c[0])
        return self._with(found)

    def sign(self) -> int:
        """1 or -1 where it has no value of the other sign, 0 where it is zero. Raises `Unclear`."""
        if self.order:
            first = next((x for x in self.c if x), None)
            if first is None:
                raise Unclear("a germ whose known part is zero")
            return sign(first)
        if len(self.c) <= 1:
            return sign(self.c[0]) if self.c else 0
        if self.until is None:
            raise Unclear("the sign of a polynomial, nobody knows where")
        signs = {point(self.c) for point in points([self.c], ZERO, self.until)}
        if {1, -1} <= signs:
            raise Unclear("a change of sign")
        return max(signs, key=abs)

    def __abs__(self) -> "Poly":
        return -self if self.sign() < 0 else self

    def __lt__(self, other: Number) -> bool:
        return (self - other).sign() < 0

    def __gt__(self, other: Number) -> bool:
        return (self - other).sign() > 0

    def at(self, t: Fraction) -> Fraction:
        return value(self.c, t)

    def integral(self) -> "Poly":
        return self._with([ZERO, *(x / (k + 1) for k, x in enumerate(self.c))])

    def derivative(self) -> "Poly":
        return self._with(slope(self.c))

    def root(self) -> "Poly":
        """The square root, where that is a polynomial and of one sign. Raises `Unclear`, `Undefined`."""
        if not self.c:
            return self
        if self.order or len(self.c) % 2 == 0 or (top := square_root(self.c[-1])) is None:
            raise Unclear("a root that is no polynomial")
        half = (len(self.c) - 1) // 2
        found = [ZERO] * half + [top]
        for k in range(half - 1, -1, -1):
            found[k] = (self.c[k + half] - product(found, found)[k + half]) / (2 * top)
        if trimmed(product(found, found)) != self.c:
            raise Unclear("a root that is no polynomial")
        return abs(self._with(found))


def trimmed(c: Sequence[Fraction]) -> Coefficients:
    n = len(c)
    while n and c[n - 1] == 0:
        n -= 1
    return tuple(c[:n])


def product(a: Sequence[Fraction], b: Sequence[Fraction]) -> list[Fraction]:
    found = [ZERO] * max(len(a) + len(b) - 1, 0)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] += x * y
    return found


def slope(c: Sequence[Fraction]) -> Coefficients:
    return trimmed([k * x for k, x in enumerate(c)][1:])


def square_root(a: Fraction) -> Fraction | None:
    """Exact, else None."""
    if a < 0:
        return None
    up, down = isqrt(a.numerator), isqrt(a.denominator)
    return Fraction(up, down) if up * up == a.numerator and down * down == a.denominator else None


def remainder(a: Sequence[Fraction], b: Sequence[Fraction]) -> tuple[Coefficients, Coefficients]:
    """Quotient and remainder of a division."""
    rest, found = list(trimmed(a)), [ZERO] * max(len(a) - len(b) + 1, 0)
    while len(rest) >= len(b):
        factor, shift = rest[-1] / b[-1], len(rest) - len(b)
        found[shift] = factor
        rest = list(trimmed([x - factor * b[k - shift] if k >= shift else x for k, x in enumerate(rest)]))
    return trimmed(found), tuple(rest)


def common(a: Sequence[Fraction], b: Sequence[Fraction]) -> Coefficients:
    """The greatest common divisor, with leading coefficient 1."""
    a, b = trimmed(a), trimmed(b)
    while b:
        a, b = b, remainder(a, b)[1]
    return tuple(x / a[-1] for x in a)


def squarefree(c: Sequence[Fraction]) -> Coefficients:
    """A polynomial with the same zeros, all of them simple."""
    shared = common(c, slope(c))
    return remainder(c, shared)[0] if len(shared) > 1 else trimmed(c)


def isolated(c: Coefficients, low: Fraction, high: Fraction) -> list[tuple[Fraction, Fraction]]:
    """The zeros of a squarefree polynomial inside (low, high), each alone in its interval. It is not zero at
    the ends of one, or else low = high is the zero.
    """
    chain = sturm(c)
    found: list[tuple[Fraction, Fraction]] = []
    todo = [(low, high)]
    while todo:
        a, b = todo.pop()
        inside = count(chain, a, b) - (value(c, b) == 0)
        if inside == 1 and value(c, a) and value(c, b):
            found.append((a, b))
        elif inside:
            middle = (a + b) / 2
            if value(c, middle) == 0:
                found.append((middle, middle))
            todo += [(middle, b), (a, middle)]
    return sorted(found)


def points(polynomials: Sequence[Sequence[Fraction]], low: Fraction, high: Fraction) -> Iterator[Point]:
    """Numbers of [low, high] such that every combination of signs that occurs there occurs at one of them."""
    yield _rational(low)
    if low == high:
        return
    whole: Coefficients = (Fraction(1),)
    for c in polynomials:
        if len(c := trimmed(c)) > 1:
            whole = squarefree(tuple(product(whole, remainder(c, common(c, whole))[0])))
    zeros = isolated(whole, low, high) if len(whole) > 1 else []
    ends = [(low, low), *zeros, (high, high)]
    for (_, before), (after, _) in pairwise(ends):
        yield _rational((before + after) / 2)
    for a, b in zeros:
        yield _rational(a) if a == b else _irrational(whole, a, b)
    yield _rational(high)


def _rational(t: Fraction) -> Point:
    return lambda c: sign(value(c, t))


def _irrational(whole: Coefficients, a: Fraction, b: Fraction) -> Point:
    """The zero of a polynomial in (a, b)."""

    def signs(c: Sequence[Fraction]) -> int:
        c = trimmed(c)
        if len(c) <= 1:
            return sign(c[0]) if c else 0
        shared = common(c, whole)
        if len(shared) > 1 and _changes(shared, a, b):
            return 0
        rest, low, high = squarefree(c), a, b
        chain = sturm(rest)
        while count(chain, low, high) or value(rest, low) == 0:
            middle = (low + high) / 2
            if value(whole, middle) == 0:
                return sign(value(c, middle))
            low, high = (low, middle) if _changes(whole, low, middle) else (middle, high)
        return sign(value(c, low))

    return signs


def _changes(c: Sequence[Fraction], a: Fraction, b: Fraction) -> bool:
    return sign(value(c, a)) * sign(value(c, b)) < 0
