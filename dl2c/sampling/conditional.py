"""Draw a name between limits that other names set, instead of anywhere.

A chart comes in; a chart of the same states goes out in which some names are given by where they lie,
between 0 and 1, on the way from their lower to their upper limit. The length of that way is part of the
density, so the law stays what it was, and thin bands and long chains of `<=` are hit at once. Limits
follow from the precondition, which is tested as before: what is not a limit of a name by terms is left out.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from typing import TypeAlias

from dl2c.interval.arithmetic import Interval, evaluate, magnitude
from dl2c.interval.contract import contract
from dl2c.interval.rounding import div_down
from dl2c.ir.logic import conjunction, conjuncts, minus, plus, size, symbols, times
from dl2c.ir.model import ZERO, Add, Call, Compare, Div, Formula, Mul, Neg, Number, Sub, Symbol, Term
from dl2c.ir.normal import divided, normal_form
from dl2c.sampling.charts import Chart
from dl2c.sampling.equalities.algebra import term_of
from dl2c.sampling.equalities.linear import linear_parts, replaced
from dl2c.sampling.equalities.root_of import RootOf

MOST = 12
"""Names of a chart that are drawn in this way."""

LONGEST_LIMIT = 60
"""Numbers, names and operations of a limit: each contraction goes through it."""

MOST_LIMITS = 64
"""Atoms that are considered as limits."""


@dataclass(frozen=True, slots=True)
class _Limits:
    """What a name is not below and not above, and what the way between is not longer than."""

    symbol: Symbol
    lows: tuple[Term, ...]
    highs: tuple[Term, ...]
    widths: tuple[Term, ...] = ()


def conditional(chart: Chart) -> Chart | None:
    """The chart with names between limits; None where no name has such limits."""
    left = list(chart.wide)
    values = _definitions(chart)
    atoms = _usable(_atoms(chart, values), left)
    products = {s: p for s in left if (p := _of_products(s, chart, values)) is not None}
    chosen: list[_Limits] = []
    while len(chosen) < MOST and (found := [m for s in left if (m := _limits(s, atoms, products, left))]):
        best = max(found, key=lambda m: len(m.lows) + len(m.highs) - len(m.lows) * len(m.highs))
        chosen.append(best)
        left.remove(best.symbol)
        atoms = [(a, names) for a, names in atoms if best.symbol not in names]
        if not best.widths:
            between = [Compare("<=", low, high) for low in best.lows for high in best.highs]
            atoms += _usable(between, left)
        atoms = atoms[:MOST_LIMITS]
    result: Chart | None = chart if chosen else None
    for limits in reversed(chosen):
        result = None if result is None else _drawn_between(result, limits)
    return result


def _definitions(chart: Chart) -> dict[Symbol, Term]:
    """Short definitions, over drawn names alone."""
    values: dict[Symbol, Term] = {}
    for symbol, term in chart.definitions:
        if isinstance(term, RootOf):
            continue
        value = replaced(term, values)
        if size(value) <= LONGEST_LIMIT and symbols(value) <= set(chart.free):
            values[symbol] = value
    return values


def _atoms(chart: Chart, values: Mapping[Symbol, Term]) -> list[Compare]:
    """What must hold between drawn names, shortest first."""
    wanted = [*conjuncts(chart.rest), *(c for bound in chart.bounds.values() for c in conjuncts(bound))]
    found = [
        Compare(a.op, replaced(a.left, values), replaced(a.right, values))
        for a in wanted
        if isinstance(a, Compare) and a.op in ("<", "<=", ">", ">=")
    ]
    sized = sorted((size(a), k) for k, a in enumerate(found))
    return [found[k] for size, k in sized if size <= LONGEST_LIMIT][:MOST_LIMITS]


Used: TypeAlias = list[tuple[Compare, set[Symbol]]]
"""Atoms, each with its symbols."""


def _usable(atoms: Sequence[Compare], names: Sequence[Symbol]) -> Used:
    """Those that are limits of names by others."""
    used = [(a, symbols(a)) for a in atoms]
    return [(a, found) for a, found in used if len(found) > 1 and found <= set(names)]


def _limits(
    symbol: Symbol, atoms: Used, products: Mapping[Symbol, _Limits], left: Sequence[Symbol]
) -> _Limits | None:
    lows: list[Term] = []
    highs: list[Term] = []
    for atom in (a for a, names in atoms if symbol in names):
        parts = linear_parts(Sub(atom.left, atom.right), symbol)
        if parts is None or not isinstance(parts[0], Number) or parts[0] == ZERO:
            continue
        value = _plain(times(Number(-1 / parts[0].value), parts[1]))
        upper = (atom.op in ("<", "<=")) == (parts[0].value > 0)
        (highs if upper else lows).append(value)
    if lows or highs:
        return _Limits(symbol, tuple(dict.fromkeys(lows)), tuple(dict.fromkeys(highs)))
    product = products.get(symbol)
    return product if product is not None and symbols(product.lows[0]) <= set(left) else None


def _of_products(symbol: Symbol, chart: Chart, values: Mapping[Symbol, Term]) -> _Limits | None:
    """Limits around `centre`, where a bounded name is defined as `factor * (symbol - centre)`."""
    for defined, term in values.items():
        around = chart.box[defined]
        if symbol not in symbols(term) or not math.isfinite(largest := magnitude(around).high):
            continue
        parts = linear_parts(term, symbol)
        if parts is None or isinstance(parts[0], Number) or (centre := _centre(*parts)) is None:
            continue
        farthest = magnitude(evaluate(Sub(symbol, centre), chart.box)).high
        if largest == 0 or farthest == 0 or not math.isfinite(farthest):
            continue
        least = _number(div_down(largest, farthest))
        half = Div(_number(largest), Call("max", (Call("abs", (parts[0],)), least)))
        return _Limits(
            symbol, (minus(centre, half),), (plus(centre, half),), (Mul(Number(Fraction(2)), half),)
        )
    return None


def _centre(factor: Term, rest: Term) -> Term | None:
    """-rest / factor, where that is a polynomial."""
    above, below = normal_form(Neg(rest)), normal_form(factor)
    if above is None or below is None or len(below) != 1:
        return None
    ((monomial, value),) = below.items()
    for kind, name, exponent in monomial:
        if any((kind, name) not in {(k, n) for k, n, e in m if e >= exponent} for m in above):
            return None
        above = divided(above, (kind, name), exponent)
    return term_of({m: c / value for m, c in above.items()})


def _plain(term: Term) -> Term:
    """The term multiplied out where it is a polynomial."""
    form = normal_form(term)
    return term if form is None else term_of(form)


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
        widths=(*chart.measure.widths, (*_differences(limits, box), *limits.widths)),
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
    pairs = [Sub(high, low) for high in highs for low in lows]
    forms = [normal_form(pair) for pair in pairs]
    return tuple(p if f is None else term_of(f) for p, f in zip(pairs, forms, strict=True))


def _number(value: float) -> Number:
    return Number(Fraction(value))


def _part_of(symbol: Symbol, chart: Chart) -> Symbol:
    """A name that nothing else has."""
    name, taken = f"part_of_{symbol.name}", {s.name for s in chart.box}
    while name in taken:
        name += "_"
    return Symbol(name, "input")
