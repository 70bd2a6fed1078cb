"""Bounds of a number in place of a quantifier: the same truth, and one conjunction."""

from fractions import Fraction
from random import Random

import pytest
from selection import quick_among

from dl2c.ir.evaluate import truth
from dl2c.ir.logic import conjunction, disjunction, symbols
from dl2c.ir.model import Add, And, Compare, Comparison, Formula, Mul, Number, Pow, Symbol, Term
from dl2c.quantifiers.eliminate import Quantifier, eliminated
from dl2c.quantifiers.linear import some_between
from dl2c.source import NOWHERE

X, P, Q = (Symbol(name, "variable") for name in "xpq")
OPERATORS: tuple[Comparison, ...] = ("<", "<=", "=", ">=", ">")


def condition(random: Random) -> Compare:
    """c * x + p * ... compared with q."""
    slope = Number(Fraction(random.choice((-2, -1, 1, 3)), random.choice((1, 2))))
    rest: Term = random.choice((P, Q, Mul(P, Q), Pow(P, 2), Number(Fraction(random.randint(-2, 2)))))
    left: Term = Add(Mul(slope, X), rest) if random.random() < 0.8 else rest
    sides = left, random.choice((P, Q, Number(Fraction(1)), X))
    return Compare(random.choice(OPERATORS), *(sides if random.random() < 0.5 else sides[::-1]))


def formula(random: Random, depth: int = 2) -> Formula:
    if depth == 0:
        return condition(random)
    parts = [formula(random, depth - 1) for _ in range(random.randint(1, 3))]
    return conjunction(parts) if random.random() < 0.6 else disjunction(parts)


@pytest.mark.parametrize("seed", quick_among(range(300), range(100)))
def test_the_truth_is_that_of_virtual_substitution(seed: int) -> None:
    random = Random(seed)
    body = formula(random)
    found = some_between(X, body)
    if found is None:  # too many clauses, or the symbol cancels out
        return
    assert X not in symbols(found)
    expected = eliminated(Quantifier(False, "x", X, False, NOWHERE), body)
    for _ in range(60):
        state = {s: Fraction(random.randint(-6, 6), random.choice((1, 2, 3))) for s in (P, Q)}
        assert truth(found, state, exact=True) == truth(expected, state, exact=True), state


def test_most_of_them_are_questions_of_bounds() -> None:
    assert sum(some_between(X, formula(Random(seed))) is not None for seed in range(300)) > 200


def test_bounds_are_one_conjunction() -> None:
    one = Number(Fraction(1))
    body = And((Compare("<=", P, X), Compare("<", X, Q), Compare("<=", Number(Fraction(0)), X)))
    assert some_between(X, body) == And((Compare("<", P, Q), Compare(">", Q, Number(Fraction(0)))))
    assert some_between(X, Compare("!=", X, P)) is None
    assert some_between(X, Compare("<=", Mul(P, X), one)) is None
    assert some_between(X, Compare("<=", Pow(X, 2), one)) is None
