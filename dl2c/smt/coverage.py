"""Whether a union of boxes holds every initial state, or every one of a chart.

A model and boxes over some of its names, or over parts of a way between limits of them, come in; a proof,
a state outside of all boxes, or the reason that neither was found goes out. Only names that are doubles
count: a bound of 0.1 begins at the double above it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir.model import Formula, Model, Truth
from dl2c.smt.precondition import Unknown, parts
from dl2c.smt.terms import (
    Expression,
    TooLarge,
    Untranslatable,
    answer_of,
    condition,
    solution_of,
    solver_of,
    z3,
)
from dl2c.source import NOWHERE

Region: TypeAlias = Mapping[str, tuple[float, float]]
"""Limits of names."""

EVERYWHERE = Truth(True)


@dataclass(frozen=True, slots=True)
class Covered:
    """Nothing feasible lies outside; `seconds` is how long the proof took."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Outside:
    """An initial state that no box holds."""

    state: Mapping[str, Fraction | str]


def coverage(
    model: Model,
    around: Region,
    boxes: Sequence[Region],
    chart: Formula = EVERYWHERE,
    timeout_s: float = 60.0,
) -> Covered | Outside | Unknown:
    """Decide it with Z3 for the states of a chart; `around` limits the names to what doubles inside their
    bounds can be."""
    begun = time.monotonic()
    context = z3.Context()
    try:
        initial = [condition(f, context) for f in (*(p.formula for p in parts(model)), chart)]
    except (Untranslatable, TooLarge):
        return Unknown("the precondition is beyond Z3's arithmetic", NOWHERE)
    inside = _inside(around, context)
    outside = [z3.Not(_inside(box, context)) for box in boxes]
    solver = solver_of(context, [*initial, inside, *outside], timeout_s)
    answer = answer_of(solver)
    if answer == z3.unsat:
        return Covered(time.monotonic() - begun)
    if answer == z3.unknown:
        return Unknown(f"Z3 gave up: {solver.reason_unknown()}", NOWHERE)
    return Outside(solution_of(solver, model.sampled, context))


def _inside(region: Region, context: Expression) -> Expression:
    sides: list[Expression] = []
    for name, (low, high) in region.items():
        symbol = z3.Real(name, context)
        sides += [symbol >= _exact(low, context), symbol <= _exact(high, context)]
    return z3.And(*sides) if sides else z3.BoolVal(True, context)


def _exact(value: float, context: Expression) -> Expression:
    numerator, denominator = value.as_integer_ratio()
    return z3.RealVal(f"{numerator}/{denominator}", context)
