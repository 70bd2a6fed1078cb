"""The conditions of the model that an episode violated, with their places in its text and their values."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

from dl2c.diagnostics import Diagnostic, error
from dl2c.env.opening import compilation_of
from dl2c.ir.arrays import Columns, margins, truths, values
from dl2c.ir.logic import symbols
from dl2c.ir.model import And, Compare, Formula, Model, Or, Predicate, Symbol, Truth
from dl2c.ir.printer import print_formula
from dl2c.report.episode import Episode, Moment

PRECISION = 9
"""Significant digits of numbers in messages."""


@dataclass(frozen=True, slots=True)
class Violation:
    """A condition that failed in a step; `step` counts from 1."""

    what: str
    formula: Formula
    step: int
    predicate: Predicate | None = None


def model_of(episode: Episode) -> Model:
    """The model of an episode; its names need no bounds. Raises `CompileError`."""
    return compilation_of(episode.source, episode.options).unbounded


def columns_of(model: Model, state: Mapping[str, float]) -> dict[Symbol, float]:
    """The values of a state, which is given by names, by symbols."""
    constants = {Symbol(c.name, "constant"): state[c.name] for c in model.constants}
    return {Symbol(v.name, "variable"): state[v.name] for v in model.variables} | constants


def blamed(episode: Episode, model: Model) -> tuple[Diagnostic, ...]:
    """The conditions that failed, each with its place and its values; none where no condition did."""
    return tuple(d for v in violations(episode, model) for d in _diagnostics(v, episode, model))


def violations(episode: Episode, model: Model) -> Iterator[Violation]:
    """The predicate that ended the episode in failure; else the @safety predicates that failed in the first
    step in which some did; else the postcondition, in the first step after which it is false.
    """
    last = len(episode.moments)
    ending = [p for p in model.predicates if p.name == episode.reason and episode.status == "failure"]
    if ending:
        p = ending[0]
        what = f"the {p.category} predicate `{p.name}`"
        yield Violation(what, p.formula, last, p)
        return
    for step, m in enumerate(episode.moments, 1):
        if m.cost > 0:
            yield from _unsafe(model, m, step)
            return
    if model.postcondition is not None:
        for step, m in enumerate(episode.moments, 1):
            if not m.postcondition:
                yield Violation("the postcondition", model.postcondition, step)
                return


def _unsafe(model: Model, m: Moment, step: int) -> Iterator[Violation]:
    """The @safety predicates with the least margins after the step, as many as its cost counts."""
    columns = columns_of(model, m.state)
    safety = [p for p in model.predicates if p.category == "safety"]
    for p in sorted(safety, key=lambda p: float(margins(p.formula, columns)))[: m.cost]:
        yield Violation(f"the safety predicate `{p.name}`", p.formula, step, p)


def _diagnostics(violation: Violation, episode: Episode, model: Model) -> Iterator[Diagnostic]:
    step = violation.step
    before, after = (columns_of(model, episode.states[k]) for k in (step - 1, step))
    title = f"{violation.what} fails in step {step}"
    m = episode.moments[step - 1]
    action = f"action {m.action}, {m.duration:.6g} s" + (", blocked" if m.blocked else "")
    when = f"the step ends at time {m.time:.6g} s ({action})"
    due = violation.predicate.due if violation.predicate else None
    for atom in critical(violation.formula, before, after):
        notes = [when, _state_note(model, atom, before, after)]
        if violation.predicate is not None and violation.predicate.category == "progress" and due is not None:
            notes.append(f"it must hold where {print_formula(due)}")
        yield error("violated", title, atom.span, _label(atom, after), notes=tuple(notes))


def critical(formula: Formula, before: Columns, after: Columns) -> tuple[Compare, ...]:
    """The atoms that made a formula false: in a conjunction those of its false parts; in a disjunction those
    of the parts that held before the step or, if none did, of the part that is nearest to holding.

    If no part of a conjunction is false after the step, since it failed along a flow or by rounding, the part
    with the least margin is taken.
    """
    match formula:
        case Truth():
            return ()
        case Compare():
            return (formula,)
        case And(children):
            wrong = [c for c in children if not truths(c, after)]
            chosen: Sequence[Formula] = wrong or [min(children, key=lambda c: float(margins(c, after)))]
        case Or(children):
            held = [c for c in children if truths(c, before)]
            chosen = held or [max(children, key=lambda c: float(margins(c, after)))]
        case _:
            assert_never(formula)
    return tuple(dict.fromkeys(atom for c in chosen for atom in critical(c, before, after)))


def _label(atom: Compare, after: Columns) -> str:
    left, right = (float(values(side, after)) for side in (atom.left, atom.right))
    digits = next((n for n in range(PRECISION, 17) if f"{left:.{n}g}" != f"{right:.{n}g}"), 17)
    sides = f"{left:.{digits}g} {atom.op} {right:.{digits}g}"
    return f"{sides} is false" if not truths(atom, after) else f"{sides} is closest to failing"


def _state_note(model: Model, atom: Compare, before: Columns, after: Columns) -> str:
    """The names in an atom with their values, and what they were before the step."""
    units = {q.name: q.unit for q in (*model.variables, *model.constants)}

    def shown(s: Symbol) -> str:
        now, then = float(after[s]), float(before[s])
        unit = f" {units[s.name]}" if units[s.name] else ""
        return f"{s.name} = {_number(now)}{unit}" + (f" (was {_number(then)})" if now != then else "")

    return ", ".join(shown(s) for s in sorted(symbols(atom), key=lambda s: s.name)) or "no names occur in it"


def _number(value: float | Fraction) -> str:
    return f"{float(value):.{PRECISION}g}"
