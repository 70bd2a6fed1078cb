"""Boxes that enclosures leave open: a question for Z3 about polynomials.

On such a box the policy's outputs lie between two linear functions of the state, found with all rounding
errors. No more of the network is needed: if no state of the box with any outputs between them violates
the claim, the policy does not.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

from dl2c.interval.rounding import add_up
from dl2c.ir.logic import conjunction, subterms
from dl2c.ir.model import Add, Call, Compare, Formula, Mul, Number, Sub, Term
from dl2c.native.boxes import Doubles, Judge
from dl2c.policy_proof.question import Case, Premise, Question
from dl2c.policy_proof.tables import ARITHMETIC, outputs_of
from dl2c.smt.query import Impossible, Oracle

Centers: TypeAlias = Sequence[tuple[Fraction, Fraction]]
"""The middle of a box and half of its width, in each dimension."""

ENLARGED = 1 + Fraction(1, 2**30)


@dataclass(frozen=True, slots=True)
class Leaf:
    """Whether a box is proved; else perhaps a state that may violate the claim."""

    proved: bool
    suspect: dict[str, Fraction] | None = None


Rows: TypeAlias = Sequence[Sequence[Sequence[float | Fraction]]]
"""Of each output, below and above, the constant and the slopes of a linear function of t."""

Limits: TypeAlias = Sequence[Sequence[float | Fraction]]
"""Of a box, low and high in each dimension."""


def ask(question: Question, judge: Judge, box: Doubles, oracle: Oracle) -> Leaf:
    """Ask Z3 about a box (dimensions, 2), with the bounds of the search."""
    linear = judge.linear(box)
    if linear is None:
        return Leaf(False)
    middles = [low + 0.5 * (high - low) for low, high in box.tolist()]
    around = zip(middles, box.tolist(), strict=True)
    halves = [max(add_up(high, -m), add_up(m, -low)) for m, (low, high) in around]
    centers = [(Fraction(m), Fraction(h)) for m, h in zip(middles, halves, strict=True)]
    return decided(question, linear.tolist(), box.tolist(), centers, oracle)


def decided(question: Question, linear: Rows, box: Limits, centers: Centers, oracle: Oracle) -> Leaf:
    """Ask Z3 about each case on a box: with outputs between two numbers, then between two linear functions.
    A state is the middle and half times t, in each dimension.
    """
    conditions = (question.hypothesis, *(c.conclusion for c in question.cases))
    if any(_is_root(t) for c in conditions for t in subterms(c)):
        return Leaf(False)
    scales = [o[2] for o in outputs_of(question)]
    bounds = [_bounds(question, centers, *args) for args in zip(linear, scales, strict=True)]
    inside = conjunction([question.hypothesis, *within(question, box)])
    names = [s.name for s in question.dimensions]
    for case in question.cases:
        state: Mapping[str, Fraction | str] = {}
        for kind in range(2):
            premises = conjunction(_premises(question, case, [b[kind] for b in bounds]))
            answer = oracle.exists([inside, premises], [Impossible((), case.conclusion)], names)
            if answer.verdict == "no":
                break
            state = answer.witness or state
        else:
            found = {n: Fraction(float(v)) for n, v in state.items()}
            return Leaf(False, found or None)
    return Leaf(True)


def _is_root(term: Term) -> bool:
    return isinstance(term, Call) and term.function == "sqrt"


def within(question: Question, box: Limits) -> Iterator[Formula]:
    """That a state is in a box."""
    for s, (low, high) in zip(question.dimensions, box, strict=True):
        yield Compare("<=", Number(Fraction(low)), s)
        yield Compare("<=", s, Number(Fraction(high)))


Ends: TypeAlias = tuple[Term, Term]
"""Below and above an output."""


def _bounds(
    question: Question,
    centers: Centers,
    rows: Sequence[Sequence[float | Fraction]],
    scale: tuple[float, ...],
) -> tuple[Ends, Ends]:
    """Numbers, and linear functions of the state, between which an output lies as it is scaled: with the
    error of computing it, as in cgen/verify/search.h. Numbers are rounded outwards to few digits.
    """
    slope, offset, size = (Fraction(v) for v in scale[:3])
    unit, tiny, *_ = (Fraction(v) for v in ARITHMETIC[question.arithmetic])
    most = max(sum(abs(Fraction(v)) for v in row) for row in rows)
    error = 16 * ((Fraction(1, 2**53) + unit) * (abs(slope) * most + size) + tiny + Fraction(1, 2**1022))
    below, above = ([slope * Fraction(v) for v in row] for row in rows)
    below[0] += offset - error * ENLARGED
    above[0] += offset + error * ENLARGED
    low, high = below[0] - sum(map(abs, below[1:])), above[0] + sum(map(abs, above[1:]))
    step = _step(high - low)
    numbers = Number(_floor(low, step)), Number(-_floor(-high, step))
    lines = _line(question, centers, below, step, -1), _line(question, centers, above, step, 1)
    return numbers, lines


def _step(width: Fraction) -> Fraction:
    """A power of two that is small beside a width."""
    return Fraction(2) ** (math.frexp(float(width))[1] - 10) if width > 0 else Fraction(1, 2**60)


def _floor(value: Fraction, step: Fraction) -> Fraction:
    return step * (value / step).__floor__()


def _line(question: Question, centers: Centers, row: list[Fraction], step: Fraction, side: int) -> Term:
    """constant + slopes * t, with t = (x - middle) / half. Slopes are rounded, and
    the constant gets what that may change: down where `side` is -1, up where it is 1.
    """
    constant, *slopes = row
    short = [_floor(v, step) for v in slopes]
    constant += side * sum((abs(a - b) for a, b in zip(slopes, short, strict=True)), Fraction(0))
    term: Term = Number(side * -_floor(side * -constant, step))
    for s, slope, (middle, half) in zip(question.dimensions, short, centers, strict=True):
        if half > 0:
            term = Add(term, Mul(Number(slope / half), Sub(s, Number(middle))))
    return term


def _premises(question: Question, case: Case, bounds: Sequence[Ends]) -> Iterator[Formula]:
    """What the bounds say of the outputs of a case."""
    for p in case.premises:
        yield from _between(question, p, *bounds[p.request])
    pairs = [o[:2] for o in outputs_of(question)]
    for pair in case.largest:
        yield Compare(">=", bounds[pairs.index(pair)][1], Number(Fraction(0)))


def _between(question: Question, p: Premise, below: Term, above: Term) -> Iterator[Formula]:
    if p.value is None:
        assert p.low is not None and p.high is not None
        symbol = question.requests[p.request].symbol
        yield Compare("<", Number(p.low), symbol)
        yield Compare("<", symbol, Number(p.high))
        yield Compare("<=", below, symbol)
        yield Compare("<=", symbol, above)
        return
    if p.low is not None:
        yield Compare(">=", above, Number(p.low))
    if p.high is not None:
        yield Compare("<=", below, Number(p.high))
