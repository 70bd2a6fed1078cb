"""What a hidden value has no part in, kept whole while the value is eliminated.

An elimination multiplies sums out, and differences of close values, such as `x_post - x`, would be lost in
products of large ones. So sums and functions of known values get names before, and are put back
after: conditions stay short, and rounding decides more of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from typing import TypeAlias

from dl2c.ir.logic import always_defined, mapped, operands, substituted, symbols, with_operands
from dl2c.ir.model import Add, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term

Summand: TypeAlias = tuple[bool, Term]
"""Whether it is taken off, and the term."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Names of known terms, in formulas over `hidden` and other symbols."""

    hidden: frozenset[Symbol]
    names: dict[Term, Symbol] = field(default_factory=dict[Term, Symbol])

    def named(self, formula: Formula) -> Formula:
        """The formula with a name for each part that is not a product of symbols and numbers."""
        return mapped(formula, self._term)

    def put_back(self, formula: Formula) -> Formula:
        """The formula with the parts for their names."""
        parts: dict[Symbol, Term] = {symbol: term for term, symbol in self.names.items()}
        return mapped(formula, lambda term: substituted(term, parts))

    def _term(self, term: Term) -> Term:
        if not symbols(term) & self.hidden:
            return self._name(term)
        if not isinstance(term, Add | Sub | Neg):
            return with_operands(term, tuple(map(self._term, operands(term))))
        summands = list(_summands(term, False))
        known = [s for s in summands if not symbols(s[1]) & self.hidden]
        others = [(less, self._term(t)) for less, t in summands if symbols(t) & self.hidden]
        if not known:
            return _sum(others)
        turned = known[0][0]
        part = self._name(_sum([(less != turned, t) for less, t in known]))
        return _sum([(turned, part), *others])

    def _name(self, term: Term) -> Term:
        if _is_monomial(term) or not symbols(term) or not always_defined(term):
            return term
        return self.names.setdefault(term, Symbol(f"part {len(self.names)}", "variable"))


def _is_monomial(term: Term) -> bool:
    """Whether it is a product, of whose sign an elimination knows more than of a name's."""
    match term:
        case Number() | Symbol():
            return True
        case Neg() | Pow() | Mul():
            return all(map(_is_monomial, operands(term)))
        case _:
            return False


def _summands(term: Term, less: bool) -> Iterator[Summand]:
    match term:
        case Add(left, right) | Sub(left, right):
            yield from _summands(left, less)
            yield from _summands(right, less != isinstance(term, Sub))
        case Neg(child):
            yield from _summands(child, not less)
        case _:
            yield less, term


def _sum(summands: list[Summand]) -> Term:
    """What is added first."""
    (less, first), *rest = sorted(summands, key=lambda s: s[0])
    start = Neg(first) if less else first
    return reduce(lambda total, s: Sub(total, s[1]) if s[0] else Add(total, s[1]), rest, start)
