"""The limits of each input's Box: its declared bound and what the tests imply (semantics 2).

The tests on a path are contracted by intervals, with the constants inside their bounds and the state unknown.
A finite bound of the variable is intersected with the result. If a side is still open, the tests are
contracted once more, with the state inside its bounds and the precondition: `?abs(u - w) <= 2` then limits u
by the limits of w at first, although w may leave these later.
"""

import math
from collections.abc import Callable, Mapping
from fractions import Fraction

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.interval.arithmetic import WHOLE, Interval, hull_of
from dl2c.interval.bounded import closed, initial_box, interval_of
from dl2c.interval.contract import contract
from dl2c.ir.logic import symbols
from dl2c.ir.model import AssignAny, Bound, Formula, Model, Symbol
from dl2c.paths import errors
from dl2c.paths.path import Input


def input_limits(
    model: Model,
    assignments: tuple[AssignAny, ...],
    tests: dict[str, list[Formula]],
    default: tuple[Fraction, Fraction] | None,
) -> tuple[Input, ...]:
    """One input per nondeterministic assignment.

    `tests` holds for each key the tests of every path that meets it, over the state and the
    input's symbol. `default` limits the sides that stay open.
    Raises `CompileError` naming each input that has no finite limits.
    """
    bounds = {v.name: v.bound for v in model.variables}
    found: list[Diagnostic] = []
    inputs: list[Input] = []
    for assignment in assignments:
        declared = bounds[assignment.variable]
        others = {a.key: interval_of(bounds[a.variable]) for a in assignments}
        own = tests.get(assignment.key, [])
        low, high = _implied(model, assignment.key, declared, own, others, {})
        if (low is None or high is None) and own:
            low, high = _implied(model, assignment.key, declared, own, others, _reached(model))
        if default is not None:
            low, high = closed(low, high, default)
        if low is None or high is None:
            found.append(errors.unbounded_input(assignment.variable, assignment.span))
        else:
            inputs.append(Input(assignment.key, assignment.variable, assignment.role, low, high))
    if found:
        raise CompileError(found)
    return tuple(inputs)


def _implied(
    model: Model,
    key: str,
    declared: Bound,
    tests: list[Formula],
    inputs: dict[str, Interval],
    state: Mapping[Symbol, Interval],
) -> tuple[Fraction | None, Fraction | None]:
    """The hull over all paths and over `state`, inside the declared bound; None where a side stays open."""
    symbol = Symbol(key, "input")
    found: list[Interval] = []
    for test in tests:
        box = {s: state.get(s, WHOLE) for s in symbols(test) | {symbol}}
        box |= {c.symbol: interval_of(c.bound, c.value) for c in model.constants}
        box |= {Symbol(name, "input"): limits for name, limits in inputs.items()}
        inside = contract(test, box)
        if inside is not None:
            found.append(inside[symbol])
    if not found:
        return declared.low, declared.high
    around = hull_of(found)
    low, high = _finite(around.low), _finite(around.high)
    return _last(declared.low, low, max), _last(declared.high, high, min)


def _reached(model: Model) -> dict[Symbol, Interval]:
    """Where variables are by their bounds and the precondition, as far as those say."""
    box = initial_box(model) or {}
    return {s: limits for s, limits in box.items() if s.kind == "variable"}


def _finite(end: float) -> Fraction | None:
    return Fraction(end) if math.isfinite(end) else None


def _last(
    declared: Fraction | None, implied: Fraction | None, tighter: Callable[[Fraction, Fraction], Fraction]
) -> Fraction | None:
    """The tighter of both ends. A declared one stays exact: as interval it was rounded outward."""
    if declared is None or implied is None:
        return implied if declared is None else declared
    return tighter(declared, implied)
