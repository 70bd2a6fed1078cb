"""What the environment computes before the policy observes: dimensions of their own, beside the state's.

The program computes such a value with roundings. So the dimension is no further from the term than these can
lead, wherever the state is; exact judgement takes the value that the program computes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite

from dl2c.interval.arithmetic import Interval, enclosure, evaluate
from dl2c.ir.logic import conjunction
from dl2c.ir.model import Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.policy_proof.question import Arithmetic, NotCovered, Range
from dl2c.source import Span

ROUNDING: dict[Arithmetic, tuple[Fraction, Fraction]] = {
    "real": (Fraction(0), Fraction(0)),
    "double": (Fraction(1, 2**53), Fraction(1, 2**1074)),
    "float32": (Fraction(1, 2**24), Fraction(1, 2**126)),
}
"""Relative error of an operation, and absolute error of a small result."""

EXACT = ("abs", "min", "max")
"""Functions that do not round."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """The value of a term as the program has it: its range, and that it is close to the term."""

    symbol: Symbol
    term: Term
    range: Range
    close: Formula


def symbol_of(name: str) -> Symbol:
    """The dimension of an observed name. No dL name looks like it."""
    return Symbol(f"observed {name}", "input")


def dimension(
    name: str, term: Term, box: Mapping[Symbol, Range], arithmetic: Arithmetic, at: Span
) -> Dimension:
    """That of a term over the names of a box. Raises `NotCovered`."""
    around = {s: Interval(enclosure(low).low, enclosure(high).high) for s, (low, high) in box.items()}
    errors = _Errors(name, around, arithmetic, at)
    slack = _power_of_ten(errors.of(term))
    values, symbol = errors.range(term), symbol_of(name)
    low, high = Fraction(values.low) - slack, Fraction(values.high) + slack
    if slack == 0:
        return Dimension(symbol, term, (low, high), Compare("=", symbol, term))
    below, above = Sub(term, Number(slack)), Add(term, Number(slack))
    close = conjunction([Compare("<=", below, symbol), Compare("<=", symbol, above)])
    return Dimension(symbol, term, (low, high), close)


def _power_of_ten(value: Fraction) -> Fraction:
    """The next one that is not smaller; 0 for 0."""
    found = Fraction(1, 10**300)
    while 0 < found < value:
        found *= 10
    return found if value else value


@dataclass(frozen=True, slots=True)
class _Errors:
    """How far computed values may be from terms, wherever in a box."""

    name: str
    box: Mapping[Symbol, Interval]
    arithmetic: Arithmetic
    at: Span

    def range(self, term: Term) -> Interval:
        found = evaluate(term, self.box)
        if found.empty or not (isfinite(found.low) and isfinite(found.high)):
            raise self._refused("whose value has no bounds")
        return found

    def _refused(self, why: str) -> NotCovered:
        what = f"the policy observes `{self.name}`, which the environment computes first, {why}"
        return NotCovered(what, self.at)

    def of(self, term: Term) -> Fraction:
        """Raises `NotCovered`."""
        match term:
            case Symbol():
                return self._rounded(term, Fraction(0)) if self.arithmetic == "float32" else Fraction(0)
            case Number():
                return self._rounded(term, Fraction(0))
            case Neg(child) | Call("abs", (child,)):
                return self.of(child)
            case Call(("min" | "max"), (left, right)):
                return max(self.of(left), self.of(right))
            case Add(left, right) | Sub(left, right):
                return self._rounded(term, self.of(left) + self.of(right))
            case Mul(left, right):
                a, b = self.of(left), self.of(right)
                return self._rounded(term, self._most(left) * b + self._most(right) * a + a * b)
            case Div(left, right):
                return self._rounded(term, self._quotient(term, self.of(left), self.of(right)))
            case Pow(base, exponent):
                return self._power(base, exponent)
            case _:
                raise self._refused("with a function that is not computed exactly")

    def _most(self, term: Term) -> Fraction:
        values = self.range(term)
        return Fraction(max(abs(values.low), abs(values.high)))

    def _rounded(self, term: Term, error: Fraction) -> Fraction:
        unit, smallest = ROUNDING[self.arithmetic]
        return error + unit * (self._most(term) + error) + smallest

    def _quotient(self, term: Div, dividend: Fraction, divisor: Fraction) -> Fraction:
        values = self.range(term.right)
        least = Fraction(max(values.low, -values.high)) - divisor
        if least <= 0:
            raise self._refused("by a division, perhaps by 0")
        return (dividend + self._most(term) * divisor) / least

    def _power(self, base: Term, exponent: int) -> Fraction:
        """Of a product in any order."""
        unit, smallest = ROUNDING[self.arithmetic]
        most, error = self._most(base), self.of(base)
        computed = ((most + error) * (1 + unit)) ** exponent
        return computed - most**exponent + exponent * smallest * (1 + most + error) ** exponent
