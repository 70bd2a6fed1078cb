"""The controller monitor: whether some run of a step up to its first flow explains two states.

Comes in: a model. Goes out: one case per control path, whose conditions say that the state after is
what the path makes of the state before, that its tests hold and so does the domain of its flow, at the
start of the flow. A value chosen freely is read off the variable that it was given to; where no
variable has it any more, it is eliminated. This is the condition that KeYmaera X's ModelPlex derives
(Mitsch, Platzer: "ModelPlex", 2016).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import assert_never

from dl2c.diagnostics import CompileError, error
from dl2c.ir.logic import atoms, conjunction, conjuncts, mapped, substituted, symbols
from dl2c.ir.model import (
    Assign,
    AssignAny,
    Block,
    Choice,
    Compare,
    Evolve,
    Formula,
    If,
    Model,
    Repeat,
    Statement,
    Symbol,
    Term,
    Test,
    While,
)
from dl2c.ir.printer import print_formula
from dl2c.monitor.check import Case, Check, Condition, Tolerance, after
from dl2c.monitor.parts import Parts
from dl2c.paths.enumerate import Draft, control_drafts
from dl2c.paths.path import END
from dl2c.quantifiers.eliminate import Quantifier, eliminated
from dl2c.source import NOWHERE, Span


@dataclass(frozen=True, slots=True)
class Control:
    """A control path with the inputs that a state after shows replaced by its values.

    `values` are what the path makes of the variables, over the state before and those inputs; of other
    variables they are the variables themselves. `hidden` are inputs that no variable has any more.
    """

    draft: Draft
    tests: Formula
    values: Mapping[str, Term]
    hidden: tuple[str, ...]


def controller_check(model: Model, tolerance: Tolerance) -> Check:
    """Numbers of its conditions are all 0. Raises `CompileError`."""
    controls = control_paths(model)
    return Check("controller", tuple(case_of(model, c, tolerance) for c in controls))


def control_paths(model: Model, steady: frozenset[str] | None = None) -> tuple[Control, ...]:
    """All control paths of a step. Only the variables in `steady`, all where it is None, show inputs.

    Raises `CompileError` for loops whose iterations are not limited.
    """
    program = _all_chosen((*model.lead, *model.body))
    drafts = control_drafts(model, program)
    if endless := [d for d in drafts if d.flow is None and d.target != END]:
        raise CompileError(error(
            "monitor-loop",
            "a controller with a loop has no monitor",
            endless[0].span,
            "on the way from here to the first flow there is a while loop",
            "write the loop's result as an assignment, or its iterations as choices",
        ))  # fmt: skip
    return tuple(_control(model, d, steady) for d in drafts)


def leading_drafts(model: Model) -> tuple[Draft, ...]:
    """Every way through the statements that a step begins with, before the agent decides."""
    return control_drafts(model, _all_chosen(model.lead))


def _chosen(statement: Statement) -> Statement:
    """The statement with all decisions made by one and the same: a monitor does not ask who decided."""
    match statement:
        case AssignAny():
            return replace(statement, role="agent")
        case Choice(alternatives=alternatives):
            inner = tuple(replace(a, body=_all_chosen(a.body)) for a in alternatives)
            return replace(statement, role="agent", alternatives=inner)
        case If(then=then, orelse=orelse):
            return replace(statement, then=_all_chosen(then), orelse=_all_chosen(orelse))
        case Repeat(body=body):
            return replace(statement, role="agent", body=_all_chosen(body))
        case While(body=body):
            return replace(statement, body=_all_chosen(body))
        case Assign() | Test() | Evolve():
            return statement
        case _:
            assert_never(statement)


def _all_chosen(block: Block) -> Block:
    return tuple(map(_chosen, block))


def _control(model: Model, draft: Draft, steady: frozenset[str] | None) -> Control:
    updates = dict(draft.updates)
    shown: dict[Symbol, Term] = {}
    for name, value in updates.items():
        if isinstance(value, Symbol) and value.kind == "input" and (steady is None or name in steady):
            shown.setdefault(value, after(name))
    values: dict[str, Term] = {v.name: Symbol(v.name, "variable") for v in model.variables}
    values |= {name: substituted(value, shown) for name, value in updates.items()}
    tests = mapped(draft.tests, lambda term: substituted(term, shown))
    used = symbols(tests, *values.values())
    hidden = tuple(k for k in draft.inputs if Symbol(k, "input") in used)
    return Control(draft, tests, values, hidden)


def case_of(model: Model, control: Control, tolerance: Tolerance) -> Case:
    """Unchanged variables first, then changed ones, then tests: the last condition of a path to fail
    tells most about a state that no path explains.
    """
    hidden = {Symbol(key, "input") for key in control.hidden}
    unchanged: list[Condition] = []
    changed: list[Condition] = []
    clues: list[Formula] = []
    for name, value in control.values.items():
        span = _assigned_at(control.draft, name)
        equal = tolerance.equal(name, value, span)
        if value == after(name):
            continue
        if symbols(value) & hidden:
            clues.append(equal)
        elif value == Symbol(name, "variable"):
            unchanged.append(Condition(0, equal, f"{name} is unchanged", span, gradual=False))
        else:
            changed.append(Condition(0, equal, f"{name} has its value", span, gradual=False))
    tests = [t for t in conjuncts(control.tests) if not symbols(t) & hidden]
    clues += [t for t in conjuncts(control.tests) if symbols(t) & hidden]
    return Case(
        (
            *unchanged,
            *changed,
            *(tested(t, tolerance) for t in tests),
            *(tested(t, EXACT) for t in conjuncts(without_hidden(control, conjunction(clues)))),
        ),
        title_of(model, control.draft),
        control.draft.span,
    )


EXACT = Tolerance(Fraction(0))
"""What elimination leaves has its tolerance in it: the equalities in it separate cases."""


def tested(test: Formula, tolerance: Tolerance) -> Condition:
    """The condition that a test of a path holds."""
    equality = isinstance(test, Compare) and test.op == "="
    return Condition(0, tolerance.met(test), print_formula(test), place_of(test), gradual=not equality)


def without_hidden(control: Control, formula: Formula) -> Formula:
    """The formula for some values of the hidden inputs. Raises `CompileError` where that has no answer."""
    parts = Parts(frozenset(Symbol(key, "input") for key in control.hidden))
    formula = parts.named(formula)
    for key in reversed(control.hidden):
        span = control.draft.place_of(key)
        name = key.removeprefix("assign_")
        formula = eliminated(Quantifier(False, name, Symbol(key, "input"), False, span), formula)
    return parts.put_back(formula)


def place_of(formula: Formula) -> Span:
    """From its first atom to its last, where both are in one text."""
    spans = [a.span for a in atoms(formula) if a.span != NOWHERE]
    if not spans:
        return NOWHERE
    return spans[0].to(spans[-1]) if spans[0].source is spans[-1].source else spans[0]


def _assigned_at(draft: Draft, name: str) -> Span:
    """The last assignment of a variable on the path, or the path's beginning."""
    found = [
        s.span
        for s in draft.line.statements
        if isinstance(s, Assign | AssignAny) and s.variable == name
    ]  # fmt: skip
    return found[-1] if found else draft.span


def title_of(model: Model, draft: Draft) -> str:
    """The path by its decisions: `choice_0=1, choice_1=0`."""
    names = {c.key: c.name or c.key for c in _choices((*model.lead, *model.body))}
    taken = ", ".join(f"{names.get(key, key)}={k}" for key, k, _ in draft.line.decisions)
    return taken or "the only path"


def _choices(block: Block) -> list[Choice]:
    found: list[Choice] = []
    for statement in block:
        match statement:
            case Choice(alternatives=alternatives):
                found += [statement, *(c for a in alternatives for c in _choices(a.body))]
            case If(then=then, orelse=orelse):
                found += _choices((*then, *orelse))
            case Repeat(body=body) | While(body=body):
                found += _choices(body)
            case Assign() | AssignAny() | Test() | Evolve():
                pass
            case _:
                assert_never(statement)
    return found
