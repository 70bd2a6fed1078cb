"""What is to be sampled: the precondition of a model, made ready.

A model and what Z3 said about it come in; the formula over the reals, a box around all initial
states, and charts of them go out.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

from dl2c.diagnostics import CompileError
from dl2c.interval.arithmetic import Box, Interval, truth
from dl2c.interval.bounded import interval_of
from dl2c.interval.contract import contract
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import atoms, conjunction, disjunction, fixed_values, mapped, subterms
from dl2c.ir.model import And, Bound, Call, Compare, Formula, Model, Number, Or, Symbol
from dl2c.sampling.blocks import groups_of
from dl2c.sampling.cases import resolved
from dl2c.sampling.charts import Chart, Items, charts_of, without_numbers
from dl2c.sampling.equalities.linear import replaced
from dl2c.sampling.refusal import transcendental, unbounded
from dl2c.smt.precondition import Decision, Satisfiable, Unsatisfiable, diagnose, parts


@dataclass(frozen=True, slots=True)
class Support:
    """`formula` is the precondition without fixed constants; it holds only inside `box`. The initial
    states are all combinations of one state of each block; the charts of a block hold each of its states
    once, but for a set of lower dimension."""

    items: Items
    formula: Formula
    box: Mapping[Symbol, Interval]
    blocks: tuple[tuple[Chart, ...], ...]


def support_of(model: Model, decision: Decision) -> Support:
    """The support of the initial states. Raises `CompileError` with the reason where there is none."""
    items: Items = {item.symbol: item for item in model.drawn}
    formula = _precondition(model, items)
    box = _feasible_box(model, formula, items, decision)
    for call, atom in transcendental_calls(formula):
        raise CompileError(transcendental(call, atom))
    prepared = resolved(without_numbers(_possible(formula, box)))
    blocks = [
        charts_of(group.formula, {n: items[n] for n in group.names}, {n: box[n] for n in group.names})
        for group in groups_of(prepared, list(items))
    ]
    endless = {s for charts in blocks for chart in charts for s in chart.endless}
    if endless:
        raise CompileError(unbounded([item for s, item in items.items() if s in endless]))
    return Support(items, formula, box, tuple(blocks))


def _precondition(model: Model, items: Items) -> Formula:
    """P with fixed constants replaced, and an equality for every bound that is a single number."""
    fixed = fixed_values(model)
    formula = mapped(model.precondition, lambda t: replaced(t, fixed))
    points = [
        Compare("=", s, Number(item.bound.low), span=item.span)
        for s, item in items.items()
        if item.bound.low is not None and item.bound.low == item.bound.high
    ]
    return conjunction([formula, *points])


def _feasible_box(model: Model, formula: Formula, items: Items, decision: Decision) -> dict[Symbol, Interval]:
    """A box around all initial states. Intervals and Z3 must not contradict each other."""
    declared = {s: interval_of(item.bound) for s, item in items.items()}
    box = None if any(_is_contradictory(i.bound) for i in items.values()) else contract(formula, declared)
    match decision:
        case Unsatisfiable():
            assert box is None or truth(formula, declared) != "true", "intervals prove what Z3 refutes"
            raise CompileError(diagnose(decision))
        case Satisfiable(witness):
            assert box is not None, "intervals refute what Z3 satisfies"
            exact = {s: w for s in items if isinstance(w := witness[s.name], Fraction)}
            assert all(box[s].contains(w) for s, w in exact.items()), "intervals lose a state that Z3 found"
            return box
        case _:
            if box is None:
                raise CompileError(diagnose(Unsatisfiable(parts(model))))
            return box


def _is_contradictory(bound: Bound) -> bool:
    return bound.low is not None and bound.high is not None and bound.low > bound.high


def transcendental_calls(formula: Formula) -> Iterator[tuple[Call, Compare]]:
    """Functions that may not occur in a precondition, each with the comparison that it is in."""
    for atom in atoms(formula):
        for term in subterms(atom):
            if isinstance(term, Call) and not FUNCTIONS[term.function].exact:
                yield term, atom


def _possible(formula: Formula, box: Box) -> Formula:
    """The formula without the alternatives that are false on the whole box."""
    match formula:
        case And(children):
            return conjunction(_possible(c, box) for c in children)
        case Or(children):
            return disjunction(_possible(c, box) for c in children if contract(c, box) is not None)
        case _:
            return formula
