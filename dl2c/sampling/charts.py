"""The initial states as charts: names to draw, and definitions of the others.

A precondition and a box around it come in. Where equalities hold in some alternatives only, the states
of the highest dimension are kept: all others together have measure zero among them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.interval.arithmetic import INF, Box, Interval, enclosure, meet
from dl2c.interval.contract import contract
from dl2c.ir.logic import conjunction, conjuncts, limits_of, mapped, negation, oriented, symbols
from dl2c.ir.model import ZERO, Bound, Compare, Constant, Formula, Number, Sub, Symbol, Term, Variable
from dl2c.ir.normal import normal_form
from dl2c.ir.slack import equalities_relaxed, sides_of
from dl2c.sampling.acceptance import LARGEST
from dl2c.sampling.cases import Conjuncts, TooMany, alternatives
from dl2c.sampling.equalities.algebra import term_of
from dl2c.sampling.equalities.linear import replaced
from dl2c.sampling.equalities.measure import Measure, TooEntangled, measure_of
from dl2c.sampling.equalities.root_of import Definition, RootOf
from dl2c.sampling.equalities.solve import Elimination, Unsolved, eliminate
from dl2c.sampling.refusal import beyond_doubles, entangled, unsolved, without_sample

Items: TypeAlias = Mapping[Symbol, Variable | Constant]
"""The names to sample, in the order of `Model.sampled`, with their declarations."""

CLOSE = Fraction(1, 10**9)
"""Alternatives count as one where their equalities are as close as this, relative to their sides."""


@dataclass(frozen=True, slots=True)
class Chart:
    """Some of the initial states, each given by its `free` names.

    The ends of `box` are doubles inside their bounds; `definitions` give all other
    names, in order. `rest` is what else must hold, and for each defined name the condition of
    `bounds`; `formula` says the same with equalities and without the boundaries of charts, to contract
    boxes with. `between` are names that
    are computed first and count as drawn: whatever their doubles are, they are exact.
    """

    free: tuple[Symbol, ...]
    definitions: tuple[tuple[Symbol, Definition], ...]
    rest: Formula
    bounds: Mapping[Symbol, Formula]
    formula: Formula
    box: Mapping[Symbol, Interval]
    measure: Measure
    between: tuple[tuple[Symbol, Term], ...] = ()

    @property
    def endless(self) -> tuple[Symbol, ...]:
        """Free names without finite limits."""
        return tuple(s for s in self.free if not _is_finite(self.box[s]))

    @property
    def wide(self) -> tuple[Symbol, ...]:
        """Free names with more than one value."""
        return tuple(s for s in self.free if self.box[s].low < self.box[s].high)

    @property
    def dimension(self) -> int:
        """How many names can vary."""
        return len(self.wide)


def charts_of(formula: Formula, items: Items, box: Box) -> tuple[Chart, ...]:
    """Charts that hold every initial state once, but for a set of measure zero.

    Raises `CompileError` with the reason where there are none.
    """
    try:
        cases = tuple(map(_with_implied, alternatives(formula, box)))
        found, open_ = _solved_cases(cases, items, box)
    except (TooMany, TooEntangled) as exc:
        raise CompileError(entangled(formula, isinstance(exc, TooMany))) from None
    highest = max((c.dimension for charts in found for c in charts), default=0)
    if open_ is not None and (not any(found) or open_.equalities <= len(items) - highest):
        raise CompileError(unsolved(open_.atom))
    kept = [[c for c in charts if c.dimension == highest] for charts in found]
    if not any(kept):
        raise CompileError(_impossible(formula, items, box))
    return tuple(_disjoint(kept, cases, box))


def without_numbers(formula: Formula) -> Formula:
    """Names that a top-level equality makes a number replaced in everything else."""
    numbers: dict[Symbol, Compare] = {}
    while new := {s: e for s, e in map(_fixed, conjuncts(formula)) if s is not None and s not in numbers}:
        numbers |= new
        values: dict[Symbol, Term] = {s: e.right for s, e in new.items()}
        formula = mapped(formula, lambda t, v=values: replaced(t, v))
    return conjunction([formula, *numbers.values()])


def _fixed(conjunct: Formula) -> tuple[Symbol | None, Compare]:
    match conjunct:
        case Compare("=", Symbol() as symbol, Number()):
            return symbol, conjunct
        case Compare("=", Number() as value, Symbol() as symbol):
            return symbol, Compare("=", symbol, value, span=conjunct.span)
        case _:
            return None, Compare("=", Number(Fraction(0)), Number(Fraction(0)))


def _with_implied(case: Conjuncts) -> Conjuncts:
    """Two conjuncts `a <= b` and `b <= a` say `a = b`."""
    found: dict[frozenset[tuple[object, Fraction]], Compare] = {}
    result = list(case)
    for atom in (oriented(c) for c in case):
        if not (isinstance(atom, Compare) and atom.op in ("<=", ">=")):
            continue
        left, right = (atom.left, atom.right) if atom.op == "<=" else (atom.right, atom.left)
        form = normal_form(Sub(left, right))
        if form is None:
            continue
        if frozenset((m, -c) for m, c in form.items()) in found:
            result.append(Compare("=", left, right, span=atom.span))
        found[frozenset(form.items())] = atom
    return tuple(result)


def _solved_cases(
    cases: Sequence[Conjuncts], items: Items, box: Box
) -> tuple[list[list[Chart]], Unsolved | None]:
    """The charts of each case, and what could not be solved of the least restricted other one."""
    found: list[list[Chart]] = []
    open_: Unsolved | None = None
    for case in cases:
        charts: list[Chart] = []
        around = contract(conjunction(case), box)
        solved = () if around is None else eliminate(case, list(items), around)
        if isinstance(solved, Unsolved):
            open_ = solved if open_ is None or solved.equalities < open_.equalities else open_
            solved = ()
        for elimination in solved:
            if around is not None and (chart := _chart(elimination, case, items, around)) is not None:
                charts.append(chart)
        found.append(charts)
    return found, open_


def _chart(elimination: Elimination, case: Conjuncts, items: Items, box: Box) -> Chart | None:
    defined = dict(elimination.definitions)
    free = tuple(s for s in items if s not in defined)
    bent = {row.symbol for row in elimination.rows}
    equal = [
        Compare("=", s, t) for s, t in elimination.definitions if s in bent and not isinstance(t, RootOf)
    ]
    further = [_inner(c) for c in elimination.rest if c not in case]
    formula = conjunction([*case, *further, *equal, *_shortened(elimination)])
    around = contract(formula, box)
    if around is None:
        return None
    inside = {s: meet(around[s], inward(items[s].bound)) for s in free}
    if any(i.empty for i in inside.values()):
        return None
    return Chart(
        free=free,
        definitions=elimination.definitions,
        rest=conjunction(elimination.rest),
        bounds={
            s: conjunction(limits_of(t if isinstance(t, Number) else s, items[s].bound))
            for s, t in defined.items()
        },
        formula=formula,
        box={**around, **inside},
        measure=measure_of(elimination),
    )


def _inner(condition: Formula) -> Formula:
    """Without its boundary, where charts meet: a set of measure zero."""
    match condition:
        case Compare("<=" | ">=" as op, left, right):
            return Compare("<" if op == "<=" else ">", left, right, span=condition.span)
        case _:
            return condition


def _shortened(elimination: Elimination) -> Iterator[Compare]:
    """Conjuncts that lose names where defined ones are replaced by their polynomials: intervals do not see
    that these cancel."""
    values = {
        s: t for s, t in elimination.definitions if not isinstance(t, RootOf) and normal_form(t) is not None
    }
    for atom in elimination.rest:
        if not isinstance(atom, Compare) or not symbols(atom) & values.keys():
            continue
        difference = replaced(Sub(atom.left, atom.right), values)
        form = normal_form(difference)
        if form is not None and len(symbols(shorter := term_of(form))) < len(symbols(difference)):
            yield Compare(atom.op, shorter, ZERO, span=atom.span)


def _impossible(formula: Formula, items: Items, box: Box) -> Diagnostic:
    """Why no case has a chart."""
    for symbol, item in items.items():
        if meet(box[symbol], inward(item.bound)).empty:
            return beyond_doubles(item)
    return without_sample(formula)


def _disjoint(kept: Sequence[Sequence[Chart]], cases: Sequence[Conjuncts], box: Box) -> Iterator[Chart]:
    """The charts of each case without the states of earlier cases. Where those ask for `!=`, states at which
    the sides are close are left to the later case: no computed values are exactly equal for certain.
    """
    earlier: list[Formula] = []
    for charts, case in zip(kept, cases, strict=True):
        for chart in charts:
            others = [e for e in earlier if contract(conjunction([e, chart.formula]), box) is not None]
            outside = mapped(
                equalities_relaxed(conjunction(negation(e) for e in others), CLOSE, sides_of),
                lambda t, c=chart: replaced(t, {s: v for s, v in c.definitions if isinstance(v, Number)}),
            )
            yield replace(
                chart,
                rest=conjunction([chart.rest, outside]),
                formula=conjunction([chart.formula, outside]),
            )
        if charts:
            earlier.append(equalities_relaxed(conjunction(case), CLOSE, sides_of))


def inward(bound: Bound) -> Interval:
    """From the first to the last double inside a bound."""
    low = -INF if bound.low is None else enclosure(bound.low).high
    high = INF if bound.high is None else enclosure(bound.high).low
    return Interval(low, high)


def _is_finite(interval: Interval) -> bool:
    return interval.low >= -LARGEST and interval.high <= LARGEST
