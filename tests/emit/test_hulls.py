"""Conditions that intervals refute hold for none of the doubles inside."""

import random
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest
from c_functions import functions

from dl2c.emit.cexpr import print_tape
from dl2c.emit.hulls import refutation
from dl2c.ir.model import Add, And, Call, Compare, Div, Formula, Mul, Neg, Number, Or, Pow, Sub, Symbol, Term
from dl2c.symbolic.tape import Instruction, Tape, formula_tape
from dl2c.symbolic.terms import Builder

U, A = Symbol("u", "input"), Symbol("a", "variable")
CONDITIONS = 120
CASES = 60
POINTS = 24


def term(rng: random.Random, depth: int) -> Term:
    if depth == 0:
        return rng.choice([U, U, A, Number(Fraction(rng.randint(-8, 8), rng.choice([1, 3, 4])))])
    left, right = term(rng, depth - 1), term(rng, depth - 1)
    made: list[Callable[[], Term]] = [
        lambda: Add(left, right),
        lambda: Sub(left, right),
        lambda: Mul(left, right),
        lambda: Mul(left, left),
        lambda: Div(left, right),
        lambda: Neg(left),
        lambda: Pow(left, rng.choice([2, 3])),
        lambda: Call(rng.choice(["abs", "sqrt"]), (left,)),
        lambda: Call(rng.choice(["min", "max"]), (left, right)),
    ]
    return rng.choice(made)()


def condition(rng: random.Random) -> Formula:
    atoms = [
        Compare(rng.choice(["<", "<=", ">", ">=", "=", "!="]), term(rng, 2), term(rng, 1)) for _ in range(3)
    ]
    return rng.choice([atoms[0], And((atoms[0], atoms[1])), Or((atoms[0], And((atoms[1], atoms[2]))))])


@pytest.fixture(scope="module")
def tapes() -> list[Tape]:
    rng = random.Random(23)
    found = [formula_tape(Builder(), condition(rng)) for _ in range(2 * CONDITIONS)]
    return [t for t in found if {s.name for s in t.inputs} == {"u", "a"}][:CONDITIONS]


@pytest.fixture(scope="module")
def native(tapes: list[Tape], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """`holds` and `refuted` by number of the condition."""
    lines = ["#include <stdbool.h>", '#include "flow_exact.h"', '#include "functions.h"']
    for k, tape in enumerate(tapes):
        printed = print_tape(tape, str, True)
        proof = refutation(tape, str, "u", "z")
        assert proof is not None
        body = " ".join([*printed.statements, f"return {printed.expression};"])
        lines.append(f"static bool holds{k}(double u, double a) {{ (void)u, (void)a; {body} }}")
        lines.append(
            f"static bool refuted{k}(dl2c_hull z, double a) {{ (void)z, (void)a; {' '.join(proof)} }}"
        )
    tables = [
        f"static bool (*const all_{name}[])({kinds}) = "
        f"{{{', '.join(f'{name}{k}' for k in range(len(tapes)))}}};"
        for name, kinds in (("holds", "double, double"), ("refuted", "dl2c_hull, double"))
    ]
    calls = {
        "bool holds(int k, double u, double a)": "all_holds[k](u, a)",
        "bool refuted(int k, double low, double high, double a)": "all_refuted[k]((dl2c_hull){low, high}, a)",
    }
    return functions(tmp_path_factory.mktemp("hulls"), "\n".join([*lines, *tables]), calls)


def test_what_is_refuted_holds_nowhere_inside(native: Any, tapes: list[Tape]) -> None:
    rng = random.Random(7)
    refuted = 0
    for k in range(len(tapes)):
        for _ in range(CASES):
            a = rng.choice([0.0, -1.5, rng.uniform(-4, 4), 1e200])
            width = rng.choice([0.0, 1e-15, 0.1, 3.0, 1e160])
            low = rng.choice([0.0, -2.0, rng.uniform(-4, 4)])
            high = low + width
            if not native.refuted(k, low, high, a):
                continue
            refuted += 1
            inside = [low, high, *(min(low + rng.random() * width, high) for _ in range(POINTS))]
            assert not any(native.holds(k, u, a) for u in inside), (k, low, high, a)
    assert refuted > len(tapes) * CASES / 10


def test_a_square_knows_its_sign() -> None:
    """Without which no joint bound of two inputs could be refuted."""
    tape = formula_tape(Builder(), Compare("<=", Add(Mul(U, U), Number(Fraction(1))), Number(Fraction(0))))
    proof = refutation(tape, str, "u", "z")
    assert proof is not None and any("dl2c_hull_square(z)" in line for line in proof)


def test_numbers_that_count_as_truths_refute_nothing() -> None:
    steps = [Instruction("input", name="u"), Instruction("constant", value=1.0)]
    steps += [Instruction("le", (0, 1)), Instruction("and", (2, 1))]
    assert refutation(Tape((U,), tuple(steps), 3), str, "u", "z") is None
    assert refutation(Tape((U,), tuple(steps[:3]), 2), str, "u", "z") is not None


def test_operations_without_intervals_refute_nothing() -> None:
    tape = formula_tape(Builder(), Compare("<=", Call("sin", (U,)), A))
    assert refutation(tape, str, "u", "z") is None
