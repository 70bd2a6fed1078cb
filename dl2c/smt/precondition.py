"""Whether a model has an initial state at all.

The precondition and the declared bounds come in; a witness, a contradiction in the
user's words, or the reason that neither was found goes out. All arithmetic is exact.
Answers are a function of the model, except that `Unknown` may depend on the time limit.
"""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.diagnostics import Diagnostic, error
from dl2c.ir.logic import atoms, conjuncts, limits_of, subterms
from dl2c.ir.model import And, Compare, Constant, Formula, Model, Number, Variable
from dl2c.ir.printer import print_bound, print_formula, print_number
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
from dl2c.source import NOWHERE, Span


@dataclass(frozen=True, slots=True)
class Part:
    """A top-level conjunct of the precondition, a bound, or a fixed constant."""

    text: str
    span: Span
    formula: Formula


@dataclass(frozen=True, slots=True)
class Satisfiable:
    """An initial state: exact values, or a decimal approximation (a string) of irrational ones."""

    witness: Mapping[str, Fraction | str]


@dataclass(frozen=True, slots=True)
class Unsatisfiable:
    """Parts that contradict each other; where time allowed, none can be left out."""

    core: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Unknown:
    """Neither a state nor a contradiction was found, and where that is known, because of what."""

    reason: str
    span: Span


Decision: TypeAlias = Satisfiable | Unsatisfiable | Unknown


def decide(model: Model, timeout_s: float = 10.0) -> Decision:
    """Whether some values inside the bounds satisfy the precondition; at most about `timeout_s` seconds."""
    deadline = time.monotonic() + timeout_s
    context = z3.Context()
    asserted: list[tuple[Part, Expression]] = []
    beyond: list[Unknown] = []
    for part in parts(model):
        try:
            asserted.append((part, condition(part.formula, context)))
        except Untranslatable as exc:
            beyond.append(_beyond_reals(part, exc))
        except TooLarge:
            beyond.append(Unknown("its powers and products are too large for Z3", span_of(part.formula)))
    solver = solver_of(context, [e for _, e in asserted], timeout_s)
    answer = answer_of(solver)
    if answer == z3.unsat:
        return Unsatisfiable(_minimal(context, asserted, deadline))
    if beyond:
        return beyond[0]
    if answer == z3.unknown:
        return Unknown(f"Z3 gave up: {solver.reason_unknown()}", span_of(model.precondition))
    return Satisfiable(solution_of(solver, model.sampled, context))


def parts(model: Model) -> tuple[Part, ...]:
    """What an initial state must satisfy, piece by piece, in the user's words."""
    declared = (*(v for v in model.variables if v.initial == "sampled"), *model.constants)
    conditions = (Part(text_of(c), span_of(c), c) for c in conjuncts(model.precondition))
    return (*conditions, *(p for d in declared for p in _declared(d)))


def _declared(item: Variable | Constant) -> Iterator[Part]:
    if isinstance(item, Constant) and item.value is not None:
        fixed = Compare("=", item.symbol, Number(item.value), span=item.span)
        yield Part(f"value of {item.name}: {print_number(item.value)}", item.span, fixed)
        return
    if sides := tuple(limits_of(item.symbol, item.bound, item.span)):
        yield Part(f"bound of {item.name}: {print_bound(item.bound)}", item.span, And(sides))


def diagnose(decision: Unsatisfiable | Unknown) -> Diagnostic:
    """The message for a precondition without, or without a known, initial state."""
    match decision:
        case Unsatisfiable(core):
            notes = dict.fromkeys(_note(p) for p in core)
            return error(
                "unsatisfiable-precondition",
                "no initial state satisfies the precondition",
                core[0].span if core else NOWHERE,
                label="contradicts the other conditions listed" if len(core) > 1 else "is never true",
                help="relax one of these conditions",
                notes=tuple(notes),
            )
        case Unknown(reason, span):
            return error(
                "undecided-precondition",
                "it is not known whether any initial state satisfies the precondition",
                span,
                label=reason,
                help='give the state with reset(options={"state": ...})',
            )
        case _:
            assert_never(decision)


def _minimal(
    context: Expression, asserted: list[tuple[Part, Expression]], deadline: float
) -> tuple[Part, ...]:
    """Drop one part after the other, bounds first, as long as the rest stays contradictory."""
    core = list(asserted)
    for item in reversed(asserted):
        left = deadline - time.monotonic()
        if left <= 0:
            break
        rest = [other for other in core if other is not item]
        if answer_of(solver_of(context, [e for _, e in rest], min(left, 1.0))) == z3.unsat:
            core = rest
    return tuple(part for part, _ in core)


def _beyond_reals(part: Part, exc: Untranslatable) -> Unknown:
    atom = next(a for a in atoms(part.formula) if exc.call in subterms(a))
    return Unknown(f"`{exc.call.function}` in `{text_of(atom)}` is beyond real arithmetic", atom.span)


def span_of(formula: Formula) -> Span:
    """From the first to the last atom, as far as they lie in one text."""
    spans = [a.span for a in atoms(formula)]
    span = spans[0] if spans else NOWHERE
    for other in spans[1:]:
        if other.source is span.source:
            span = span.to(other)
    return span


def text_of(formula: Formula) -> str:
    """What the user wrote, on one line."""
    return " ".join(span_of(formula).text.split()) or print_formula(formula)


def _note(part: Part) -> str:
    return f"{part.text} ({part.span.place})" if part.span != NOWHERE else part.text
