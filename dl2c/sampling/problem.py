"""What is to be sampled: the precondition of a model, made ready.

A model and what Z3 said about it come in; the names to draw and those that equalities
define, the formula over the reals, and a box around all initial states go out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

from dl2c.diagnostics import CompileError
from dl2c.interval.arithmetic import INF, Box, Interval, enclosure, meet, truth
from dl2c.interval.contract import contract
from dl2c.ir.logic import atoms, conjunction, conjuncts, disjunction, mapped, operands
from dl2c.ir.model import (
    And,
    Bound,
    Call,
    Compare,
    Constant,
    Formula,
    Model,
    Number,
    Or,
    Symbol,
    Term,
    Variable,
)
from dl2c.sampling.acceptance import LARGEST
from dl2c.sampling.equalities import Elimination, Unsolved, eliminate, replaced
from dl2c.sampling.refusal import beyond_doubles, transcendental, unbounded, unsolved
from dl2c.smt.precondition import Decision, Satisfiable, Unsatisfiable, diagnose, parts

ALGEBRAIC = ("abs", "min", "max", "sqrt")
"""The functions that may occur in a precondition."""

Items: TypeAlias = Mapping[Symbol, Variable | Constant]
"""The names to sample, in the order of `Model.sampled`, with their declarations."""


@dataclass(frozen=True, slots=True)
class Problem:
    """`formula` is the precondition without fixed constants; all of it holds only inside `box`.

    For the `free` names the box has finite doubles inside their bounds. The others are computed by
    `definitions`, in order; `rest` and their `bounds` then remain to be checked.
    """

    items: Items
    formula: Formula
    box: Box
    free: tuple[Symbol, ...]
    definitions: tuple[tuple[Symbol, Term], ...]
    rest: Formula
    bounds: Mapping[Symbol, Formula]


def problem_of(model: Model, decision: Decision) -> Problem:
    """The sampling problem of a model. Raises `CompileError` with the reason where there is none."""
    items = _items(model)
    formula = _precondition(model, items)
    box = _feasible_box(model, formula, items, decision)
    solved = _solved(formula, items, box)
    defined = dict(solved.definitions)
    free = tuple(s for s in items if s not in defined)
    if endless := [items[s] for s in free if not _is_finite(box[s])]:
        raise CompileError(unbounded(endless))
    return Problem(
        items=items,
        formula=formula,
        box=_drawable(box, free, items),
        free=free,
        definitions=solved.definitions,
        rest=conjunction(solved.rest),
        bounds={s: _within(items[s].bound, t if isinstance(t, Number) else s) for s, t in defined.items()},
    )


def _items(model: Model) -> dict[Symbol, Variable | Constant]:
    variables = {Symbol(v.name, "variable"): v for v in model.variables if v.initial == "sampled"}
    return {**variables, **{Symbol(c.name, "constant"): c for c in model.constants if c.value is None}}


def _precondition(model: Model, items: Items) -> Formula:
    """P with fixed constants replaced, and an equality for every bound that is a single number."""
    fixed: dict[Symbol, Term] = {
        Symbol(c.name, "constant"): Number(c.value) for c in model.constants if c.value is not None
    }
    formula = mapped(model.precondition, lambda t: replaced(t, fixed))
    points = [
        Compare("=", s, Number(item.bound.low), span=item.span)
        for s, item in items.items()
        if item.bound.low is not None and item.bound.low == item.bound.high
    ]
    return conjunction([formula, *points])


def _within(bound: Bound, term: Symbol | Number) -> Formula:
    sides: list[Formula] = []
    if bound.low is not None:
        sides.append(Compare(">=", term, Number(bound.low)))
    if bound.high is not None:
        sides.append(Compare("<=", term, Number(bound.high)))
    return conjunction(sides)


def _feasible_box(model: Model, formula: Formula, items: Items, decision: Decision) -> dict[Symbol, Interval]:
    """A box around all initial states. Intervals and Z3 must not contradict each other."""
    declared = {s: _outward(item.bound) for s, item in items.items()}
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


def _outward(bound: Bound) -> Interval:
    low = -INF if bound.low is None else enclosure(bound.low).low
    high = INF if bound.high is None else enclosure(bound.high).high
    return Interval(low, high)


def _inward(bound: Bound) -> Interval:
    low = -INF if bound.low is None else enclosure(bound.low).high
    high = INF if bound.high is None else enclosure(bound.high).low
    return Interval(low, high)


def _is_finite(interval: Interval) -> bool:
    return interval.low >= -LARGEST and interval.high <= LARGEST


def _drawable(box: Box, free: Sequence[Symbol], items: Items) -> dict[Symbol, Interval]:
    """The box with only such values of the free names as are doubles inside their bounds."""
    inside = {s: meet(box[s], _inward(items[s].bound)) for s in free}
    for symbol in (s for s in free if inside[s].empty):
        raise CompileError(beyond_doubles(items[symbol]))
    return {**box, **inside}


def _solved(formula: Formula, items: Items, box: Box) -> Elimination:
    for atom in atoms(formula):
        for call in (c for side in (atom.left, atom.right) for c in _calls(side)):
            if call.function not in ALGEBRAIC:
                raise CompileError(transcendental(call, atom))
    solved = eliminate(conjuncts(_possible(formula, box)), list(items), box)
    if isinstance(solved, Unsolved):
        raise CompileError(unsolved(solved.atom))
    return solved


def _calls(term: Term) -> Iterator[Call]:
    if isinstance(term, Call):
        yield term
    for operand in operands(term):
        yield from _calls(operand)


def _possible(formula: Formula, box: Box) -> Formula:
    """The formula without the alternatives that are false on the whole box."""
    match formula:
        case And(children):
            return conjunction(_possible(c, box) for c in children)
        case Or(children):
            return disjunction(_possible(c, box) for c in children if contract(c, box) is not None)
        case _:
            return formula
