"""From a model to its monitor: the checks asked for, their conditions numbered.

The init check is the precondition. The safety check is every annotated safety predicate and the
postcondition, strict, without the tolerance that rewards have, and the loop's invariant: that is within
the tolerance of computed values, since states lie on its boundary by design.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import count
from typing import assert_never

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.ir.logic import conjunction, conjuncts, disjunction
from dl2c.ir.model import TRUE, And, Compare, Formula, Model, Or, Truth
from dl2c.ir.printer import print_formula
from dl2c.ir.slack import relaxed, sides_of
from dl2c.monitor.check import KINDS, OUT_OF_RANGE, Case, Check, Condition, Kind, Monitor, Tolerance
from dl2c.monitor.control import control_paths, controller_check, place_of
from dl2c.monitor.plant import model_check
from dl2c.monitor.runs import controller_of
from dl2c.source import NOWHERE

DRIFT = 1000
"""Steps whose errors may add up in an equality that motion only keeps numerically: those of an episode."""

ALWAYS: tuple[Kind, ...] = ("init", "controller")
"""The kinds whose absence is an error even where no kind was asked for."""


def monitor_of(
    model: Model,
    kinds: Collection[Kind] = (),
    tolerance: Tolerance | None = None,
    invariant: Formula = TRUE,
    default_bound: tuple[Fraction, Fraction] | None = None,
) -> tuple[Monitor, tuple[Diagnostic, ...]]:
    """The monitor with these kinds of checks, all that the model has where none is named; and why it has
    no others. `invariant` is the loop's, `default_bound` limits inputs that nothing else does. Raises
    `CompileError` for what was asked for and cannot be had.
    """
    allowed = tolerance or Tolerance()
    makers: dict[Kind, Callable[[], Check]] = {
        "init": lambda: Check("init", (_case(model.precondition, "the precondition"),)),
        "controller": lambda: controller_check(model, allowed),
        "model": lambda: model_check(model, allowed),
        "safety": lambda: _safety(model, invariant, allowed),
    }
    checks: list[Check] = []
    found: list[Diagnostic] = []
    problems: list[Diagnostic] = []
    for kind in KINDS:
        if kinds and kind not in kinds:
            continue
        try:
            checks.append(makers[kind]())
        except CompileError as refused:
            needed = kind in kinds or kind in ALWAYS
            (problems if needed else found).extend(refused.diagnostics)
    if problems:
        raise CompileError(problems)
    controller = None
    if any(check.kind == "controller" and check.cases for check in checks):
        controller = controller_of(model, control_paths(model), allowed, default_bound)
    monitor = Monitor(model, tuple(_numbered(checks)), allowed, controller)
    return monitor, tuple(replace(d, severity="warning") for d in found)


def _safety(model: Model, invariant: Formula, tolerance: Tolerance) -> Check:
    """What holds of every state between steps, each condition once, under the name of what it is of."""
    named = [(p.name, p.formula) for p in model.predicates if p.category == "safety"]
    if model.postcondition is not None:
        named.append(("postcondition", model.postcondition))
    strict = {part for _, formula in named for part in conjuncts(formula)}
    proved = conjunction(p for p in conjuncts(invariant) if p not in strict)
    named.append(("invariant", _kept(proved, tolerance)))
    named = [(name, formula) for name, formula in named if formula != TRUE]
    if not named:
        title = "there is no safety predicate to check, nor a postcondition of what a step leads to"
        raise CompileError(
            error("no-safety-check", title, NOWHERE, help="annotate a predicate with `@safety`")
        )
    parts = {part: name for name, formula in reversed(named) for part in reversed(conjuncts(formula))}
    together = tuple(_condition(part, name) for part, name in reversed(parts.items()))
    return Check("safety", (Case(together, ", ".join(name for name, _ in named)),))


def _kept(invariant: Formula, tolerance: Tolerance) -> Formula:
    """The invariant within the tolerance; in its equalities the errors of many steps add up."""
    match invariant:
        case And(children):
            return conjunction(_kept(c, tolerance) for c in children)
        case Or(children):
            return disjunction(_kept(c, tolerance) for c in children)
        case Compare("="):
            return relaxed(invariant, DRIFT * tolerance.relative, sides_of)
        case Compare() | Truth():
            return relaxed(invariant, tolerance.relative, sides_of)
        case _:
            assert_never(invariant)


def _case(formula: Formula, name: str) -> Case:
    return Case(tuple(_condition(part, name) for part in conjuncts(formula)), name)


def _condition(part: Formula, name: str) -> Condition:
    return Condition(0, part, f"{name}: {print_formula(part)}", place_of(part))


def _numbered(checks: list[Check]) -> Iterator[Check]:
    """Conditions count up from 2 through the whole monitor."""
    numbers = count(OUT_OF_RANGE + 1)
    firsts: dict[Formula, int] = {}
    for check in checks:
        cases: list[Case] = []
        for case in check.cases:
            named = zip(case.conditions, numbers, strict=False)
            conditions = tuple(replace(c, number=k, first=firsts.setdefault(c.formula, k)) for c, k in named)
            cases.append(replace(case, conditions=conditions))
        yield replace(check, cases=tuple(cases))
