"""One state, judged without error: what the policy asks for in it, and whether that is admissible.

With real numbers networks of relu are computed in fractions; one with tanh is enclosed. In the arithmetic of
a program, operations are those of the exported C in its order, in numpy's scalars.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from dl2c.interval.arithmetic import Interval, enclosure, truth
from dl2c.ir.evaluate import truth as exact_truth
from dl2c.ir.evaluate import value_of
from dl2c.ir.logic import subterms
from dl2c.ir.model import Call, Formula, Symbol, Term
from dl2c.policy_proof.question import Case, Question, Request

State = Mapping[Symbol, Fraction]

LARGEST = 10**30
"""Of outputs that are looked at."""


@dataclass(frozen=True, slots=True)
class Violation:
    """A state in which what the policy asks for is not admissible. `outputs` are those of its network,
    `requests` what is asked for, by name, or which share of what is admissible; `violated` is the condition
    that does not hold.
    """

    state: Mapping[str, Fraction]
    outputs: tuple[Fraction, ...]
    requests: Mapping[str, Fraction]
    about: str
    violated: Formula


def violation(question: Question, state: State) -> Violation | None:
    """What is wrong in a state; None where nothing is, or where that cannot be said for certain. What the
    environment computes has the value that the program computes.
    """
    computed = [(symbol, _computed(question, term, state)) for symbol, term in question.computed]
    state = {**state, **{symbol: value for symbol, value in computed if value is not None}}
    if any(value is None for _, value in computed):
        return None
    if not _certain(question.hypothesis, state, True):
        return None
    if any(
        not low <= state[s] <= high for s, (low, high) in zip(question.dimensions, question.box, strict=True)
    ):
        return None
    outputs = outputs_at(question, state)
    if outputs is None:
        return None
    requests = _requests(question, outputs)
    values = dict(state) | {r.symbol: v for r, v in zip(question.requests, requests, strict=True)}
    for case in question.cases:
        if _taken(question, case, outputs, requests) and _certain(case.conclusion, values, False):
            names = {
                r.symbol.name.removeprefix("request "): v
                for r, v in zip(question.requests, requests, strict=True)
            }
            shown = dict(question.fixed) | {s.name: v for s, v in state.items()}
            return Violation(shown, tuple(outputs), names, case.about, case.conclusion)
    return None


def _computed(question: Question, term: Term, state: State) -> Fraction | None:
    """A value as the program computes it; None where that is not known exactly."""
    if question.arithmetic == "float32":
        return None
    exact = question.arithmetic == "real"
    value = value_of(term, {s: v if exact else float(v) for s, v in state.items()}, exact)
    return None if value is None else Fraction(value)


def _certain(formula: Formula, values: State, wanted: bool) -> bool:
    """Whether a formula certainly has this truth value: exactly, or, with functions, in enclosures."""
    calls = (t for t in subterms(formula) if isinstance(t, Call))
    if all(c.function in ("abs", "min", "max") for c in calls):
        return exact_truth(formula, values, exact=True) is wanted
    box = {s: Interval(*_ends(v)) for s, v in values.items()}
    return truth(formula, box) == ("true" if wanted else "false")


def _ends(value: Fraction) -> tuple[float, float]:
    around = enclosure(value)
    return around.low, around.high


def _taken(question: Question, case: Case, outputs: Sequence[Fraction], requests: Sequence[Fraction]) -> bool:
    """Whether a case is the one that these outputs lead to. Of equal outputs the first is the largest, and
    a request halfway between two choices is rounded to the even one.
    """
    for first, second in case.largest:
        if outputs[first] < outputs[second] or (outputs[first] == outputs[second] and second < first):
            return False
    for p in case.premises:
        asked, request = requests[p.request], question.requests[p.request]
        rounded = request.symbol.name.startswith("request choice ")
        if rounded and round(_placed(question, request, asked)) != p.value:
            return False
        if not rounded and p.value is not None and asked != p.value:
            return False
        if p.inside and not (p.low is not None and p.high is not None and p.low < asked < p.high):
            return False
    return True


def _placed(question: Question, request: Request, asked: Fraction) -> Fraction:
    """A request among alternatives, which may be spread over -1..1."""
    if request.last is None:
        return asked
    number = _number(question)
    placed = (number(asked if number is Fraction else float(asked)) + 1) / 2 * request.last
    return placed if isinstance(placed, Fraction) else Fraction(float(placed))


def _requests(question: Question, outputs: Sequence[Fraction]) -> list[Fraction]:
    """Outputs stretched and clipped."""
    found: list[Fraction] = []
    for request, output in zip(question.requests, outputs, strict=False):
        value = output
        if request.stretched:
            number = _number(question)
            low, high = number(float(request.low)), number(float(request.high))
            stretched = low + (number(output) + 1) / 2 * (high - low)
            value = stretched if isinstance(stretched, Fraction) else Fraction(float(stretched))
        found.append(min(max(value, request.low), request.high))
    return found


def _number(question: Question) -> Any:
    """The type of numbers that the program computes with."""
    match question.arithmetic:
        case "real":
            return Fraction
        case "double":
            return np.float64
        case "float32":
            return np.float32


def outputs_at(question: Question, state: State) -> list[Fraction] | None:
    """What the network computes; None where that is not known exactly."""
    curved = any(layer.activation == "tanh" for layer in question.layers)
    if curved and question.arithmetic != "double":
        return None
    number = _number(question)
    with np.errstate(all="ignore"):
        values = [_observed(question, k, state, number) for k in range(len(question.observed))]
        for layer in question.layers:
            values = [
                _activated(layer.activation, _sum(row, bias, values, number), number)
                for row, bias in zip(layer.weight.tolist(), layer.bias.tolist(), strict=True)
            ]
    if not all(abs(v) < LARGEST for v in values):
        return None
    return [v if isinstance(v, Fraction) else Fraction(float(v)) for v in values]


def _observed(question: Question, k: int, state: State, number: Any) -> Any:
    """An observation as the network is given it: rounded, clipped and scaled."""
    seen = question.observed[k]
    exact = state[seen.value] if isinstance(seen.value, Symbol) else seen.value
    value = exact if number is Fraction else number(np.float32(exact) if seen.rounded else float(exact))
    value = _clipped(value, seen.low, seen.high, number)
    for scaling in question.scalings:
        value = (value - number(scaling.center[k])) / number(scaling.scale[k])
        value = _clipped(value, -scaling.clip, scaling.clip, number)
    return value


def _clipped(value: Any, low: float, high: float, number: Any) -> Any:
    value = max(value, number(low)) if math.isfinite(low) else value
    return min(value, number(high)) if math.isfinite(high) else value


def _sum(row: Sequence[float], bias: float, values: Sequence[Any], number: Any) -> Any:
    total = number(bias)
    for weight, value in zip(row, values, strict=True):
        total = total + number(weight) * value
    return total


def _activated(activation: str, total: Any, number: Any) -> Any:
    match activation:
        case "relu":
            return total if total > 0 else number(0)
        case "tanh":
            return number(math.tanh(total))
        case _:
            return total
