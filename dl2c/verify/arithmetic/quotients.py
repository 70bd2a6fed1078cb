"""Comparisons of quotients without their divisors, where these are known to be positive.

A divisor counts as positive where it is a sum of products of symbols and numbers all of which are positive by
facts of the simplest form, such as `b > 0`. Both readings of undefined terms agree there.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

from dl2c.ir.logic import rewritten, substituted, subterms
from dl2c.ir.model import ZERO, Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring, TooLarge
from dl2c.verify.arithmetic.total import is_total

Quotient: TypeAlias = tuple[Polynomial, Polynomial]
"""Numerator and divisor."""


def positive_symbols(facts: Iterable[Formula]) -> set[Symbol]:
    """The symbols that some fact says are greater than zero, or at least a positive number."""
    found: set[Symbol] = set()
    for fact in facts:
        match fact:
            case Compare(">", Symbol() as s, Number(value)) | Compare("<", Number(value), Symbol() as s) if (
                value >= 0
            ):
                found.add(s)
            case Compare(">=", Symbol() as s, Number(value)) | Compare(
                "<=", Number(value), Symbol() as s
            ) if value > 0:
                found.add(s)
            case _:
                pass
    return found


def cleared(formula: Formula, positive: set[Symbol]) -> Formula:
    """The formula with every atom multiplied by its divisors, as far as these are known to be positive."""

    def atom(a: Compare) -> Formula:
        if not any(isinstance(t, Div) and not isinstance(t.right, Number) for t in subterms(a)):
            return a
        try:
            found = _Clearing(positive, a).result()
        except (NotPolynomial, TooLarge):
            return a
        return found if _partial_calls(a) <= _partial_calls(found) else a

    return rewritten(formula, atom)


def _partial_calls(formula: Formula) -> set[Term]:
    """The functions that may be undefined: a formula where they cancel each other says nothing of that."""
    return {t for t in subterms(formula) if isinstance(t, Call) and not is_total(t)}


@dataclass(slots=True)
class _Clearing:
    """One comparison; what is not a quotient of polynomials counts as a symbol."""

    positive: set[Symbol]
    atom: Compare
    stand_ins: dict[Term, Symbol] = field(default_factory=dict[Term, Symbol])
    ring: Ring = field(init=False)

    def __post_init__(self) -> None:
        for term in subterms(self.atom):
            if isinstance(term, Call):
                self.stand_ins.setdefault(term, Symbol(f"term {len(self.stand_ins)}", "variable"))
        found = {t for t in subterms(self.atom) if isinstance(t, Symbol)}
        ordered = sorted(found, key=lambda s: (s.name, s.kind))
        self.ring = Ring((*ordered, *self.stand_ins.values()))

    def result(self) -> Formula:
        """Raises `NotPolynomial` where a divisor is not known to be positive."""
        numerator, _ = self._quotient(Sub(self.atom.left, self.atom.right))
        term = self.ring.term(self.ring.primitive(numerator))
        return Compare(self.atom.op, self._restored(term), ZERO, span=self.atom.span)

    def _restored(self, term: Term) -> Term:
        return substituted(term, {symbol: t for t, symbol in self.stand_ins.items()})

    def _quotient(self, term: Term) -> Quotient:
        one = self.ring.number(1)
        match term:
            case Number() | Symbol():
                return self.ring.polynomial(term), one
            case Call():
                return self.ring.polynomial(self.stand_ins[term]), one
            case Neg(child):
                above, below = self._quotient(child)
                return -above, below
            case Add(left, right) | Sub(left, right):
                (a, b), (c, d) = self._quotient(left), self._quotient(right)
                c = c if isinstance(term, Add) else -c
                if b == d:
                    return a + c, b
                shared = b.gcd(d)
                return a * (d / shared) + c * (b / shared), b * (d / shared)
            case Mul(left, right):
                (a, b), (c, d) = self._quotient(left), self._quotient(right)
                return a * c, b * d
            case Pow(base, exponent):
                above, below = self._quotient(base)
                return above**exponent, below**exponent
            case Div(left, right):
                (a, b), (c, d) = self._quotient(left), self._quotient(right)
                self._check_positive(c)
                return a * d, b * c

    def _check_positive(self, divisor: Polynomial) -> None:
        """Every monomial is positive. Raises `NotPolynomial`."""
        for exponents, value in divisor.to_dict().items():
            if value <= 0 or any(
                e and s not in self.positive for s, e in zip(self.ring.symbols, exponents, strict=True)
            ):
                raise NotPolynomial("a divisor whose sign is not known")
        if divisor.is_zero():
            raise NotPolynomial("a divisor that is zero")
