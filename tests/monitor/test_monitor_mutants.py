"""Systems with one mistake: the monitor of the model they come from catches them.

A mutant lacks a test, has a constant off by 1 % or a value with the wrong sign, or moves at another rate
or longer than it may. Its runs from random states are shown to the monitor. Where it accepts all of them,
Z3 gives a state that is well off the model, which the monitor must reject, or proves that the mutant does
nothing else than the model.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from monitor_program import Program, Values, program_of
from selection import few_and_many, quick_among

from dl2c.commands.monitor import unit_of
from dl2c.flows.solution import Solution, solve
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import conjunction, conjuncts, disjunction, folded, mapped, operands, with_term
from dl2c.ir.model import (
    ONE,
    TRUE,
    ZERO,
    Add,
    And,
    Assign,
    Block,
    Bound,
    Choice,
    Compare,
    Flow,
    Formula,
    If,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Statement,
    Symbol,
    Term,
)
from dl2c.ir.model import (
    Test as Question,
)
from dl2c.ir.printer import print_formula, print_term
from dl2c.monitor.check import Check, Tolerance, after
from dl2c.monitor.control import Control, control_paths, controller_check
from dl2c.monitor.plant import model_check
from dl2c.smt.query import Impossible, Oracle

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
CLOSED_FORM = (
    "acc",
    "bouncing_ball",
    "etcs",
    "evasion",
    "forced_acceleration",
    "static_safety_line",
    "watertank",
    "waypoint",
)
EXACT = Tolerance(Fraction(0))
OFF = Fraction(101, 100)

BRAKING = "(2 * b) + (A / b + 1.01) * (A / 2 * ep^2 + ep * v)"
PASSIVE = "1.01 + (v^2 / (2 * b) + V * v / b + (A / b + 1.01) * (A / 2 * ep^2 + ep * (v + V)))"
EQUIVALENT = {
    "acc": {f"0: ?d + vl^2 / (2 * b) > v^2 / {BRAKING}"},
    "etcs": {"0: ?m - z >= (v^2 - d^2) / (2 * b) + (A / b + 1.01) * (A / 2 * ep^2 + ep * v)"},
    "evasion": {
        f"?(x - xo)^2 + (y - yo)^2 >= ({reach} + V) * T)^2 | (x - xo) * (ux - vx) + (y - yo) * (uy - vy) >= 0"
        for reach in ("1 + (2.02 * W", "1.01 + (2 * W")
    },
    "passive_safety": {f"2: ?abs(x - xo) > {PASSIVE} | abs(y - yo) > {PASSIVE}"},
    "static_safety": {f"2: ?abs(x - xo) > v^2 / {BRAKING} | abs(y - yo) > v^2 / {BRAKING}"},
    "static_safety_line": {f"2: ?x + v^2 / {BRAKING} < xo"},
    "thermostat": {
        "0: ?x + k * (cold - x) * 1.01 >= 16",
        "0: ?x + k * (cold - x) * 1 >= 16.16",
        "1: ?x + k * (60 - x) * 1.01 <= 26",
        "1: ?x + k * (60.6 - x) * 1 <= 26",
    },
    "waypoint": {
        "2: ?xr <= xg - GDelta & xr + vr^2 / (2 * b) + (A / b + 1.01) * (A / 2 * ep^2 + ep * vr) "
        "< xg + GDelta & vr + A * ep <= Vmax",
        "3: ?xr <= xg - GDelta & (xr + vr^2 / (2.02 * b) + (A / b + 1) * (A / 2.02 * ep^2 + ep * vr) "
        ">= xg + GDelta | vr + A * ep > Vmax)",
    },
}
"""Mutants that do nothing but what the model does, as Z3 proves: they are more careful."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """`what` was changed; whether it shows in the controller or in a whole step."""

    what: str
    model: Model
    whole: bool = False


def mutants(model: Model) -> Iterator[Mutant]:
    for what, body in changed_block(model.body):
        yield Mutant(what, replace(model, body=body))


def changed_block(block: Block) -> Iterator[tuple[str, Block]]:
    """The block with one statement changed, in every way."""
    for k, statement in enumerate(block):
        for what, changed in changes(statement):
            yield what, (*block[:k], changed, *block[k + 1 :])


def changes(statement: Statement) -> Iterator[tuple[str, Statement]]:
    match statement:
        case Assign(variable=x, term=term):
            wrong = [folded(Neg(term)), *off_by_one_percent(term)]
            for t in wrong:
                if t != term:
                    yield f"{x} := {print_term(t)}", replace(statement, term=t)
        case Question(formula):
            yield f"no ?{print_formula(formula)}", replace(statement, formula=TRUE)
            for f in offset_tests(formula):
                yield f"?{print_formula(f)}", replace(statement, formula=f)
        case If(then=then, orelse=orelse):
            yield from ((w, replace(statement, then=b)) for w, b in changed_block(then))
            yield from ((w, replace(statement, orelse=b)) for w, b in changed_block(orelse))
        case Choice(alternatives=alternatives):
            for k, alternative in enumerate(alternatives):
                for what, body in changed_block(alternative.body):
                    inner = replace(alternative, body=body)
                    others = (*alternatives[:k], inner, *alternatives[k + 1 :])
                    yield f"{k}: {what}", replace(statement, alternatives=others)
        case _:
            pass


def mutants_of_plants(model: Model) -> Iterator[Mutant]:
    """Flows with one rate wrong, or without one condition of their domain."""
    for k, flow in enumerate(model.flows):
        for what, changed in chain(wrong_rates(flow), longer(flow)):
            flows = (*model.flows[:k], changed, *model.flows[k + 1 :])
            yield Mutant(what, replace(model, flows=flows), whole=True)


def wrong_rates(flow: Flow) -> Iterator[tuple[str, Flow]]:
    for k, (x, rate) in enumerate(flow.equations):
        if rate not in (ZERO, ONE):
            for wrong in (folded(Neg(rate)), Mul(Number(OFF), rate), Add(rate, Number(OFF - 1))):
                equations = (*flow.equations[:k], (x, wrong), *flow.equations[k + 1 :])
                yield f"{x}' = {print_term(wrong)}", replace(flow, equations=equations)


def longer(flow: Flow) -> Iterator[tuple[str, Flow]]:
    parts = conjuncts(flow.domain)
    for k, part in enumerate(parts):
        rest = conjunction((*parts[:k], *parts[k + 1 :]))
        watched = conjunction(p for p in conjuncts(flow.watched) if p != part)
        yield f"no & {print_formula(part)}", replace(flow, domain=rest, watched=watched)


def off_by_one_percent(term: Term) -> Iterator[Term]:
    for number in sorted({n.value for n in numbers(term)} - {Fraction(0)}):
        yield with_term(term, Number(number), Number(number * OFF))


def offset_tests(formula: Formula) -> Iterator[Formula]:
    found: set[Fraction] = set()
    mapped(formula, lambda term: (found.update(n.value for n in numbers(term)), term)[1])
    for number in sorted(found - {Fraction(0)}):
        wrong = Number(number * OFF)
        yield mapped(formula, lambda term, n=number, w=wrong: with_term(term, Number(n), w))


def numbers(term: Term) -> Iterator[Number]:
    if isinstance(term, Number):
        yield term
    for operand in operands(term):
        yield from numbers(operand)


def runs(mutant: Mutant, rng: random.Random, count: int) -> Iterator[list[Values]]:
    """States before and after runs of the controller or of whole steps, and parameters."""
    model = mutant.model
    moving = {x for flow in model.flows for x, rate in flow.equations if rate != ZERO}
    steady = frozenset(v.name for v in model.variables) - moving
    controls = control_paths(model, steady if mutant.whole else None)
    for _ in range(count):
        parameters = {c.name: inside(c.bound, rng) for c in model.constants if c.value is None}
        before = {v.name: inside(v.bound, rng) for v in model.variables}
        free = {v.name: 1.5 * inside(v.bound, rng) for v in model.variables}
        fixed: dict[Symbol, Any] = {Symbol(c, "constant"): v for c, v in parameters.items()}
        fixed |= {Symbol(c.name, "constant"): float(c.value) for c in model.constants if c.value is not None}
        env = fixed | {Symbol(x, "variable"): v for x, v in before.items()}
        env |= {after(x): v for x, v in free.items()}
        for control in controls:
            try:
                if truth(control.tests, env):
                    led = {x: float(evaluate(value, env)) for x, value in control.values.items()}
                    moved = motion(model, control, led, fixed, rng) if mutant.whole else led
                    if moved is not None:
                        yield [before, moved, parameters]
            except Undefined:
                continue


def motion(
    model: Model, control: Control, led: Values, fixed: dict[Symbol, Any], rng: random.Random
) -> Values | None:
    """Where the flow that begins in `led` has come after a random time, if its domain holds until then."""
    if control.draft.flow is None:
        return led
    flow = model.flows[control.draft.flow]
    solution = solve(flow)
    assert isinstance(solution, Solution)
    env = fixed | {Symbol(x, "variable"): v for x, v in led.items()}
    curves = {x: [float(evaluate(c, env)) for c in cs] for x, cs in solution.variables.items()}
    lasted = rng.choice([0.02, 0.5, 2.0]) * rng.random()
    state = led
    for k in range(9):
        time = lasted * k / 8
        state = {**led, **{x: sum(c * time**n for n, c in enumerate(cs)) for x, cs in curves.items()}}
        if not truth(flow.domain, fixed | {Symbol(x, "variable"): v for x, v in state.items()}):
            return None
    return state


def inside(bound: Bound, rng: random.Random) -> float:
    low = -5.0 if bound.low is None else float(bound.low)
    high = 5.0 if bound.high is None else float(bound.high)
    return rng.choice([0.0, low, high]) if rng.random() < 0.1 and low <= 0 else rng.uniform(low, high)


def formula_of(check: Check) -> Formula:
    return disjunction(conjunction(c.formula for c in case.conditions) for case in check.cases)


def limited(model: Model) -> Formula:
    """What the monitor presumes of the parameters, and states of a size that doubles show."""
    limits: list[Formula] = []
    for c in model.constants:
        symbol = Symbol(c.name, "constant")
        ends = ((">=", c.bound.low), ("<=", c.bound.high)) if c.value is None else (("=", c.value),)
        limits += [Compare(op, symbol, Number(end)) for op, end in ends if end is not None]
    for v in model.variables:
        for symbol in (Symbol(v.name, "variable"), after(v.name)):
            limits += [Compare(op, symbol, Number(Fraction(end))) for op, end in ((">=", -100), ("<=", 100))]
    return conjunction(limits)


def loosened(formula: Formula, slack: Number) -> Formula:
    """The formula with room for what rounding and tolerance may do to a condition."""
    match formula:
        case And(children):
            return And(tuple(loosened(c, slack) for c in children))
        case Or(children):
            return Or(tuple(loosened(c, slack) for c in children))
        case Compare("<" | "<=" | "=" as op, left, right):
            upper = Compare("<=", left, Add(right, slack))
            return And((upper, Compare("<=", right, Add(left, slack)))) if op == "=" else upper
        case Compare(">" | ">=", left, right):
            return Compare("<=", right, Add(left, slack))
        case _:
            return formula


def caught(program: Program, mutant: Mutant, seed: int) -> bool:
    """Whether the monitor rejects some run of the mutant, else Z3 proves that it has none but the model's."""
    kind = "model" if mutant.whole else "controller"
    if any(
        number != 0 for number, _ in program.verdicts(kind, list(runs(mutant, random.Random(seed), 2000)))
    ):
        return True
    model = program.unit.monitor.model
    check = model_check if mutant.whole else controller_check
    wrong, right = (formula_of(check(m, EXACT)) for m in (mutant.model, model))
    oracle = Oracle(20.0, 60.0)
    variables = [v.name for v in model.variables]
    shown = [*variables, *(f"{x}_post" for x in variables), *(c.name for c in program.unit.parameters)]
    off = Impossible((), loosened(right, Number(Fraction(1, 10**6))))
    witness = oracle.exists([wrong, limited(mutant.model)], [off], shown).witness
    if witness:
        values = {name: float(value) for name, value in witness.items()}
        before, moved = ({x: values[f"{x}{end}"] for x in variables} for end in ("", "_post"))
        constants = {c.name: values[c.name] for c in program.unit.parameters}
        assert program.verdicts(kind, [(before, moved, constants)])[0][0] != 0, "a false state is accepted"
        return True
    answer = oracle.exists([wrong, limited(mutant.model)], [Impossible((), right)])
    assert answer.verdict == "no", f"neither caught nor proved equivalent: {mutant.what}"
    return False


