"""States along a motion in floating point: formulas that fail at one are not worth a question.

They prove nothing and refute nothing. What is dropped for them by mistake is a proof that is not found.
"""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import fold, symbols
from dl2c.ir.model import Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term

Values: TypeAlias = Mapping[Symbol, float]

STEP = 0.04
STEPS = 25
SMALLEST_STEP = 1e-4
"""Of the numerical solution, in units of time."""

LARGEST = 1e6
"""Values beyond which a motion is not followed."""

ACCURACY = 1e-7
TOLERANCE = 1e-5
"""Relative: of a step, and of comparisons."""

TRIES = 60
EXAMPLES = 4
"""Of states to begin in, near one that is given."""


@dataclass(frozen=True, slots=True)
class Samples:
    """States on some motions, the first of which begin where the formulas that are asked for begin."""

    states: Sequence[Values]

    def reject(self, formula: Formula) -> bool:
        """Whether a formula is clearly false in one of the states."""
        return any(not _holds(formula, s, TOLERANCE) for s in self.states)


def samples(
    facts: Sequence[Formula],
    example: Mapping[str, Fraction | str],
    start: Mapping[Symbol, Term],
    rates: Mapping[Symbol, Term],
    domain: Formula,
) -> Samples:
    """States on motions that begin at `example`, where `facts` hold, and near it."""
    names = symbols(*facts, *start.values(), *rates.values(), domain) - start.keys()
    first = _consistent({s: _float(example.get(s.name, "0")) for s in names}, facts)
    states: list[Values] = []
    for values in _near(first, facts):
        try:
            begun = dict(values) | {s: _value(t, values) for s, t in start.items()}
        except (ArithmeticError, ValueError):
            continue
        states += _along(begun, rates, domain)
    return Samples(states)


def _float(value: Fraction | str) -> float:
    try:
        return float(value if isinstance(value, Fraction) else value.rstrip("?"))
    except (ValueError, OverflowError):
        return 0.0


def _consistent(values: Mapping[Symbol, float], facts: Sequence[Formula]) -> dict[Symbol, float]:
    """The values, of which solvers know functions by some of their properties only: where a fact says that a
    symbol equals a term, it gets the value of that.
    """
    found = dict(values)
    for fact in facts:
        match fact:
            case Compare("=", Symbol() as symbol, term) | Compare("=", term, Symbol() as symbol):
                with suppress(ArithmeticError, ValueError):
                    found[symbol] = _value(term, found)
            case _:
                pass
    return found


def _near(first: dict[Symbol, float], facts: Sequence[Formula]) -> Iterator[dict[Symbol, float]]:
    """The state, if the facts hold there, and others with other values of what no equation is about."""
    if all(_holds(f, first, TOLERANCE) for f in facts):
        yield first
    chance = random.Random(0)
    tied = symbols(*(f for f in facts if isinstance(f, Compare) and f.op == "="))
    free = sorted(first.keys() - tied, key=str)
    found = 1
    for k in range(TRIES):
        if found == EXAMPLES or not free:
            return
        scale = 2.0 ** -(k // 12)
        moved = {s: first[s] + chance.gauss(0, 1 + abs(first[s])) * scale for s in free}
        if all(_holds(f, first | moved, 0.0) for f in facts):
            found += 1
            yield first | moved


def _along(begun: Values, rates: Mapping[Symbol, Term], domain: Formula) -> Iterator[Values]:
    """The state where the motion begins, and further ones while the domain holds."""
    yield begun
    state, step = dict(begun), STEP
    for _ in range(STEPS):
        found = _stepped(state, rates, step)
        while found is None and step > SMALLEST_STEP:
            step /= 4
            found = _stepped(state, rates, step)
        if found is None or not _holds(domain, found, 0.0):
            return
        state = found
        yield state


def _stepped(
    state: dict[Symbol, float], rates: Mapping[Symbol, Term], step: float
) -> dict[Symbol, float] | None:
    """The state after a step; None where that is not accurate, too large or undefined."""
    try:
        whole = _runge_kutta(state, rates, step)
        half = _runge_kutta(_runge_kutta(state, rates, step / 2), rates, step / 2)
    except (ArithmeticError, ValueError):
        return None
    if any(abs(half[s]) > LARGEST or math.isnan(half[s]) for s in rates):
        return None
    if any(abs(whole[s] - half[s]) > ACCURACY * (1 + abs(half[s])) for s in rates):
        return None
    return half


def _runge_kutta(
    state: dict[Symbol, float], rates: Mapping[Symbol, Term], step: float
) -> dict[Symbol, float]:
    def moved(slopes: Values, part: float) -> dict[Symbol, float]:
        return state | {s: state[s] + part * v for s, v in slopes.items()}

    def slopes(at: Values) -> dict[Symbol, float]:
        return {s: _value(rate, at) for s, rate in rates.items()}

    a = slopes(state)
    b = slopes(moved(a, step / 2))
    c = slopes(moved(b, step / 2))
    d = slopes(moved(c, step))
    return moved({s: (a[s] + 2 * b[s] + 2 * c[s] + d[s]) / 6 for s in rates}, step)


def _holds(formula: Formula, values: Values, tolerance: float) -> bool:
    """Whether a formula holds, its comparisons up to a tolerance; True where it has no value."""

    def atom(a: Compare) -> bool:
        left, right = _value(a.left, values), _value(a.right, values)
        slack = tolerance * (1 + abs(left) + abs(right))
        match a.op:
            case "=":
                return abs(left - right) <= max(slack, 1e-12)
            case "!=":
                return left != right or tolerance > 0
            case "<" | "<=":
                return left < right + slack or (a.op == "<=" and left == right)
            case ">" | ">=":
                return left > right - slack or (a.op == ">=" and left == right)

    try:
        return fold(formula, lambda v: v, atom, all, any)
    except (ArithmeticError, ValueError, KeyError):
        return True


def _value(term: Term, values: Values) -> float:
    match term:
        case Number(value):
            return float(value)
        case Symbol():
            return values[term]
        case Neg(child):
            return -_value(child, values)
        case Add(left, right):
            return _value(left, values) + _value(right, values)
        case Sub(left, right):
            return _value(left, values) - _value(right, values)
        case Mul(left, right):
            return _value(left, values) * _value(right, values)
        case Div(left, right):
            return _value(left, values) / _value(right, values)
        case Pow(base, exponent):
            return _value(base, values) ** exponent
        case Call(function, args):
            return float(FUNCTIONS[function].value(*(_value(a, values) for a in args)))
