"""Controllers with one mistake: the monitor of the model they come from catches them.

A mutant lacks a test, or has a constant off by 1 % or a value with the wrong sign. Runs of its control
paths from random states are shown to the monitor. Where it accepts all of them, Z3 must prove that the
mutant does nothing else than the model.
"""

import random
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from monitor_program import Program, Values, program_of

from dl2c.commands.monitor import unit_of
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import conjunction, disjunction, folded, mapped, operands, with_term
from dl2c.ir.model import (
    TRUE,
    Alternative,
    Assign,
    Block,
    Bound,
    Choice,
    Compare,
    Formula,
    If,
    Model,
    Neg,
    Number,
    Statement,
    Symbol,
    Term,
)
from dl2c.ir.model import (
    Test as Question,
)
from dl2c.monitor.check import Check, Tolerance, after
from dl2c.monitor.control import control_paths, controller_check
from dl2c.smt.query import Impossible, Oracle

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
EXACT = Tolerance(Fraction(0))


def mutants(block: Block) -> Iterator[Block]:
    """The block with one statement changed, in every way."""
    for k, statement in enumerate(block):
        for changed in changes(statement):
            yield (*block[:k], changed, *block[k + 1 :])


def changes(statement: Statement) -> Iterator[Statement]:
    match statement:
        case Assign(term=term):
            if folded(Neg(term)) != term:
                yield replace(statement, term=Neg(term))
            yield from (replace(statement, term=t) for t in off_by_one_percent(term))
        case Question(formula):
            yield replace(statement, formula=TRUE)
            yield from (replace(statement, formula=f) for f in offset_tests(formula))
        case If(then=then, orelse=orelse):
            yield from (replace(statement, then=b) for b in mutants(then))
            yield from (replace(statement, orelse=b) for b in mutants(orelse))
        case Choice(alternatives=alternatives):
            for k, alternative in enumerate(alternatives):
                for body in mutants(alternative.body):
                    others: tuple[Alternative, ...] = alternatives[:k]
                    changed = (*others, replace(alternative, body=body), *alternatives[k + 1 :])
                    yield replace(statement, alternatives=changed)
        case _:
            pass


def off_by_one_percent(term: Term) -> Iterator[Term]:
    for number in sorted({n.value for n in numbers(term)} - {Fraction(0)}):
        yield with_term(term, Number(number), Number(number * Fraction(101, 100)))


def offset_tests(formula: Formula) -> Iterator[Formula]:
    found: set[Fraction] = set()
    mapped(formula, lambda term: (found.update(n.value for n in numbers(term)), term)[1])
    for number in sorted(found - {Fraction(0)}):
        wrong = Number(number * Fraction(101, 100))
        yield mapped(formula, lambda term, n=number, w=wrong: with_term(term, Number(n), w))


def numbers(term: Term) -> Iterator[Number]:
    if isinstance(term, Number):
        yield term
    for operand in operands(term):
        yield from numbers(operand)


def runs(model: Model, rng: random.Random, count: int) -> Iterator[list[Values]]:
    """States before and after runs of the controller, and parameters."""
    controls = control_paths(model)
    for _ in range(count):
        parameters = {c.name: inside(c.bound, rng) for c in model.constants if c.value is None}
        before = {v.name: inside(v.bound, rng) for v in model.variables}
        free = {v.name: 1.5 * inside(v.bound, rng) for v in model.variables}
        env: dict[Symbol, Any] = {Symbol(x, "variable"): v for x, v in before.items()}
        env |= {Symbol(c.name, "constant"): float(c.value) for c in model.constants if c.value is not None}
        env |= {Symbol(c, "constant"): v for c, v in parameters.items()}
        env |= {after(x): v for x, v in free.items()}
        for control in controls:
            try:
                if truth(control.tests, env):
                    led = {x: float(evaluate(value, env)) for x, value in control.values.items()}
                    yield [before, led, parameters]
            except Undefined:
                continue


def inside(bound: Bound, rng: random.Random) -> float:
    low = -5.0 if bound.low is None else float(bound.low)
    high = 5.0 if bound.high is None else float(bound.high)
    return rng.choice([0.0, low, high]) if rng.random() < 0.1 and low <= 0 else rng.uniform(low, high)


def formula_of(check: Check) -> Formula:
    return disjunction(conjunction(c.formula for c in case.conditions) for case in check.cases)


def limited(model: Model) -> Formula:
    """What the monitor presumes of the parameters."""
    sides = [
        (c.name, op, end) for c in model.constants for op, end in ((">=", c.bound.low), ("<=", c.bound.high))
    ]
    return conjunction(Compare(op, Symbol(n, "constant"), Number(e)) for n, op, e in sides if e is not None)


def caught(program: Program, mutant: Model, seed: int) -> bool:
    """Whether the monitor rejects some run of the mutant, or Z3 knows one that is none of the model."""
    rows = list(runs(mutant, random.Random(seed), 2000))
    if any(number != 0 for number, _ in program.verdicts("controller", rows)):
        return True
    wrong = formula_of(controller_check(mutant, EXACT))
    right = formula_of(controller_check(program.unit.monitor.model, EXACT))
    answer = Oracle(10.0, 20.0).exists([wrong, limited(mutant)], [Impossible((), right)])
    assert answer.verdict != "unknown", "neither caught nor proved equivalent"
    return answer.verdict == "yes"


def test_runs_of_the_model_itself_are_accepted(tmp_path: Path) -> None:
    for example in EXAMPLES:
        unit = unit_of(f"example:{example}", {}, ("controller",))
        rows = list(runs(unit.monitor.model, random.Random(1), 2000))
        program = program_of(unit, tmp_path / example)
        assert len(rows) > 20
        assert {number for number, _ in program.verdicts("controller", rows)} == {0}, example


@pytest.mark.parametrize("example", EXAMPLES)
def test_mutants_are_caught(example: str, tmp_path: Path) -> None:
    unit = unit_of(f"example:{example}", {}, ("controller",))
    program = program_of(unit, tmp_path)
    listed = [replace(unit.monitor.model, body=b) for b in mutants(unit.monitor.model.body)]
    survivors = [k for k, mutant in enumerate(listed) if not caught(program, mutant, k)]
    assert len(survivors) <= len(listed) / 2
