"""What a controller may do: every control path as something that can be executed.

Comes in: a model and its control paths. Goes out: the paths as runs, with what is known of the values of
their inputs, in the order in which a fallback tries them. An input is what a test of a step makes of
`x := *`: the agent asks for a value, and gets the nearest that passes; the environment's is measured, and so
is which alternatives it took before the agent decides.

Whether a value leaves later inputs of the agent some value is known by eliminating these from their
tests. Where that has no answer, later tests are not looked at: the run may then be refused.
"""

from collections.abc import Iterable
from fractions import Fraction

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import atoms, conjunction, conjuncts, symbols
from dl2c.ir.margins import TooManyCases, margin_of, smooth
from dl2c.ir.model import LARGEST_STATE, ONE, ZERO, Compare, Formula, Model, Number, Symbol
from dl2c.ir.normal import normal_form
from dl2c.ir.polynomial import Coefficients, polynomial
from dl2c.monitor.check import Controller, Given, Run, Tolerance
from dl2c.monitor.control import Control
from dl2c.paths.enumerate import assignments_of, decisions_of
from dl2c.paths.limits import input_limits
from dl2c.paths.path import Decision, Input
from dl2c.quantifiers.eliminate import Quantifier, eliminated
from dl2c.source import NOWHERE

ANY = (-LARGEST_STATE, LARGEST_STATE)
"""Limits of an input that nothing else limits."""


def controller_of(
    model: Model,
    controls: tuple[Control, ...],
    tolerance: Tolerance,
    default_bound: tuple[Fraction, Fraction] | None = None,
) -> Controller:
    """The runs of a model. `default_bound` limits inputs that nothing else limits."""
    program = (*model.lead, *model.body)
    assigned = {a.key: a for a in assignments_of(program)}
    tests: dict[str, list[Formula]] = {}
    for control in controls:
        for key in control.draft.inputs:
            tests.setdefault(key, []).append(control.draft.tests)
    met = tuple(assigned[key] for key in assigned if key in tests)
    inputs = {i.key: i for i in input_limits(model, met, tests, default_bound or ANY)}
    decisions = tuple({d.key: d for d in decisions_of(program)}.values())
    agent = tuple(d for d in decisions if d.role == "agent")
    measured = tuple({d.key: d for d in decisions_of(model.lead) if d.role != "agent"}.values())
    runs = tuple(_run(k, c, inputs, agent, measured, tolerance) for k, c in enumerate(controls))
    first = sorted(range(len(controls)), key=lambda k: not _is_marked(controls[k], agent))
    return Controller(tuple(inputs.values()), agent, runs, tuple(first), measured)


def _is_marked(control: Control, agent: tuple[Decision, ...]) -> bool:
    keys = {d.key for d in agent}
    return next((marked for key, _, marked in control.draft.line.decisions if key in keys), False)


def _run(
    case: int,
    control: Control,
    inputs: dict[str, Input],
    decisions: tuple[Decision, ...],
    measured: tuple[Decision, ...],
    tolerance: Tolerance,
) -> Run:
    draft = control.draft
    chosen = {key: alternative for key, alternative, _ in draft.line.decisions}
    taken, seen = (tuple(chosen.get(d.key, -1) for d in some) for some in (decisions, measured))
    own = [inputs[key] for key in draft.inputs]
    admitted = _admitted(draft.tests, [i for i in own if i.role == "agent"])
    given = tuple(
        Given(
            i,
            conjunction(tolerance.met(p) for p in admitted.get(i.key, ())),
            _criticals(admitted.get(i.key, ()), i.symbol),
            draft.place_of(i.key),
        )
        for i in own
    )
    names = ", ".join(f"{d.name or d.key}={k}" for d, k in zip(decisions, taken, strict=True) if k >= 0)
    return Run(case, taken, given, draft.updates, names or "the only path", draft.span, seen)


def _admitted(tests: Formula, own: list[Input]) -> dict[str, tuple[Formula, ...]]:
    """What each of the agent's inputs must satisfy: its tests, and that later inputs have values."""
    rest = list(conjuncts(tests))
    found: dict[str, tuple[Formula, ...]] = {}
    for k, one in reversed(list(enumerate(own))):
        parts = [p for p in rest if one.symbol in symbols(p)]
        rest = [p for p in rest if one.symbol not in symbols(p)]
        found[one.key] = tuple(parts)
        earlier = {i.symbol for i in own[:k]}
        joint = [p for p in parts if symbols(p) & earlier]
        if joint:
            rest += conjuncts(_exists(one, parts))
    return found


def _exists(one: Input, parts: Iterable[Formula]) -> Formula:
    """That the input has a value; true where that cannot be said."""
    low, high = Compare(">=", one.symbol, Number(one.low)), Compare("<=", one.symbol, Number(one.high))
    limits = [*([low] if one.low != ANY[0] else []), *([high] if one.high != ANY[1] else [])]
    try:
        return eliminated(
            Quantifier(False, one.variable, one.symbol, False, NOWHERE), conjunction([*limits, *parts])
        )
    except CompileError:
        return conjunction(())


def _criticals(parts: Iterable[Formula], symbol: Symbol) -> tuple[Coefficients, ...]:
    """Polynomials in an input at whose roots its tests may begin or cease to hold, as far as they are of
    degree 1 or 2.
    """
    found: dict[Coefficients, None] = {}
    for part in parts:
        try:
            smoothed = smooth(part, lambda term: symbol in symbols(term))
        except TooManyCases:
            continue
        for atom in atoms(smoothed):
            coefficients = polynomial(margin_of(atom), {symbol: (ZERO, ONE)})
            while coefficients is not None and len(coefficients) > 1 and normal_form(coefficients[-1]) == {}:
                coefficients = coefficients[:-1]
            if coefficients is not None and len(coefficients) in (2, 3):
                found[coefficients] = None
    return tuple(found)
