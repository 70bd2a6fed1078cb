"""Polynomials of degree at most 2 in one symbol, and arithmetic of their coefficients.

Coefficients are polynomials in normal form; what has too many monomials raises `TooLarge`.
"""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import isqrt

from dl2c.ir.normal import MAX_TERMS, Normal, added, multiplied, scaled
from dl2c.quantifiers.signs import TooLarge


@dataclass(frozen=True, slots=True)
class Quadratic:
    """c0 + c1*x + c2*x^2 over the other symbols."""

    c0: Normal
    c1: Normal
    c2: Normal

    @property
    def is_constant(self) -> bool:
        return not self.c1 and not self.c2

    @property
    def discriminant(self) -> Normal:
        return minus(times(self.c1, self.c1), times(number(4), self.c0, self.c2))

    @property
    def derivative(self) -> "Quadratic":
        return Quadratic(self.c1, times(number(2), self.c2), {})

    @property
    def mirrored(self) -> "Quadratic":
        return replace(self, c1=times(number(-1), self.c1))


def number(value: int | Fraction) -> Normal:
    """A constant polynomial."""
    return {(): Fraction(value)} if value else {}


def times(*factors: Normal) -> Normal:
    """Their product."""
    result: Normal | None = number(1)
    for factor in factors:
        result = multiplied(result, factor)
    return present(result)


def plus(a: Normal, b: Normal) -> Normal:
    """a + b."""
    return present(added(a, b))


def minus(a: Normal, b: Normal) -> Normal:
    """a - b."""
    return present(added(a, scaled(b, Fraction(-1))))


def present(form: Normal | None) -> Normal:
    """The polynomial, if it is one."""
    if form is None:
        raise TooLarge(f"polynomials of more than {MAX_TERMS} monomials")
    return form


def root_of(form: Normal) -> Normal | None:
    """A polynomial of at most one monomial whose square this is."""
    if not form:
        return form
    if len(form) != 1:
        return None
    monomial, factor = next(iter(form.items()))
    above, below = isqrt(max(factor.numerator, 0)), isqrt(factor.denominator)
    if Fraction(above**2, below**2) != factor or any(e % 2 for _, _, e in monomial):
        return None
    return {tuple((k, n, e // 2) for k, n, e in monomial): Fraction(above, below)}
