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

import mpmath
import numpy as np
from mpmath import mpf

from dl2c.ir.logic import operands
from dl2c.ir.model import (
    And,
    Call,
    Compare,
    Div,
    Flow,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Symbol,
    Term,
    Truth,
)

context = mpmath.mp.clone()
context.dps = 32
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


class Singular(Exception):
    """The solution ends, or a term of its equations has no value."""


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
            return args[0] ** exponent
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


# Taylor series ----------------------------------------------------------------


def dot(a: list[mpf], b: list[mpf]) -> mpf:
    """a[0]*b[n-1] + ... + a[n-1]*b[0]"""
    return context.fdot(zip(a, reversed(b), strict=True))


def slopes(a: list[mpf], k: int) -> list[mpf]:
    """1*a[1], ..., k*a[k]"""
    return [i * a[i] for i in range(1, k + 1)]


@dataclass
class Node:
    """A term as a power series that grows by one coefficient at a time."""

    term: Term
    parts: tuple["Node", ...]
    c: list[mpf] = field(default_factory=list)
    other: list[mpf] = field(default_factory=list)
    """Of the cosine of a sine, and the other way round."""

    def grow(self) -> None:
        k = len(self.c)
        series = [p.c for p in self.parts]
        match self.term:
            case Number():
                self.c.append(value(self.term, {}) if k == 0 else context.mpf(0))
            case Symbol():
                assert k > 0 and len(self.c) == k, "the integration sets these"
            case Neg():
                self.c.append(-series[0][k])
            case Div():
                a, b = series
                if b[0] == 0:
                    raise Singular
                self.c.append((a[k] - dot(b[1 : k + 1], self.c)) / b[0])
            case Call("sqrt"):
                self.c.append(self._root(series[0], k))
            case Call("exp"):
                (a,) = series
                self.c.append(context.exp(a[0]) if k == 0 else dot(slopes(a, k), self.c) / k)
            case Call("sin" | "cos" as name):
                self._turn(series[0], k, name)
            case _:
                self._algebra(series, k)

    def _algebra(self, series: list[list[mpf]], k: int) -> None:
        a, b = series
        match type(self.term).__name__:
            case "Add":
                self.c.append(a[k] + b[k])
            case "Sub":
                self.c.append(a[k] - b[k])
            case "Mul":
                self.c.append(dot(a[: k + 1], b[: k + 1]))
            case name:
                raise AssertionError(name)

    def _root(self, a: list[mpf], k: int) -> mpf:
        if a[0] <= 0:
            raise Singular
        if k == 0:
            return context.sqrt(a[0])
        return (a[k] - dot(self.c[1:k], self.c[1:k])) / (2 * self.c[0])

    def _turn(self, a: list[mpf], k: int, name: str) -> None:
        sines, cosines = (self.c, self.other) if name == "sin" else (self.other, self.c)
        if k == 0:
            sines.append(context.sin(a[0]))
            cosines.append(context.cos(a[0]))
            return
        s = dot(slopes(a, k), cosines) / k
        c = -dot(slopes(a, k), sines) / k
        sines.append(s)
        cosines.append(c)


def nodes_of(terms: list[Term]) -> tuple[list[Node], list[Node]]:
    """One node for each subterm, operands first, and the nodes of the terms themselves."""
    made: dict[Term, Node] = {}

    def visit(term: Term) -> Node:
        if isinstance(term, Pow):
            parts = (visit(term.base),)
            product = parts[0]
            for n in range(2, term.exponent + 1):
                known = Pow(term.base, n)
                made[known] = product = made.get(known) or Node(
                    Mul(term.base, term.base), (product, parts[0])
                )
            return product
        if term not in made:
            parts = tuple(visit(t) for t in operands(term))
            made[term] = Node(term, parts)
        return made[term]

    tops = [visit(t) for t in terms]
    return list(made.values()), tops


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
        """The signs of an atom at these places: by doubles where these are sure of it."""
        steps = np.array([float(tau - self.start) for tau in places])
        rows: dict[Symbol, Any] = {s: float(v) for s, v in self.still.items()}
        for symbol, series in self.series.items():
            rows[symbol] = np.polyval([float(c) for c in reversed(series)], steps)
        with np.errstate(all="ignore"):
            left, right = value(atom.left, rows, QUICK), value(atom.right, rows, QUICK)
            sure = np.abs(left - right) > 1e-9 * (1 + np.abs(left) + np.abs(right))
            quick = np.broadcast_to(np.sign(left - right), steps.shape)
            if grazes(np.broadcast_to(left - right, steps.shape)):
                self.grazed.append(atom)
        sure = np.broadcast_to(sure, steps.shape)
        return [int(q) if s else sign(atom, self.at(t)) for q, s, t in zip(quick, sure, places, strict=True)]


def grazes(row: Any) -> bool:
    """Whether a row has a small extremum between values of one sign, by parabolas through three of them."""
    size = np.abs(row)
    before, here, after = size[:-2], size[1:-1], size[2:]
    low = (here <= before) & (here <= after) & (row[:-2] * row[2:] > 0)
    bend = before - 2 * here + after
    least = here - (after - before) ** 2 / (8 * np.maximum(bend, 1e-300))
    return bool(np.any(low & (least < 1e-3) & (bend > 0)))


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
        for low, high, after in zip(places[:-1], places[1:], piece.signs(atom, places[1:]), strict=True):
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


def moved(flow: Flow, start: Mapping[Symbol, float], told: Verdict, by: float = 1e-7) -> float:
    """How much more than the start the end and the duration move, where the start moves a little.

    Infinite where a neighbour is outside the domain, ends for another reason or has no solution:
    then the answer from this start is ill-conditioned, as at a grazing contact.
    """
    if told.grazed:
        return math.inf
    largest = 1.0
    names = [Symbol(x, "variable") for x, _ in flow.equations]
    rng = Random(1)
    for _ in range(2):
        near = {**start, **{s: start[s] + by * rng.choice((-1, 1)) for s in names if s.name != "t"}}
        try:
            other = judge(flow, near)
        except Singular:
            return math.inf
        if other.event != told.event or (other.duration == 0) != (told.duration == 0):
            return math.inf
        change = max(abs(other.state[s] - told.state[s]) for s in names)
        largest = max(largest, float(max(change, abs(other.duration - told.duration))) / by)
    return largest
