"""Alternatives that leave no case out are replaced by what means the same, also where a term has no value."""

from fractions import Fraction

import numpy as np
import pytest
from policy_proof.test_conditions import NAMES, OPERATORS, term

from dl2c.ir.evaluate import truth
from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import TRUE, And, Compare, Comparison, Div, Formula, Number, Or, Symbol, Term
from dl2c.policy_proof.cases import exhausted

X, Y = NAMES
ONE = Number(Fraction(1))


def comparison(rng: np.random.Generator, terms: list[Term]) -> Compare:
    left, right = (terms[rng.integers(len(terms))] for _ in range(2))
    return Compare(OPERATORS[rng.integers(6)], left, right)


def formula(rng: np.random.Generator, terms: list[Term], depth: int) -> Formula:
    """Few terms, so that comparisons of the same ones meet."""
    if depth == 0:
        return comparison(rng, terms)
    parts = [formula(rng, terms, int(rng.integers(depth))) for _ in range(int(rng.integers(2, 5)))]
    return disjunction(parts) if rng.random() < 0.6 else conjunction(parts)


def points(rng: np.random.Generator, count: int) -> list[dict[Symbol, Fraction]]:
    return [{s: Fraction(int(rng.integers(-4, 5)), 2) for s in NAMES} for _ in range(count)]


@pytest.mark.parametrize("seed", range(60))
def test_the_truth_stays_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terms = [term(rng, 2), Div(X, Y), X, Number(Fraction(0))]
    for _ in range(10):
        before = formula(rng, terms[:3] if rng.random() < 0.5 else terms[1:], 3)
        after = exhausted(before)
        for point in points(rng, 40):
            assert truth(after, point, exact=True) == truth(before, point, exact=True), (before, point)


@pytest.mark.parametrize(("one", "other"), [("<=", ">"), ("<", ">="), ("=", "!=")])
def test_nothing_is_left_of_what_is_always_so(one: Comparison, other: Comparison) -> None:
    both = Or((Compare(one, X, Y), Compare(other, X, Y)))
    turned = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(other, other)
    assert exhausted(both) == TRUE
    assert exhausted(Or((Compare(one, X, Y), Compare(turned, Y, X)))) == TRUE  # type: ignore[arg-type]
    third = Or((Compare("<", X, Y), Compare("=", X, Y), Compare(">", X, Y)))
    assert exhausted(third) == TRUE


def test_a_division_has_to_have_a_value() -> None:
    ratio = Div(ONE, X)
    assert exhausted(Or((Compare("<=", ratio, Y), Compare(">", ratio, Y)))) == Compare(
        "!=", X, Number(Fraction(0))
    )


def test_alternatives_beside_the_same_conditions_become_one() -> None:
    """As where a program branches before the policy decides: three ways of a car in front."""
    guard, slow, fast = Compare(">", X, ONE), Compare("<=", Y, ONE), Compare(">=", Y, Number(Fraction(5)))
    middling = Compare("<", Y, Number(Fraction(5)))
    ways = (And((fast, guard)), And((middling, slow, guard)), And((middling, Compare(">", Y, ONE), guard)))
    assert exhausted(Or(ways)) == guard
