"""What is watched along the flows of a step beside their domains (semantics 6).

A @safety predicate must hold at every instant of a flow, where safety is checked
continuously. The obligation `D -> P` of a @progress predicate P fails at the first instant
at which D holds, unless P held before, or holds then.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from dl2c.ir.logic import conjunction, disjunction, negation, operands
from dl2c.ir.model import (
    FALSE,
    TRUE,
    ZERO,
    And,
    Bound,
    Compare,
    Div,
    Formula,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Symbol,
    Term,
    Truth,
)

SMALLEST = Fraction(1, 10**300)
"""A product of doubles that is larger does not round to zero."""


@dataclass(frozen=True, slots=True)
class Watch:
    """One condition: `stays` is watched until it fails.

    For a safety predicate that is its violation, and `cuts` says that the flow ends there. For
    an obligation D -> P `stays` is "neither D nor P"; where that fails, it was met if P (`goal`)
    holds, else it failed if D (`due`) does. `plainly` is a simpler condition that implies `stays`.
    """

    predicate: int
    kind: Literal["safety", "obligation"]
    stays: Formula
    due: Formula
    goal: Formula
    plainly: Formula
    cuts: bool


def watches_of(model: Model) -> tuple[Watch, ...]:
    """All watches of a model, in the order of its predicates."""
    found: list[Watch] = []
    least = {c.name: _distance(c.bound, c.value) for c in model.constants}
    for k, predicate in enumerate(model.predicates):
        exact, relaxed = (_guarded(f, least) for f in (predicate.formula, predicate.relaxed))
        if predicate.category == "safety" and model.continuous:
            trigger = predicate.on_failure
            cuts = trigger is not None and trigger.action != "continue"
            found.append(Watch(k, "safety", relaxed, TRUE, FALSE, exact, cuts))
        elif predicate.category == "progress" and predicate.due is not None and predicate.due != TRUE:
            due = _guarded(predicate.due, least)
            plainly = conjunction(_guarded(negation(f), least) for f in (predicate.due, predicate.relaxed))
            found.append(Watch(k, "obligation", plainly, due, relaxed, plainly, False))
    return tuple(found)


def _guarded(formula: Formula, least: Mapping[str, Fraction]) -> Formula:
    """The formula with every divisor that may be zero, also a constant one, excluded beside its atom."""
    match formula:
        case Truth():
            return formula
        case Compare(_, left, right):
            divisors = [d for side in (left, right) for d in _divisors(side) if _least(d, least) < SMALLEST]
            return conjunction([*(Compare("!=", d, ZERO) for d in dict.fromkeys(divisors)), formula])
        case And(children):
            return conjunction(_guarded(c, least) for c in children)
        case Or(children):
            return disjunction(_guarded(c, least) for c in children)


def _divisors(term: Term) -> Iterator[Term]:
    for part in operands(term):
        yield from _divisors(part)
    if isinstance(term, Div):
        yield term.right


def _least(term: Term, least: Mapping[str, Fraction]) -> Fraction:
    """A lower limit of the magnitude of a term, from those of the constants."""
    match term:
        case Number(value):
            return abs(value)
        case Symbol(name, "constant"):
            return least[name]
        case Neg(child):
            return _least(child, least)
        case Pow(base, exponent):
            return _least(base, least) ** exponent
        case Mul(left, right):
            return _least(left, least) * _least(right, least)
        case _:
            return Fraction(0)


def _distance(bound: Bound, value: Fraction | None) -> Fraction:
    """How far from zero a constant is at least."""
    if value is not None:
        return abs(value)
    low, high = bound.low, bound.high
    return max(Fraction(0), Fraction(0) if low is None else low, Fraction(0) if high is None else -high)
