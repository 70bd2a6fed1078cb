"""Polynomials over the rationals in the symbols of a differential equation; python-flint computes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import reduce
from math import gcd, lcm
from typing import Any, TypeAlias, assert_never

from flint import Ordering, fmpq, fmpq_mpoly_ctx, fmpz_mpoly_ctx, fmpz_mpoly_vec

from dl2c.ir.logic import number, plus, raised, times
from dl2c.ir.model import ZERO, Add, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term

Polynomial: TypeAlias = Any
"""An `fmpq_mpoly`: python-flint publishes no types."""

MAX_TERMS = 4000
"""Monomials of one polynomial."""

BASIS_LIMITS = (60, 400, 4000)
"""Of a Groebner basis: polynomials, their terms, bits of coefficients."""

MOST_BITS = 16000
"""Of coefficients of what is divided by a basis."""


class TooLarge(Exception):
    """A polynomial with too many monomials."""


class NotPolynomial(Exception):
    """A term with a function or a quotient."""


@dataclass(slots=True)
class Ring:
    """Polynomials in these symbols, the first of which are greatest."""

    symbols: tuple[Symbol, ...]
    ordering: str = "degrevlex"
    known: dict[Term, Polynomial] = field(default_factory=dict[Term, Polynomial])
    context: Any = None
    generators: dict[Symbol, Polynomial] = field(default_factory=dict[Symbol, Polynomial])

    def __post_init__(self) -> None:
        names = tuple(f"v{k}" for k in range(len(self.symbols)))
        self.context = fmpq_mpoly_ctx.get(names, getattr(Ordering, self.ordering))
        self.generators = dict(zip(self.symbols, self.context.gens(), strict=True))

    def number(self, value: Fraction | int) -> Polynomial:
        """A constant polynomial."""
        value = Fraction(value)
        return self.context.constant(fmpq(value.numerator, value.denominator))

    def polynomial(self, term: Term) -> Polynomial:
        """The polynomial of a term. Raises `NotPolynomial`, `TooLarge`."""
        if term not in self.known:
            found = self._polynomial(term)
            if len(found) > MAX_TERMS:
                raise TooLarge
            self.known[term] = found
        return self.known[term]

    def _polynomial(self, term: Term) -> Polynomial:
        match term:
            case Number(value):
                return self.number(value)
            case Symbol():
                if term not in self.generators:
                    raise NotPolynomial(term.name)
                return self.generators[term]
            case Neg(child):
                return -self.polynomial(child)
            case Add(left, right):
                return self.polynomial(left) + self.polynomial(right)
            case Sub(left, right):
                return self.polynomial(left) - self.polynomial(right)
            case Mul(left, right):
                return self._product(self.polynomial(left), self.polynomial(right))
            case Div(left, Number(value)) if value:
                return self.polynomial(left) * self.number(1 / value)
            case Pow(base, exponent):
                return reduce(self._product, [self.polynomial(base)] * exponent)
            case Div() | Call():
                raise NotPolynomial(str(term))
            case _:
                assert_never(term)

    def _product(self, a: Polynomial, b: Polynomial) -> Polynomial:
        if len(a) * len(b) > MAX_TERMS * 20:
            raise TooLarge
        return a * b

    def term(self, polynomial: Polynomial) -> Term:
        """The polynomial as a term, with integer coefficients where it is scaled to such."""
        parts: list[Term] = []
        for exponents, coefficient in polynomial.to_dict().items():
            factors = [raised(s, int(e)) for s, e in zip(self.symbols, exponents, strict=True) if e]
            value = number(Fraction(int(coefficient.p), int(coefficient.q)))
            parts.append(reduce(times, factors, value))
        return _sum(parts)

    def derivative(self, polynomial: Polynomial, rates: dict[Symbol, Polynomial]) -> Polynomial:
        """The Lie derivative along the rates of symbols. Raises `TooLarge`."""
        result = self.number(0)
        for symbol, rate in rates.items():
            partial = polynomial.derivative(self.symbols.index(symbol))
            if not partial.is_zero():
                result = result + self._product(partial, rate)
        if len(result) > MAX_TERMS:
            raise TooLarge
        return result

    def primitive(self, polynomial: Polynomial) -> Polynomial:
        """A positive multiple with coprime integer coefficients."""
        if polynomial.is_zero():
            return polynomial
        coefficients = [Fraction(int(c.p), int(c.q)) for c in polynomial.coeffs()]
        below = lcm(*(c.denominator for c in coefficients))
        above = gcd(*(int(c * below) for c in coefficients))
        return polynomial * self.number(Fraction(below, above))

    def in_ideal(self, polynomial: Polynomial, others: Sequence[Polynomial]) -> bool:
        """Whether a polynomial is known to be a combination of others; False where the basis is too large."""
        kept = [p for p in others if not p.is_zero()]
        if polynomial.is_zero():
            return True
        if not kept:
            return False
        names = self.context.names()
        integers = fmpz_mpoly_ctx.get(names, Ordering.degrevlex)
        ideal: Any = fmpz_mpoly_vec([self._integral(p, integers) for p in kept], integers)
        basis, complete = ideal.buchberger_naive(limits=BASIS_LIMITS)
        if not complete:
            return False
        rational = fmpq_mpoly_ctx.get(names, Ordering.degrevlex)
        members = [self._moved(p, rational) for p in basis]
        rest = reduced(self._moved(polynomial, rational), members)
        return rest is not None and rest.is_zero()

    def _integral(self, polynomial: Polynomial, context: Any) -> Any:
        whole = self.primitive(polynomial).to_dict()
        return context.from_dict({exponents: int(c.p) for exponents, c in whole.items()})

    def _moved(self, polynomial: Polynomial, context: Any) -> Polynomial:
        return context.from_dict(dict(polynomial.to_dict()))


def _sum(parts: Sequence[Term]) -> Term:
    """A sum that is not nested deeper than need be."""
    if len(parts) < 2:
        return parts[0] if parts else ZERO
    middle = len(parts) // 2
    return plus(_sum(parts[:middle]), _sum(parts[middle:]))


def reduced(polynomial: Polynomial, divisors: Iterable[Polynomial]) -> Polynomial | None:
    """What is left of a polynomial after division by others, one after the other until none divides; None
    where numbers or terms become too many on the way.
    """
    divisors = [d for d in divisors if not d.is_zero()]
    changed = True
    while changed and not polynomial.is_zero():
        changed = False
        for divisor in divisors:
            _, rest = divmod(polynomial, divisor)
            if rest != polynomial:
                polynomial, changed = rest, True
                if len(rest) > MAX_TERMS or _bits(rest) > MOST_BITS:
                    return None
    return polynomial


def _bits(polynomial: Polynomial) -> int:
    """Of the longest numerator or denominator."""
    return max((n.bit_length() for c in polynomial.coeffs() for n in (int(c.p), int(c.q))), default=0)