def whole_program(example: str, folder: Path) -> Program:
    kinds = ("controller", "model") if example in CLOSED_FORM else ("controller",)
    return program_of(unit_of(f"example:{example}", {}, kinds), folder)


@pytest.mark.parametrize("count", few_and_many(300, 2000))
@pytest.mark.parametrize("example", quick_among(EXAMPLES, ("acc", "etcs", "evasion", "thermostat")))
def test_runs_of_the_model_itself_are_accepted(count: int, example: str, tmp_path: Path) -> None:
    program = whole_program(example, tmp_path)
    for check in program.unit.monitor.checks:
        mutant = Mutant("nothing", program.unit.monitor.model, check.kind == "model")
        rows = list(runs(mutant, random.Random(1), count))
        assert len(rows) > count / 100
        assert {number for number, _ in program.verdicts(check.kind, rows)} == {0}


@pytest.mark.parametrize("example", quick_among(EXAMPLES, {"watertank"}))
def test_mutants_are_caught(example: str, tmp_path: Path) -> None:
    program = whole_program(example, tmp_path)
    found = mutants_of(example)
    survivors = {m.what for k, m in enumerate(found) if not caught(program, m, k)}
    assert survivors == EQUIVALENT.get(example, set())


def mutants_of(example: str) -> list[Mutant]:
    model = unit_of(f"example:{example}", {}, ("controller",)).monitor.model
    return [*mutants(model), *(mutants_of_plants(model) if example in CLOSED_FORM else ())]


def test_there_are_mutants_of_every_kind() -> None:
    found = [m for example in EXAMPLES for m in mutants_of(example)]
    dropped = [m for m in found if " ?" in m.what and "no " in m.what]
    plants = [m for m in found if m.whole]
    assert len(found) >= 100 and len(dropped) >= 15 and len(plants) >= 30, (len(found), len(dropped))
    assert sum(map(len, EQUIVALENT.values())) <= len(found) / 5
