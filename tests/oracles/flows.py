"""What a flow should do, by other means: Taylor series at 32 digits, events by sampling and bisection.

Shares nothing with dl2c but the data types of the IR. Domains are evaluated as written, with
their `abs`, `min` and `max`. An event between two neighbouring samples that leaves no trace at
either is missed; `moved` finds most of these.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np
from mpmath import mpf
from oracles.taylor_series import Singular, context, nodes_of

from dl2c.ir.logic import operands
from dl2c.ir.model import (
    And,
    Call,
    Compare,
    Div,
    Flow,
    Formula,
    Neg,
    Number,
    Or,
    Pow,
    Symbol,
    Term,
    Truth,
)

ORDER = 20
LOCAL_ERROR = mpf(10) ** -22
SAMPLES = 200
"""Places per Taylor step at which conditions are looked at."""
SHORTEST = mpf(10) ** -5
"""A solution that needs shorter Taylor steps counts as singular."""
TOGETHER = mpf(10) ** -12
"""Events this close to each other are one."""
JUST_AFTER = mpf(10) ** -9
"""What a condition is just after the start is taken from this part of the first step."""

State = Mapping[Symbol, mpf]


# Terms ------------------------------------------------------------------------

EXACT = {
    "abs": abs, "min": min, "max": max, "sqrt": context.sqrt, "exp": context.exp, "sin": context.sin,
    "cos": context.cos, "tan": context.tan, "arcsin": context.asin, "arctan": context.atan,
    "tanh": context.tanh, "pow": context.power,
}  # fmt: skip
QUICK = {name: getattr(np, name) for name in EXACT if hasattr(np, name)} | {
    "min": np.minimum, "max": np.maximum, "pow": np.power,
}  # fmt: skip
"""The same functions of rows of doubles, NaN where undefined."""

DOUBLES = {name: getattr(math, name) for name in EXACT if hasattr(math, name)} | {
    "abs": abs, "min": min, "max": max, "arcsin": math.asin, "arctan": math.atan,
}  # fmt: skip
"""The same functions of doubles, which raise where undefined."""

Functions = Mapping[str, Callable[..., Any]]


def value(term: Term, at: Mapping[Symbol, Any], functions: Functions = EXACT) -> Any:
    """The value of a term; None where it is undefined. With `QUICK`, a row of doubles."""
    if isinstance(term, Number):
        exact = context.mpf(term.value.numerator) / term.value.denominator
        return exact if functions is EXACT else float(exact)
    if isinstance(term, Symbol):
        return at[term]
    args = [value(t, at, functions) for t in operands(term)]
    if any(a is None for a in args):
        return None
    match term:
        case Neg():
            return -args[0]
        case Pow(_, exponent):
            return math.prod([args[0]] * exponent) if functions is DOUBLES else args[0] ** exponent
        case Div():
            return None if functions is EXACT and args[1] == 0 else args[0] / args[1]
        case Call("sqrt") if functions is EXACT and args[0] < 0:
            return None
        case Call("arcsin") if functions is EXACT and abs(args[0]) > 1:
            return None
        case Call(function):
            return functions[function](*args)
    a, b = args
    return {"Add": lambda: a + b, "Sub": lambda: a - b, "Mul": lambda: a * b}[type(term).__name__]()


def sign(atom: Compare, at: State) -> int | None:
    """The sign of left minus right; None where it is undefined."""
    left, right = value(atom.left, at), value(atom.right, at)
    return None if left is None or right is None else int(context.sign(left - right))


ALLOWED = {"=": (0,), "!=": (-1, 1), "<": (-1,), "<=": (-1, 0), ">": (1,), ">=": (0, 1)}


def truth(formula: Formula, signs: Mapping[Compare, int | None]) -> bool:
    match formula:
        case Truth(known):
            return known
        case Compare(op):
            return signs[formula] in ALLOWED[op]
        case And(children):
            return all(truth(c, signs) for c in children)
        case Or(children):
            return any(truth(c, signs) for c in children)


def atoms_of(formula: Formula) -> Iterator[Compare]:
    match formula:
        case Compare():
            yield formula
        case And(children) | Or(children):
            for child in children:
                yield from atoms_of(child)


def inside(formula: Formula, at: Mapping[Symbol, float]) -> bool:
    """Whether a formula holds in doubles, operation by operation as it is written."""
    return truth(formula, {a: _sign_in_doubles(a, at) for a in atoms_of(formula)})


def _sign_in_doubles(atom: Compare, at: Mapping[Symbol, float]) -> int | None:
    try:
        left, right = value(atom.left, at, DOUBLES), value(atom.right, at, DOUBLES)
    except (ArithmeticError, ValueError):
        return None
    return (left > right) - (left < right) if math.isfinite(left) and math.isfinite(right) else None


# Solutions --------------------------------------------------------------------


@dataclass(frozen=True)
class Piece:
    """A stretch of the solution: a power series for each variable that moves."""

    start: mpf
    length: mpf
    still: State
    series: dict[Symbol, list[mpf]]
    grazed: list[Compare] = field(default_factory=list)
    """Atoms that seem to come to equality without a change of sign that samples show."""

    def at(self, tau: mpf) -> dict[Symbol, mpf]:
        moved = {s: context.polyval(c[::-1], tau - self.start) for s, c in self.series.items()}
        return {**self.still, **moved}

    def signs(self, atom: Compare, places: list[mpf]) -> list[int | None]:
        """The signs of an atom at these places: by doubles where these are sure of it.

        For contacts beside the ends of a piece, one place more is looked at beyond each end, but
        none before the start of the flow.
        """
        steps = np.array([float(tau - self.start) for tau in places])
        first = 1 if self.start > 0 else 0
        row = np.concatenate(([2 * steps[0] - steps[1]] * first, steps, [2 * steps[-1] - steps[-2]]))
        rows: dict[Symbol, Any] = {s: float(v) for s, v in self.still.items()}
        for symbol, series in self.series.items():
            rows[symbol] = np.polyval([float(c) for c in reversed(series)], row)
        with np.errstate(all="ignore"):
            left, right = value(atom.left, rows, QUICK), value(atom.right, rows, QUICK)
            difference = np.broadcast_to(left - right, row.shape)
            size = np.broadcast_to(1 + np.abs(left) + np.abs(right), row.shape)
            if grazes(difference):
                self.grazed.append(atom)
            sure, quick = (np.abs(difference) > 1e-9 * size)[first:-1], np.sign(difference)[first:-1]
        return [int(q) if s else sign(atom, self.at(t)) for q, s, t in zip(quick, sure, places, strict=True)]


def grazes(row: Any) -> bool:
    """Whether a row has a small extremum, or a kink that may be one, between values of one sign."""
    size = np.abs(row)
    before, here, after = size[:-2], size[1:-1], size[2:]
    low = (here <= before) & (here <= after) & (row[:-2] * row[2:] > 0)
    bend = before - 2 * here + after
    least = here - (after - before) ** 2 / (8 * np.maximum(bend, 1e-300))
    kink = here < np.maximum(before, after) - here
    return bool(np.any(low & (kink | (least < 1e-3)) & (bend > 0)))


def solution(flow: Flow, at: State, stop: mpf) -> Iterator[Piece]:
    """The solution over [0, stop], piece by piece."""
    state = dict(at)
    now = context.mpf(0)
    variables = [Symbol(x, "variable") for x, _ in flow.equations]
    while now < stop:
        nodes, rates = nodes_of([*variables, *(r for _, r in flow.equations)])
        rates = rates[len(variables) :]
        moving = {n.term: n for n in nodes if n.term in variables}
        for symbol in {n.term for n in nodes if isinstance(n.term, Symbol)}:
            node = next(n for n in nodes if n.term == symbol)
            node.c = [state[symbol]] if symbol in moving else [state[symbol]] + [context.mpf(0)] * ORDER
        for k in range(ORDER):
            for node in nodes:
                if not isinstance(node.term, Symbol):
                    node.grow()
            for symbol, rate in zip(variables, rates, strict=True):
                moving[symbol].c.append(rate.c[k] / (k + 1))
        series = {s: n.c for s, n in moving.items()}
        length = min(_reach(series), stop - now)
        if length < min(SHORTEST, stop - now):
            raise Singular
        piece = Piece(now, length, state, series)
        yield piece
        now += length
        state = piece.at(now)


def _reach(series: Mapping[Symbol, list[mpf]]) -> mpf:
    """How far the last coefficients stay below the local error."""
    reach = context.mpf(1)
    for k in (ORDER - 1, ORDER):
        largest = max(abs(c[k]) for c in series.values())
        if largest > 0:
            reach = min(reach, context.exp(context.log(LOCAL_ERROR / largest) / k))
    return reach


# Events -----------------------------------------------------------------------


@dataclass(frozen=True)
class Verdict:
    """How long a flow lasts and where it ends; `event` is False where time ran out.

    `grazed`: a condition came near its boundary on the way without crossing it.
    """

    duration: mpf
    state: dict[Symbol, mpf]
    event: bool
    grazed: bool = False


def judge(flow: Flow, start: Mapping[Symbol, float]) -> Verdict:
    """What a flow from a state in its domain should do. Raises `Singular`."""
    at = {s: context.mpf(v) for s, v in start.items()}
    atoms = list(dict.fromkeys(atoms_of(flow.watched)))
    limits = [value(h.bound, at) - at[Symbol(h.clock, "variable")] for h in flow.horizons]
    if flow.cap is not None:
        limits.append(context.mpf(flow.cap.numerator) / flow.cap.denominator)
    stop = min(limits)
    if stop <= 0:
        return Verdict(context.mpf(0), at, False)
    known: dict[Compare, int | None] = {}
    last = at
    grazed = False
    for piece in solution(flow, at, stop):
        places = [piece.start + piece.length * k / SAMPLES for k in range(SAMPLES + 1)]
        if not known:
            places[0] = piece.length * JUST_AFTER
            known = {a: sign(a, piece.at(places[0])) for a in atoms}
            if not truth(flow.watched, known):
                return Verdict(context.mpf(0), at, True)
        found = _first_event(flow.watched, piece, places, known)
        grazed |= bool(piece.grazed)
        if found is not None:
            return Verdict(found, piece.at(found), True, grazed)
        last = piece.at(piece.start + piece.length)
    return Verdict(stop, last, False, grazed)


def _first_event(
    formula: Formula, piece: Piece, places: list[mpf], known: dict[Compare, int | None]
) -> mpf | None:
    """The end of the flow in a piece; `known` are the signs at the first place, afterwards at the last."""
    changes: list[tuple[mpf, int, int | None]] = []
    atoms = list(known)
    for index, atom in enumerate(atoms):
        before = known[atom]
        for low, high, after in zip(places[:-1], places[1:], piece.signs(atom, places)[1:], strict=True):
            if after != before:
                changes.append((_bisected(atom, piece, low, high, before), index, after))
            before = after
    changes.sort(key=lambda c: c[:2])
    while changes:
        tau = changes[0][0]
        now = [c for c in changes if c[0] <= tau + TOGETHER]
        changes = changes[len(now) :]
        at_it = dict(known)
        for _, index, after in now:
            atom = atoms[index]
            at_it[atom] = 0 if None not in (known[atom], after) else known[atom] or after
            known[atom] = after
        if not truth(formula, at_it) or not truth(formula, known):
            return tau
    return None


def _bisected(atom: Compare, piece: Piece, low: mpf, high: mpf, before: int | None) -> mpf:
    for _ in range(44):
        middle = (low + high) / 2
        if sign(atom, piece.at(middle)) == before:
            low = middle
        else:
            high = middle
    return high


ELSEWHERE = 1e-3
"""An end that is so far away is another one, where neighbours are 1e-7 apart."""


def moved(flow: Flow, start: Mapping[Symbol, float], told: Verdict, by: float = 1e-7) -> float:
    """How much more than start and constants the end and the duration move, where these move a little.

    Infinite where a neighbour is outside the domain, ends for another reason or elsewhere, or has no
    solution, and where a condition has no value at the start, such as a quotient there by 0: then the answer
    from this start is ill-conditioned, as at a grazing contact.
    """
    at = {s: context.mpf(v) for s, v in start.items()}
    if told.grazed or any(sign(atom, at) is None for atom in atoms_of(flow.watched)):
        return math.inf
    largest = 1.0
    names = [Symbol(x, "variable") for x, _ in flow.equations]
    rng = Random(1)
    for _ in range(8):
        near = {s: v if s.name == "t" else v + by * rng.choice((-1, 1)) for s, v in start.items()}
        if not inside(flow.domain, near):
            return math.inf
        try:
            other = judge(flow, near)
        except Singular:
            return math.inf
        if other.event != told.event or (other.duration == 0) != (told.duration == 0):
            return math.inf
        change = max(abs(other.state[s] - told.state[s]) for s in names)
        change = float(max(change, abs(other.duration - told.duration)))
        if change > ELSEWHERE:
            return math.inf
        largest = max(largest, change / by)
    return largest
