"""What is watched along the flows of a step beside their domains (semantics 6).

A @safety predicate must hold at every instant at which a step may end: along a flow after which
its run executes nothing; along every flow where that is asked for. The obligation `D -> P` of a
@progress predicate P fails at the first such instant at which D holds, unless P held before, or
holds then.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from dl2c.ir.liveness import parts_of, statements
from dl2c.ir.logic import conjunction, negation, operands, rewritten
from dl2c.ir.margins import fraction, times
from dl2c.ir.model import (
    FALSE,
    TRUE,
    ZERO,
    Block,
    Bound,
    Choice,
    Compare,
    Div,
    Evolve,
    Formula,
    If,
    Model,
    Mul,
    Number,
    Pow,
    Repeat,
    Statement,
    Symbol,
    Term,
    While,
)
from dl2c.ir.slack import least_slack

SMALLEST = Fraction(1, 10**300)
"""A product of doubles that is larger does not round to zero."""


@dataclass(frozen=True, slots=True)
class Watch:
    """One condition: `stays` is watched until it fails.

    For a safety predicate that is its violation, and `cuts` says that the flow ends there. For
    an obligation D -> P `stays` is "neither D nor P"; where that fails, it was met if P (`goal`)
    holds, else it failed if D (`due`) does.

    A flow that keeps to `plainly` all along and ends in `at_end` changes nothing: the watch does not
    fail, and whether it was met does not matter. `slacks` are the terms that its symbols of kind "start"
    stand for.
    """

    predicate: int
    kind: Literal["safety", "obligation"]
    stays: Formula
    due: Formula
    goal: Formula
    plainly: Formula
    at_end: Formula
    cuts: bool
    slacks: tuple[tuple[Symbol, Term], ...] = ()


def watches_of(model: Model) -> tuple[Watch, ...]:
    """All watches of a model, in the order of its predicates."""
    last = not model.lead and flows_come_last(model.body)
    found: list[Watch] = []
    least = _least_constants(model)
    for k, predicate in enumerate(model.predicates):
        along = predicate.relaxed if predicate.along is None else predicate.along
        relaxed = _guarded(along, least)
        if predicate.category == "safety" and model.continuous:
            trigger = predicate.on_failure
            cuts = trigger is not None and trigger.action != "continue"
            plain = predicate.formula if predicate.along is None else least_slack(along, model.tolerance)
            plainly = _guarded(plain, least)
            found.append(Watch(k, "safety", relaxed, TRUE, FALSE, plainly, TRUE, cuts, predicate.slacks))
        elif predicate.category == "progress" and predicate.due is not None and predicate.due != TRUE:
            due, early = (_guarded(f, least) for f in (predicate.due, negation(predicate.due)))
            stays = conjunction([early, _guarded(negation(along), least)])
            plainly, at_end = (early, negation(predicate.due)) if last else (stays, TRUE)
            slacks = predicate.slacks
            found.append(Watch(k, "obligation", stays, due, relaxed, plainly, at_end, False, slacks))
    return tuple(found)


def watches_along(model: Model, flow: int) -> tuple[Watch, ...]:
    """The same as far as this flow is concerned: after a flow with which no run ends they never fail."""
    found = watches_of(model)
    if model.everywhere or flow in set(last_flows(model.body)):
        return found
    return tuple(replace(w, stays=TRUE, due=FALSE, goal=FALSE, plainly=TRUE, at_end=TRUE) for w in found)


def surely_positive(model: Model) -> Callable[[Term], bool]:
    """Whether a term is positive whatever the state, as a product of constants may be."""
    least = _least_constants(model)
    return lambda term: _least(term, least) >= SMALLEST


def _least_constants(model: Model) -> dict[str, Fraction]:
    return {c.name: _smallest(c.bound, c.value) for c in model.constants}


def _guarded(formula: Formula, least: Mapping[str, Fraction]) -> Formula:
    """The formula without divisors that are surely positive; others may be zero, which is excluded
    beside their atom.
    """

    def positive(term: Term) -> bool:
        return _least(term, least) >= SMALLEST

    def guarded(atom: Compare) -> Formula:
        (a, b), (c, d) = fraction(atom.left, positive), fraction(atom.right, positive)
        cleared = Compare(atom.op, times(a, d), times(c, b), span=atom.span)
        divisors = dict.fromkeys((*_divisors(cleared.left), *_divisors(cleared.right)))
        return conjunction([*(Compare("!=", t, ZERO) for t in divisors if not positive(t)), cleared])

    return rewritten(formula, guarded)


def _divisors(term: Term) -> Iterator[Term]:
    for part in operands(term):
        yield from _divisors(part)
    if isinstance(term, Div):
        yield term.right


def _least(term: Term, least: Mapping[str, Fraction]) -> Fraction:
    """A lower limit of a term that is surely positive, from those of the constants; else 0."""
    match term:
        case Number(value):
            return max(value, Fraction(0))
        case Symbol(name, "constant"):
            return least[name]
        case Pow(base, exponent):
            return _least(base, least) ** exponent
        case Mul(left, right):
            return _least(left, least) * _least(right, least)
        case _:
            return Fraction(0)


def _smallest(bound: Bound, value: Fraction | None) -> Fraction:
    """The least value of a constant that is surely positive; else 0."""
    return max(Fraction(0), value if value is not None else bound.low or Fraction(0))


def flows_come_last(block: Block) -> bool:
    """Whether nothing follows a flow in any run: an obligation that is not due when it ends is not judged."""
    return not any(_flows(s) for s in block[:-1]) and all(
        flows_come_last(part * 2 if isinstance(s, While | Repeat) else part)
        for s in block[-1:]
        for part in parts_of(s)
    )


def last_flows(block: Block) -> Iterator[int]:
    """The flows after which some run of the block executes nothing, not even a test."""
    match block[-1] if block else None:
        case Evolve(flow):
            yield flow
        case If(_, _, then, orelse):
            yield from (*last_flows(then), *last_flows(orelse))
        case Choice(_, alternatives):
            yield from (k for a in alternatives for k in last_flows(a.body))
        case Repeat(body=body):
            yield from last_flows(body)
        case _:
            pass


def _flows(statement: Statement) -> bool:
    return any(isinstance(s, Evolve) for s in statements((statement,)))
