"""Interpreter and compiled code agree to the last bit, on random models, states and actions."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from differential import Pair, run_models
from generators.random_flows import wild_model, wild_program
from generators.random_models import random_program
from selection import few_and_many

from dl2c.ir.logic import atoms, operands
from dl2c.ir.model import (
    And,
    Block,
    Call,
    Choice,
    Compare,
    Formula,
    If,
    Model,
    Or,
    Repeat,
    Term,
    Truth,
    While,
)

STATEMENTS = {"Assign", "AssignAny", "Test", "Choice", "If", "Evolve"}
TERMS = {"Number", "Symbol", "Neg", "Add", "Sub", "Mul", "Div", "Pow", "Call"}
FORMULAS = {"Truth", "Compare", "And", "Or"}
FUNCTIONS = {"abs", "min", "max", "sqrt", "exp", "sin", "cos", "tan", "arcsin", "arctan", "tanh", "pow"}
COMPARISONS = {"=", "!=", "<", "<=", ">", ">="}


@pytest.mark.parametrize("seeds", few_and_many((10, 23, 26, 30), range(40)))
def test_interpreter_and_compiled_code_agree(seeds: Sequence[int], tmp_path: Path) -> None:
    """The few have all that is asserted too."""
    pairs, seen = run_models(seeds, 40, tmp_path)
    assert len(pairs) >= 3 / 4 * len(seeds)
    _assert_coverage(pairs, seen)


@pytest.mark.parametrize("seed", [10893])
def test_models_that_once_disagreed(seed: int, tmp_path: Path) -> None:
    """10893: two tests that leave one value of an input, each root rounded to the wrong side."""
    run_models(range(seed, seed + 1), 400, tmp_path)


@pytest.mark.parametrize("seeds", few_and_many((12, 17, 19, 21), range(12, 24)))
def test_flows_of_any_form_agree(seeds: Sequence[int], tmp_path: Path) -> None:
    """Domains with | != abs min max, motion of degree 3, watches that fail, cut flows and are met."""
    pairs, seen = run_models(seeds, 40, tmp_path, wild_model)
    assert sum(f.quick is None for pair in pairs for f in pair.environment.flows) >= 5
    assert any(w.cuts for pair in pairs for f in pair.environment.flows for w in f.watches)
    assert seen["failed"] >= 10
    assert seen["met"] >= 5
    assert seen["events"] >= 0.2 * seen["flows"]


@pytest.mark.parametrize("seeds", few_and_many((7, 8, 15, 19), range(20)))
def test_durations_that_the_agent_or_chance_decides_agree(seeds: Sequence[int], tmp_path: Path) -> None:
    pairs, seen = run_models(seeds, 20, tmp_path, wild_program, episodes=True)
    assert {pair.model.duration for pair in pairs} == {"max", "sample", "agent"}
    assert seen["failed"] > 0
    assert seen["steps"] >= 7.5 * len(seeds)


@pytest.mark.slow
def test_durations_agree_in_many_models(tmp_path: Path) -> None:
    run_models(range(20, 120), 20, tmp_path, wild_program, episodes=True)


@pytest.mark.slow
def test_flows_of_any_form_agree_in_many_models(tmp_path: Path) -> None:
    run_models(range(10_000, 10_400), 40, tmp_path, wild_model)


@pytest.mark.parametrize("seeds", few_and_many((7, 12, 17, 19), range(20)))
def test_interpreter_and_compiled_code_agree_on_every_form_of_program(
    seeds: Sequence[int], tmp_path: Path
) -> None:
    pairs, seen = run_models(seeds, 15, tmp_path, random_program, episodes=True)
    kinds = {kind for pair in pairs for kind in _kinds(pair.model)}
    assert kinds >= STATEMENTS | {"While", "Repeat"}
    assert sum(bool(pair.model.prefix) for pair in pairs) >= 0.15 * len(seeds)
    assert sum(bool(pair.model.lead) for pair in pairs) >= 0.15 * len(seeds)
    assert any(pair.environment.paths.draws and not pair.model.lead for pair in pairs)
    assert min(seen["steps"], seen["blocked"], seen["diverged"], seen["refused"]) > 0


@pytest.mark.slow
def test_interpreter_and_compiled_code_agree_on_many_programs(tmp_path: Path) -> None:
    for start in range(1000, 1400, 100):
        folder = tmp_path / str(start)
        folder.mkdir()
        run_models(range(start, start + 100), 30, folder, random_program, episodes=True)


@pytest.mark.slow
def test_interpreter_and_compiled_code_agree_on_many_models(tmp_path: Path) -> None:
    compared = 0
    start = 10_000
    total: Counter[str] = Counter()
    while compared < 2000:
        folder = tmp_path / str(start)
        folder.mkdir()
        pairs, seen = run_models(range(start, start + 100), 40, folder)
        compared += len(pairs)
        total += seen
        start += 100
        if start == 10_100:
            _assert_coverage(pairs, seen)


def _assert_coverage(pairs: list[Pair], seen: Counter[str]) -> None:
    """Every kind of node occurred, and every kind of outcome often enough to mean something."""
    kinds = {kind for pair in pairs for kind in _kinds(pair.model)}
    assert kinds >= STATEMENTS | TERMS | FORMULAS | FUNCTIONS | COMPARISONS
    assert seen["events"] >= 0.3 * seen["flows"]
    assert seen["blocked"] >= 0.1 * seen["steps"]
    assert seen["deadlock"] >= 0.05 * seen["steps"]
    assert seen["numerical"] > 0
    assert 0 < seen["undecided"] < seen["steps"]
    assert any(pair.environment.paths.points > 1 for pair in pairs)
    assert any(pair.environment.paths.inputs for pair in pairs)


def _kinds(model: Model) -> Iterator[str]:
    yield from _block((*model.prefix, *model.lead, *model.body))
    for flow in model.flows:
        yield from _formula(flow.domain)
        for _, rate in flow.equations:
            yield from _term(rate)
    for predicate in model.predicates:
        yield from _formula(predicate.formula)
        for value in (predicate.reward, predicate.penalty, predicate.shape):
            if value is not None:
                yield from _term(value)


def _block(block: Block) -> Iterator[str]:
    for statement in block:
        yield type(statement).__name__
        match statement:
            case While(body=body) | Repeat(body=body):
                yield from _block(body)
            case Choice(_, alternatives):
                for alternative in alternatives:
                    yield from _block(alternative.body)
            case If(condition, _, then, orelse):
                yield from _formula(condition)
                yield from _block(then)
                yield from _block(orelse)
            case _:
                for part in ("formula", "term"):
                    if (value := getattr(statement, part, None)) is not None:
                        yield from (_formula(value) if part == "formula" else _term(value))


def _formula(formula: Formula) -> Iterator[str]:
    yield type(formula).__name__
    if isinstance(formula, (And, Or)):
        for child in formula.children:
            yield from _formula(child)
    elif isinstance(formula, Compare):
        yield formula.op
        yield from _term(formula.left)
        yield from _term(formula.right)
    assert isinstance(formula, Truth) or list(atoms(formula))


def _term(term: Term) -> Iterator[str]:
    yield type(term).__name__
    if isinstance(term, Call):
        yield term.function
    for part in operands(term):
        yield from _term(part)
