"""Draw a name between limits that other names set, instead of anywhere.

A chart comes in; a chart of the same states goes out in which some names are given by where they lie,
between 0 and 1, on the way from their lower to their upper limit. The length of that way is part of the
density, so the law stays what it was, and thin bands and long chains of `<=` are hit at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce

from dl2c.interval.arithmetic import Interval
from dl2c.interval.contract import contract
from dl2c.ir.logic import conjunction, conjuncts, symbols, times
from dl2c.ir.model import ZERO, Add, Call, Compare, Formula, Mul, Number, Sub, Symbol, Term
from dl2c.ir.normal import normal_form
from dl2c.sampling.algebra import term_of
from dl2c.sampling.charts import Chart
from dl2c.sampling.linear import linear_parts

MOST = 8
"""Names of a chart that are drawn in this way."""


@dataclass(frozen=True, slots=True)
class _Limits:
    symbol: Symbol
    lows: tuple[Term, ...]
    highs: tuple[Term, ...]


def conditional(chart: Chart) -> Chart | None:
    """The chart with names between limits; None where no name has such limits."""
    left = [s for s in chart.free if chart.box[s].low < chart.box[s].high]
    atoms = [a for a in conjuncts(chart.rest) if isinstance(a, Compare) and _is_usable(a, left)]
    chosen: list[_Limits] = []
    while len(chosen) < MOST and (found := [m for s in left if (m := _limits(s, atoms)) is not None]):
        best = max(found, key=lambda m: len(m.lows) + len(m.highs) - len(m.lows) * len(m.highs))
        chosen.append(best)
        left.remove(best.symbol)
        atoms = [a for a in atoms if best.symbol not in symbols(a)]
        atoms += [Compare("<=", low, high) for low in best.lows for high in best.highs]
        atoms = [a for a in atoms if len(symbols(a)) > 1]
    result: Chart | None = chart if chosen else None
    for limits in reversed(chosen):
        result = None if result is None else _drawn_between(result, limits)
    return result


def _is_usable(atom: Compare, names: Sequence[Symbol]) -> bool:
    """Whether it is a limit of drawn names by others."""
    used = symbols(atom)
    return atom.op in ("<", "<=", ">", ">=") and len(used) > 1 and used <= set(names)


def _limits(symbol: Symbol, atoms: Sequence[Compare]) -> _Limits | None:
    lows: list[Term] = []
    highs: list[Term] = []
    for atom in (a for a in atoms if symbol in symbols(a)):
        parts = linear_parts(Sub(atom.left, atom.right), symbol)
        if parts is None or not isinstance(parts[0], Number) or parts[0] == ZERO:
            return None
        value = _plain(times(Number(-1 / parts[0].value), parts[1]))
        upper = (atom.op in ("<", "<=")) == (parts[0].value > 0)
        (highs if upper else lows).append(value)
    return _Limits(symbol, tuple(lows), tuple(highs)) if lows or highs else None


def _plain(term: Term) -> Term:
    """The term multiplied out where it is a polynomial."""
    form = normal_form(term)
    return term if form is None else term_of(form, {(s.kind, s.name): s for s in symbols(term)})


def _drawn_between(chart: Chart, limits: _Limits) -> Chart | None:
    symbol, box = limits.symbol, chart.box[limits.symbol]
    low = reduce(lambda a, b: Call("max", (a, b)), limits.lows, _number(box.low))
    high = reduce(lambda a, b: Call("min", (a, b)), limits.highs, _number(box.high))
    part, width = _part_of(symbol, chart), Sub(high, low)
    term = Add(low, Mul(part, width))
    formula = conjunction([chart.formula, Compare("=", symbol, term)])
    around = contract(formula, {**chart.box, part: Interval(0.0, 1.0)})
    if around is None:
        return None
    measure = replace(
        chart.measure,
        squared=times(chart.measure.squared, Mul(width, width)),
        widths=(*chart.measure.widths, _differences(limits, box)),
    )
    low_end, high_end = _number(box.low), _number(box.high)
    inside: list[Formula] = [Compare(">=", symbol, low_end), Compare("<=", symbol, high_end)]
    return replace(
        chart,
        free=tuple(part if s == symbol else s for s in chart.free),
        between=(*chart.between, (symbol, term)),
        rest=conjunction([chart.rest, *inside]),
        formula=formula,
        box={**around, part: Interval(0.0, 1.0)},
        measure=measure,
    )


def _differences(limits: _Limits, box: Interval) -> tuple[Term, ...]:
    """What the width is the least of; names in both limits cancel."""
    lows, highs = (*limits.lows, _number(box.low)), (*limits.highs, _number(box.high))
    known = {(s.kind, s.name): s for t in (*lows, *highs) for s in symbols(t)}
    pairs = [Sub(high, low) for high in highs for low in lows]
    forms = [normal_form(pair) for pair in pairs]
    return tuple(p if f is None else term_of(f, known) for p, f in zip(pairs, forms, strict=True))


def _number(value: float) -> Number:
    return Number(Fraction(value))


def _part_of(symbol: Symbol, chart: Chart) -> Symbol:
    """A name that nothing else has."""
    name, taken = f"part_of_{symbol.name}", {s.name for s in chart.box}
    while name in taken:
        name += "_"
    return Symbol(name, "input")
