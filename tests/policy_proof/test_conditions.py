"""What is said of conditions on boxes holds at every exact point of them."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from policy_proof.questions import question

from dl2c.ir.evaluate import truth
from dl2c.ir.model import (
    FALSE,
    Add,
    And,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
)
from dl2c.native.boxes import OUTSIDE, PROVED, Judge
from dl2c.policy.network import Layer
from dl2c.policy_proof.tables import tables_of

NAMES = (Symbol("x0", "variable"), Symbol("x1", "variable"))
OPERATORS: tuple[Comparison, ...] = ("<", "<=", "=", "!=", ">", ">=")
NETWORK = (Layer(np.zeros((1, 2)), np.zeros(1), "identity"),)
BOX = ((Fraction(-4), Fraction(4)),) * 2


def term(rng: np.random.Generator, depth: int) -> Term:
    if depth == 0 or rng.random() < 0.15:
        return NAMES[rng.integers(2)] if rng.random() < 0.7 else Number(Fraction(int(rng.integers(-6, 7)), 2))
    a, b = term(rng, depth - 1), term(rng, depth - 1)
    match int(rng.integers(10)):
        case 0:
            return Neg(a)
        case 1 | 2:
            return Add(a, b)
        case 3 | 4:
            return Sub(a, b)
        case 5 | 6:
            return Mul(a, b)
        case 7:
            return Div(a, b)
        case 8:
            return Pow(a, int(rng.integers(2, 4)))
        case _:
            name = ("abs", "min", "max")[rng.integers(3)]
            return Call(name, (a,) if name == "abs" else (a, b))


def formula(rng: np.random.Generator, depth: int) -> Formula:
    if depth == 0:
        return Compare(OPERATORS[rng.integers(6)], term(rng, 2), term(rng, 2))
    parts = tuple(formula(rng, depth - 1) for _ in range(2))
    return And(parts) if rng.random() < 0.5 else Or(parts)


def points(box: np.ndarray, rng: np.random.Generator) -> list[dict[Symbol, Fraction]]:
    """Corners, simple numbers inside and others."""
    ends = [
        [float(low), float(high), float(rng.uniform(low, high)), float(np.clip(0, low, high))]
        for low, high in box
    ]
    return [dict(zip(NAMES, map(Fraction, p), strict=True)) for p in product(*ends)]


@pytest.mark.parametrize("seed", range(40))
def test_verdicts_hold_at_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    written = formula(rng, int(rng.integers(3)))
    outside = Judge(tables_of(question(NETWORK, BOX, FALSE, hypothesis=written)))
    proved = Judge(tables_of(question(NETWORK, BOX, written)))
    middles = rng.integers(-6, 7, (60, 2)) / 2
    widths = rng.choice([0, 0.25, 1, 3], (60, 2))
    boxes = np.stack([middles - widths / 2, middles + widths / 2], 2)
    for box, is_outside, is_proved in zip(
        boxes, outside.verdicts(boxes, 2)[0] == OUTSIDE, proved.verdicts(boxes, 1)[0] == PROVED, strict=True
    ):
        for point in points(box, rng):
            holds = truth(written, point, exact=True)
            assert not (is_outside and holds)
            assert not is_proved or holds


def test_much_is_decided() -> None:
    """The verdicts above are not all open."""
    disc = Compare("<=", Add(Pow(NAMES[0], 2), Pow(NAMES[1], 2)), Number(Fraction(4)))
    boxes = np.array([[[2.1, 3], [-1, 1]], [[-1, 1], [-1, 1]], [[1, 2], [1, 2]]])
    assert list(
        Judge(tables_of(question(NETWORK, BOX, FALSE, hypothesis=disc))).verdicts(boxes, 1)[0][:1]
    ) == [OUTSIDE]
    assert list(Judge(tables_of(question(NETWORK, BOX, disc))).verdicts(boxes, 1)[0][1:2]) == [PROVED]


def test_verdicts_do_not_depend_on_threads() -> None:
    rng = np.random.default_rng(5)
    judge = Judge(tables_of(question(NETWORK, BOX, formula(rng, 2), hypothesis=formula(rng, 1))))
    low = rng.uniform(-4, 4, (3000, 2))
    boxes = np.stack([low, low + rng.uniform(0, 1, (3000, 2))], 2)
    first, second = judge.verdicts(boxes, 1), judge.verdicts(boxes, 4)
    assert (first[0] == second[0]).all() and (first[1] == second[1]).all()
