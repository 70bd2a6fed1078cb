"""A question as the tables of `native.boxes`.

Names are numbered: first the dimensions of the box, then the requests.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import inf
from typing import TypeAlias

import numpy as np

from dl2c.interval.arithmetic import enclosure
from dl2c.ir.logic import ascending, operands
from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.native.boxes import (
    MOST_DIMENSIONS,
    MOST_LAYERS,
    MOST_OUTPUTS,
    MOST_STEPS,
    MOST_SYMBOLS,
    MOST_WIDTH,
    Tables,
)
from dl2c.policy.network import Activation
from dl2c.policy_proof.question import (
    Arithmetic,
    Case,
    NotCovered,
    Observed,
    Question,
    Request,
    check_numbers,
)

OPERATIONS: dict[type[Term], int] = {Neg: 2, Add: 3, Sub: 4, Mul: 5, Div: 6, Pow: 7}
FUNCTIONS = {"sqrt": 8, "abs": 9, "min": 10, "max": 11, "sin": 12, "cos": 13, "exp": 14, "tanh": 15}
DIVIDE_NONZERO = 16
COMPARISONS: dict[Comparison, int] = {"<": 0, "<=": 1, "=": 2, "!=": 3}
ATOM, ALL, SOME = range(3)
ACTIVATIONS: dict[Activation, int] = {"identity": 0, "relu": 1, "tanh": 2}
"""As the enumerations of cgen/verify."""

ARITHMETIC: dict[Arithmetic, tuple[float, float, float, float]] = {
    "real": (0.0, 0.0, 1e300, 0.0),
    "double": (2.0**-53, 2.0**-1022, 1e300, 2.0**-50),
    "float32": (2.0**-24, 2.0**-126, 1e37, 2.0**-21),
}
"""Relative error of an operation, smallest normal number, a bound of magnitudes, error of tanh."""


Step: TypeAlias = tuple[int, int, int, float, float]
Atom: TypeAlias = tuple[int, int, int, int, int]


def tables_of(question: Question) -> Tables:
    """The tables of a question. Raises `NotCovered`."""
    names = (*question.dimensions, *(r.symbol for r in question.requests))
    _check(question, len(names))
    writer = _Writer({s: k for k, s in enumerate(names)})
    hypothesis = writer.formula(question.hypothesis, frozenset())
    outputs = outputs_of(question)
    cases: list[tuple[int, int, int]] = []
    premises: list[tuple[int, int, int, float, float]] = []
    for case in question.cases:
        first = len(premises)
        premises += _premises(question, case, outputs)
        nonzero = frozenset(_nonzero(question, case))
        cases.append((first, len(premises) - first, writer.formula(case.conclusion, nonzero)))
    if len(outputs) > MOST_OUTPUTS:
        raise NotCovered(f"more than {MOST_OUTPUTS} outputs would be compared")
    return Tables(
        tuple(writer.steps),
        tuple(writer.atoms),
        tuple(writer.nodes),
        tuple(writer.parts),
        len(names),
        len(question.dimensions),
        tuple(_observation(question, k, o) for k, o in enumerate(question.observed)),
        tuple((ACTIVATIONS[layer.activation], layer.weight, layer.bias) for layer in question.layers),
        tuple(outputs),
        ARITHMETIC[question.arithmetic],
        hypothesis,
        tuple(cases),
        tuple(premises),
        len(question.computed),
    )


def outputs_of(question: Question) -> list[tuple[int, int, tuple[float, ...]]]:
    """What is bounded, each once: requests, then differences of outputs: numbers of outputs, and a scale."""
    pairs = dict.fromkeys(pair for case in question.cases for pair in case.largest)
    unscaled = (1.0, 0.0, 0.0, -inf, inf)
    return [*(_output(k, r) for k, r in enumerate(question.requests)), *((a, b, unscaled) for a, b in pairs)]


def _check(question: Question, names: int) -> None:
    """Raises `NotCovered` for what the library has no place for."""
    if names > MOST_SYMBOLS or len(question.dimensions) > MOST_DIMENSIONS:
        raise NotCovered(f"its states have {len(question.dimensions)} dimensions, too many to search")
    widths = [len(question.observed), *(len(layer.bias) for layer in question.layers)]
    if max(widths) > MOST_WIDTH or len(question.layers) > MOST_LAYERS:
        raise NotCovered(f"its network is larger than {MOST_LAYERS} layers of {MOST_WIDTH}")
    for layer in question.layers:
        if layer.activation not in ACTIVATIONS:
            raise NotCovered(f"its network uses {layer.activation}, not relu or tanh")
    check_numbers(question)


# The network ---------------------------------------------------------------------------------------


def _observation(
    question: Question, k: int, seen: Observed
) -> tuple[int, float, float, float, tuple[tuple[float, ...], ...]]:
    """What is observed, then clipped to its limits and scaled as each scaling says."""
    relative, absolute = (2.0**-24, 2.0**-149) if seen.rounded else (0.0, 0.0)
    if question.arithmetic == "float32":
        relative, absolute = 2.0**-23, 2.0**-125
    scales = [(1.0, 0.0, 0.0, seen.low, seen.high)]
    for scaling in question.scalings:
        center, scale = float(scaling.center[k]), float(scaling.scale[k])
        size = abs(center) / scale * (1 + 2.0**-50)
        scales.append((1 / scale, -center / scale, size, -scaling.clip, scaling.clip))
    if isinstance(seen.value, Symbol):
        return question.dimensions.index(seen.value), 0.0, relative, absolute, tuple(scales)
    nearest = float(seen.value)
    error = float(abs(Fraction(nearest) - seen.value)) * (1 + 2.0**-50)
    return -1, nearest, relative, absolute + error, tuple(scales)


def _output(k: int, request: Request) -> tuple[int, int, tuple[float, ...]]:
    """An output as a request, before it is clipped."""
    if not request.stretched:
        return k, -1, (1.0, 0.0, 0.0, -inf, inf)
    low, high = float(request.low), float(request.high)
    size = 2 * (abs(low) + abs(high))
    return k, -1, ((high - low) / 2, low + (high - low) / 2, size, -inf, inf)


def _premises(
    question: Question, case: Case, outputs: list[tuple[int, int, tuple[float, ...]]]
) -> list[tuple[int, int, int, float, float]]:
    """The premises of a case, each about one of `outputs_of`."""
    found: list[tuple[int, int, int, float, float]] = []
    requested = len(question.dimensions)
    for p in case.premises:
        low = -inf if p.low is None else enclosure(p.low).low
        high = inf if p.high is None else enclosure(p.high).high
        symbol = requested + p.request if p.value is None else -1
        found.append((p.request, int(p.inside), symbol, low, high))
    pairs = [o[:2] for o in outputs]
    found += [(pairs.index(pair), 0, -1, 0.0, inf) for pair in case.largest]
    return found


def _nonzero(question: Question, case: Case) -> list[Symbol]:
    """Requests that are not 0 in a case."""
    return [
        question.requests[p.request].symbol
        for p in case.premises
        if p.inside and p.low is not None and p.high is not None and (p.low >= 0 or p.high <= 0)
    ]


# Formulas ------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Writer:
    """Formulas as rows; an atom has a run of steps of its own."""

    numbers: Mapping[Symbol, int]
    steps: list[Step] = field(default_factory=list[Step])
    atoms: list[Atom] = field(default_factory=list[Atom])
    nodes: list[tuple[int, int, int]] = field(default_factory=list[tuple[int, int, int]])
    parts: list[int] = field(default_factory=list[int])

    def formula(self, formula: Formula, nonzero: frozenset[Symbol]) -> int:
        """The number of its node."""
        match formula:
            case Truth(value):
                return self._node(ALL if value else SOME, 0, 0)
            case Compare():
                return self._node(ATOM, self._atom(formula, nonzero), 0)
            case And(children) | Or(children):
                made = [self.formula(c, nonzero) for c in children]
                self.parts += made
                kind = ALL if isinstance(formula, And) else SOME
                return self._node(kind, len(self.parts) - len(made), len(made))

    def _node(self, kind: int, first: int, count: int) -> int:
        self.nodes.append((kind, first, count))
        return len(self.nodes) - 1

    def _atom(self, written: Compare, nonzero: frozenset[Symbol]) -> int:
        atom = ascending(written)
        first = len(self.steps)
        known: dict[Term, int] = {}
        left, right = (self._step(t, first, known, nonzero) for t in (atom.left, atom.right))
        count = len(self.steps) - first
        if count > MOST_STEPS:
            raise NotCovered("a condition is too long", written.span)
        self.atoms.append((COMPARISONS[atom.op], first, count, left, right))
        return len(self.atoms) - 1

    def _step(self, term: Term, first: int, known: dict[Term, int], nonzero: frozenset[Symbol]) -> int:
        if term not in known:
            at = [self._step(t, first, known, nonzero) for t in operands(term)]
            self.steps.append(self._row(term, at, nonzero))
            known[term] = len(self.steps) - 1 - first
        return known[term]

    def _row(self, term: Term, at: list[int], nonzero: frozenset[Symbol]) -> Step:
        match term:
            case Number(value):
                around = enclosure(value)
                return 0, 0, 0, around.low, around.high
            case Symbol():
                return 1, self.numbers[term], 0, 0.0, 0.0
            case Div(_, divisor) if divisor in nonzero:
                return DIVIDE_NONZERO, at[0], at[1], 0.0, 0.0
            case Pow(_, exponent):
                return OPERATIONS[Pow], at[0], exponent, 0.0, 0.0
            case Call(function):
                if function not in FUNCTIONS:
                    raise NotCovered(f"a condition uses {function}")
                return FUNCTIONS[function], at[0], at[-1], 0.0, 0.0
            case _:
                return OPERATIONS[type(term)], at[0], at[-1], 0.0, 0.0


def box_of(question: Question) -> np.ndarray:
    """The box of a question, rounded outwards: (dimensions, 2)."""
    ends = [[enclosure(low).low, enclosure(high).high] for low, high in question.box]
    return np.array(ends, np.float64).reshape(-1, 2)
