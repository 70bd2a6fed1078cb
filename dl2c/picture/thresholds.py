"""Where on a variable's axis a condition of the model begins or ceases to hold, and when a deadline comes.

A threshold is drawn only where it stays in place for the whole episode: the condition's other names are
constants, or variables that have not changed.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal, TypeAlias

import numpy as np

from dl2c.ir.arrays import truths, values
from dl2c.ir.logic import atoms, symbols
from dl2c.ir.model import Compare, Formula, Model, Number, Symbol
from dl2c.picture.track import Track, symbols_at
from dl2c.source import NOWHERE

Kind: TypeAlias = Literal["safety", "progress", "stability", "deadline", "domain"]

LONGEST = 32
"""Characters of a condition in a legend."""

POINTS = 400


@dataclass(frozen=True, slots=True)
class Threshold:
    """A place on an axis, what begins or ceases there, and the condition's text."""

    value: float
    kind: Kind
    text: str


def conditions(model: Model) -> Iterator[tuple[Kind, str, Formula]]:
    """What is worth marking: annotated predicates, when their obligations fall due, domains of flows."""
    for p in model.predicates:
        yield p.category, p.name, p.formula
        if p.due is not None:
            yield "deadline", f"{p.name} is due", p.due
    for flow in model.flows:
        yield "domain", "domain", flow.watched


def thresholds(model: Model, track: Track, name: str, low: float, high: float) -> tuple[Threshold, ...]:
    """Those between `low` and `high` on the axis of a variable, each place once."""
    axis, state = Symbol(name, "variable"), symbols_at(model, track.states[0])
    fixed = constant_names(model, track)
    found: dict[float, Threshold] = {}
    for kind, title, formula in conditions(model):
        for atom in atoms(formula):
            used = symbols(atom)
            if axis in used and all(s == axis or s.name in fixed for s in used):
                for place in _places(atom, axis, state, low, high):
                    text = (condition_text(atom) or title) if kind != "deadline" else title
                    found.setdefault(float(f"{place:.6g}"), Threshold(place, kind, text))
    return tuple(found.values())


def constant_names(model: Model, track: Track) -> set[str]:
    """Names whose value is the same in all states."""
    first = track.states[0]
    names = (*(v.name for v in model.variables), *(c.name for c in model.constants))
    return {n for n in names if all(state[n] == first[n] for state in track.states)}


def condition_text(atom: Compare) -> str:
    """A condition as the model has it; "" where that is long."""
    text = "" if atom.span == NOWHERE else " ".join(atom.span.text.split())
    depths = list(accumulate((c == "(") - (c == ")") for c in text))
    if text.startswith("(") and 0 not in depths[:-1]:
        text = text[1:-1]
    return text if len(text) <= LONGEST else ""


def _places(
    atom: Compare, axis: Symbol, state: Mapping[Symbol, float], low: float, high: float
) -> Iterator[float]:
    """Where the difference of an atom's sides changes its sign."""
    points = np.linspace(low, high, POINTS)

    def gap(x: float) -> float:
        at = {**state, axis: x}
        return float(values(atom.left, at) - values(atom.right, at))

    signs = [math.copysign(1, g) if (g := gap(float(x))) and math.isfinite(g) else g for x in points]
    for k in range(POINTS - 1):
        if signs[k] == 0:
            yield float(points[k])
        elif signs[k] * signs[k + 1] < 0:
            a, b = float(points[k]), float(points[k + 1])
            for _ in range(60):
                middle = (a + b) / 2
                a, b = (middle, b) if gap(middle) * signs[k] > 0 else (a, middle)
            yield b


def deadline(model: Model, track: Track) -> float | None:
    """When, in seconds, an obligation first falls due if clocks go on as they do; None if not known."""
    for p in model.predicates:
        if p.due is not None:
            for k, state in enumerate(track.states):
                if truths(p.due, symbols_at(model, state)):
                    return track.times[k]
            found = [t for atom in atoms(p.due) if (t := _clock_time(model, track, atom)) is not None]
            if found:
                return min(found)
    return None


def _clock_time(model: Model, track: Track, atom: Compare) -> float | None:
    """When a condition on one clock changes, for a clock that has run at its rate all the time."""
    names = {s.name for s in symbols(atom)} - constant_names(model, track)
    rates = {x: r.value for flow in model.flows for x, r in flow.equations if isinstance(r, Number)}
    if len(names) != 1 or (name := names.pop()) not in rates or not rates[name]:
        return None
    rate, ran = float(rates[name]), track.values(name)
    if not np.allclose(ran, ran[0] + rate * np.array(track.times), rtol=1e-6, atol=1e-6):
        return None
    axis, state = Symbol(name, "variable"), symbols_at(model, track.states[0])
    reach = 4 * max(track.times[-1], 1.0) * rate
    ahead = sorted((float(ran[0]), float(ran[0]) + reach))
    places = list(_places(atom, axis, state, *ahead))
    return min((p - float(ran[0])) / rate for p in places) if places else None
