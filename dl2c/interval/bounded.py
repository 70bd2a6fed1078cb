"""Finite limits for names that neither a declared bound nor the precondition limits.

A model and a default come in; the model with such limits goes out. A side that is limited already
stays as it is. Names are limited in order, and each new limit contracts the ranges of the others:
with `x + 1 <= y`, a limit `0 <= x` also limits y from below.
"""

from dataclasses import replace
from fractions import Fraction
from math import isfinite
from typing import TypeAlias, TypeVar

from dl2c.interval.arithmetic import WHOLE, Interval, enclosure
from dl2c.interval.contract import contract
from dl2c.ir.logic import symbols
from dl2c.ir.model import Bound, Constant, Model, Symbol, Variable

Range: TypeAlias = tuple[Fraction, Fraction]
_Item = TypeVar("_Item", Variable, Constant)


def bounded(model: Model, default: Range) -> Model:
    """The model with finite bounds for all names that are drawn and that nothing else limits."""
    bounds = {item.symbol: item.bound for item in model.drawn}
    box = initial_box(model)
    for symbol, bound in bounds.items():
        limits = (box or {}).get(symbol, WHOLE)
        low, high = _finite(limits.low), _finite(limits.high)
        if low is not None and high is not None:
            continue
        ends = closed(low, high, default)
        bounds[symbol] = _completed(bound, limits, ends)
        if box is not None:
            box = contract(model.precondition, {**box, symbol: interval_of(Bound(*ends))})
    return replace(
        model,
        variables=tuple(_with(v, bounds.get(v.symbol)) for v in model.variables),
        constants=tuple(_with(c, bounds.get(c.symbol)) for c in model.constants),
    )


def initial_box(model: Model) -> dict[Symbol, Interval] | None:
    """A box around all initial states, from bounds, fixed constants and the precondition; None if empty."""
    box: dict[Symbol, Interval] = dict.fromkeys(symbols(model.precondition), WHOLE)
    for variable in model.variables:
        box[variable.symbol] = interval_of(variable.bound)
    for constant in model.constants:
        box[constant.symbol] = interval_of(constant.bound, constant.value)
    return None if any(i.empty for i in box.values()) else contract(model.precondition, box)


def closed(low: Fraction | None, high: Fraction | None, default: Range) -> Range:
    """Open sides taken from the default; if the range would be empty, one as wide as the default."""
    width = default[1] - default[0]
    match low, high:
        case None, None:
            return default
        case None, Fraction():
            return (default[0] if default[0] < high else high - width), high
        case Fraction(), None:
            return low, (default[1] if default[1] > low else low + width)
        case _:
            assert low is not None and high is not None
            return low, high


def _completed(bound: Bound, limits: Interval, ends: Range) -> Bound:
    """The bound, with ends where nothing limits it; sides that the precondition limits stay open."""
    low = ends[0] if not isfinite(limits.low) else bound.low
    return Bound(low, ends[1] if not isfinite(limits.high) else bound.high)


def _with(item: _Item, bound: Bound | None) -> _Item:
    return item if bound is None else replace(item, bound=bound)


def interval_of(bound: Bound, value: Fraction | None = None) -> Interval:
    """What encloses a fixed value, or all numbers inside the bound."""
    if value is not None:
        return enclosure(value)
    low = WHOLE.low if bound.low is None else enclosure(bound.low).low
    return Interval(low, WHOLE.high if bound.high is None else enclosure(bound.high).high)


def _finite(end: float) -> Fraction | None:
    return Fraction(end) if isfinite(end) else None
