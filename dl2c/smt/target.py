"""The initial state closest to a target, as Z3's optimiser finds it: the paper's way to reset.

A model and a target come in; the state, or why there is none, goes out. The distance is the sum of
squares, each name relative to the width of its range. It is slow, and often Z3 does not decide it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from dl2c.ir.model import Model
from dl2c.smt.precondition import parts
from dl2c.smt.terms import TooLarge, Untranslatable, answer_of, condition, solution_of, z3

Status: TypeAlias = Literal["sat", "unsat", "unknown"]


@dataclass(frozen=True, slots=True)
class Nearest:
    """`state` has the doubles nearest to what Z3 found, which need not satisfy P; none unless "sat"."""

    status: Status
    state: Mapping[str, float]


def nearest(
    model: Model, target: Mapping[str, float], widths: Mapping[str, float], timeout_s: float
) -> Nearest:
    """Minimise the distance to the target over all initial states."""
    context = z3.Context()
    optimizer = z3.Optimize(ctx=context)
    optimizer.set("timeout", max(1, int(timeout_s * 1000)))
    try:
        optimizer.add(*(condition(p.formula, context) for p in parts(model)))
    except (Untranslatable, TooLarge):
        return Nearest("unknown", {})
    distance = z3.RealVal(0, context)
    for name, value in target.items():
        above, below = value.as_integer_ratio()
        scale, unit = (widths[name] or 1.0).as_integer_ratio()
        step = z3.Real(name, context) - z3.RealVal(f"{above}/{below}", context)
        relative = step * z3.RealVal(f"{unit}/{scale}", context)
        distance = distance + relative * relative
    optimizer.minimize(distance)
    answer = answer_of(optimizer)
    if answer != z3.sat:
        return Nearest("unsat" if answer == z3.unsat else "unknown", {})
    found = solution_of(optimizer, model.sampled, context)
    return Nearest("sat", {name: float(value) for name, value in found.items()})
