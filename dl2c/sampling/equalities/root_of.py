"""A name that an equality of higher degree determines: where a polynomial of it changes its sign.

The equality and a box come in; its roots along the name go out, one for each time that the sign may change
there. Roots at which it does not change are singular points of the solutions, or where two roots meet.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from typing import TypeAlias

from dl2c.interval.arithmetic import Box, Interval, evaluate
from dl2c.ir.logic import plus, symbols, times
from dl2c.ir.model import Add, Number, Sub, Symbol, Term
from dl2c.ir.normal import Normal, derivative, powers
from dl2c.paths.zeros import MAX_DEGREE
from dl2c.sampling.equalities.algebra import term_of

WIDER = 2.0**-40
"""By how much of its size each end of a box is moved out: a root at an end counts."""


@dataclass(frozen=True, slots=True)
class RootOf:
    """Where `coefficients[0] + coefficients[1]*symbol + ...` changes its sign for the `number`-th time
    from `low` to `high`, the first being 0; nowhere if it does so less often."""

    symbol: Symbol
    coefficients: tuple[Term, ...]
    low: float
    high: float
    number: int

    def polynomial(self, at: Term) -> Term:
        """Its value there (Horner)."""
        *lower, leading = self.coefficients
        return reduce(lambda value, c: plus(times(value, at), c), reversed(lower), leading)

    def around(self, reach: float) -> tuple[Term, Term]:
        """Its values so far before and after the symbol."""
        far = Number(Fraction(reach))
        return self.polynomial(Sub(self.symbol, far)), self.polynomial(Add(self.symbol, far))


Definition: TypeAlias = Term | RootOf
"""What a name is, given others."""


def names_of(definition: Definition) -> frozenset[Symbol]:
    """The others."""
    if not isinstance(definition, RootOf):
        return frozenset(symbols(definition))
    return frozenset(s for c in definition.coefficients for s in symbols(c))


def with_terms(definition: Definition, change: Callable[[Term], Term]) -> Definition:
    """The definition with its terms changed."""
    if not isinstance(definition, RootOf):
        return change(definition)
    return replace(definition, coefficients=tuple(map(change, definition.coefficients)))


def has_roots(degree: int, symbol: Symbol, box: Box) -> bool:
    """Whether roots of this degree can be looked for between the ends of the box."""
    return 2 < degree <= MAX_DEGREE and _is_finite(box, symbol)


def _is_finite(box: Box, symbol: Symbol) -> bool:
    return max(abs(box[symbol].low), abs(box[symbol].high)) <= 1e100


def roots_of(form: Normal, symbol: Symbol, box: Box) -> Iterator[RootOf]:
    """Every place along the symbol where the polynomial may change its sign."""
    by_power = powers(form, symbol)
    coefficients = tuple(term_of(by_power.get(k, {})) for k in range(max(by_power) + 1))
    around = box[symbol]
    reach = WIDER * max(1.0, abs(around.low), abs(around.high))
    wider = Interval(around.low - reach, around.high + reach)
    for number in range(_most(form, symbol, {**box, symbol: wider})):
        yield RootOf(symbol, coefficients, wider.low, wider.high, number)


def _most(form: Normal, symbol: Symbol, box: Box) -> int:
    """As often at most: where its k-th derivative has no zero, a function has at most k (Rolle)."""
    degree = max(powers(form, symbol))
    for k in range(1, degree):
        form = derivative(form, symbol)
        if not evaluate(term_of(form), box).contains(0.0):
            return k
    return degree
