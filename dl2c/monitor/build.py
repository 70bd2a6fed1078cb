"""From a model to its monitor: the checks asked for, their conditions numbered.

The init check is the precondition, the safety check every annotated safety predicate, or the
postcondition where there is none; both strict, without the tolerance that rewards have.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from itertools import count

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.ir.logic import conjuncts
from dl2c.ir.model import Formula, Model
from dl2c.ir.printer import print_formula
from dl2c.monitor.check import KINDS, OUT_OF_RANGE, Case, Check, Condition, Kind, Monitor, Tolerance
from dl2c.monitor.control import controller_check, place_of
from dl2c.monitor.plant import model_check
from dl2c.source import NOWHERE

ALWAYS: tuple[Kind, ...] = ("init", "controller")
"""The kinds whose absence is an error even where no kind was asked for."""


def monitor_of(
    model: Model, kinds: Collection[Kind] = (), tolerance: Tolerance | None = None
) -> tuple[Monitor, tuple[Diagnostic, ...]]:
    """The monitor with these kinds of checks, all that the model has where none is named; and why it has
    no others. Raises `CompileError` for what was asked for and cannot be had.
    """
    allowed = tolerance or Tolerance()
    makers: dict[Kind, Callable[[], Check]] = {
        "init": lambda: Check("init", (_case(model.precondition, "the precondition"),)),
        "controller": lambda: controller_check(model, allowed),
        "model": lambda: model_check(model, allowed),
        "safety": lambda: _safety(model),
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
    return Monitor(model, tuple(_numbered(checks)), allowed), tuple(
        replace(d, severity="warning") for d in found
    )


def _safety(model: Model) -> Check:
    """All safety predicates together, each condition under the name of its predicate."""
    named = [(p.name, p.formula) for p in model.predicates if p.category == "safety"]
    if not named and model.postcondition is not None:
        named = [("postcondition", model.postcondition)]
    if not named:
        title = "there is no safety predicate to check, nor a postcondition of what a step leads to"
        raise CompileError(
            error("no-safety-check", title, NOWHERE, help="annotate a predicate with `@safety`")
        )
    cases = [_case(formula, name) for name, formula in named]
    together = tuple(c for case in cases for c in case.conditions)
    return Check("safety", (Case(together, ", ".join(name for name, _ in named)),))


def _case(formula: Formula, name: str) -> Case:
    parts = conjuncts(formula)
    return Case(tuple(Condition(0, p, f"{name}: {print_formula(p)}", place_of(p)) for p in parts), name)


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
