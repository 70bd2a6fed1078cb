"""Violations where equations hold, of which no middle of a box is a solution."""

from fractions import Fraction
from random import Random

import numpy as np
import pytest
from policy_proof.questions import question

from dl2c.ir.evaluate import truth
from dl2c.ir.model import Add, Compare, Formula, Mul, Number, Pow, Symbol, Term
from dl2c.policy.network import Layer
from dl2c.policy_proof.points import violation_on_equations
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Limits, search

X, Y, Z = (Symbol(f"x{k}", "variable") for k in range(3))
ASKED = Symbol("y", "input")

EQUATIONS: dict[str, tuple[Term, Fraction]] = {
    "circle": (Add(Pow(X, 2), Pow(Y, 2)), Fraction(1)),
    "ellipse": (Add(Mul(Number(Fraction(4)), Pow(X, 2)), Pow(Y, 2)), Fraction(1)),
    "line": (Add(Mul(Number(Fraction(3)), X), Y), Fraction(1, 7)),
    "hyperbola": (Mul(X, Y), Fraction(1, 4)),
}


def asked(name: str, conclusion: Formula, bias: float = 0.0) -> Question:
    """A network that asks for 0.1 times the third dimension, on a curve of the other two."""
    term, value = EQUATIONS[name]
    layer = Layer(np.array([[0.0, 0.0, 0.1]]), np.array([bias]), "identity")
    box = ((Fraction(-1), Fraction(1)),) * 3
    return question((layer,), box, conclusion, Compare("=", term, Number(value)))


@pytest.mark.parametrize("name", EQUATIONS)
def test_a_violation_is_found_and_exact(name: str) -> None:
    """What is asked for is at most 0.1, but 0.05 is the limit where x is above 0."""
    too_much = Compare("<=", Mul(ASKED, X), Mul(Number(Fraction(1, 20)), X))
    about = asked(name, too_much)
    found = search(about, Limits(10.0, 1, lambda _: None))
    assert found.answer == "refuted" and found.violation is not None
    state = {s: found.violation.state[s.name] for s in (X, Y, Z)}
    assert truth(about.hypothesis, state, exact=True)
    assert not truth(too_much, {**state, ASKED: found.violation.requests["y"]}, exact=True)


@pytest.mark.parametrize("name", EQUATIONS)
def test_nothing_is_found_where_nothing_is_wrong(name: str) -> None:
    assert violation_on_equations(asked(name, Compare("<=", ASKED, Number(Fraction(1, 5))))) is None


def test_states_with_doubles_come_first() -> None:
    """So that the exported C can be asked."""
    found = violation_on_equations(asked("circle", Compare("<", ASKED, ASKED)))
    assert found is not None
    assert all(Fraction(float(v)) == v for v in found.state.values())


def test_without_equations_nothing_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    about = asked("line", Compare("<", ASKED, ASKED))
    free = question(about.layers, about.box, Compare("<", ASKED, ASKED), Compare("<=", X, Y))
    monkeypatch.setattr(Random, "randrange", None)
    assert violation_on_equations(free) is None


@pytest.mark.parametrize("name", ["circle", "ellipse"])
def test_a_rare_violation_is_a_solution(name: str) -> None:
    """Whatever is asked for: in a corner that is hardly ever drawn."""
    corner = Compare("<=", Add(Mul(Number(Fraction(1000)), Z), Y), Number(Fraction(10005, 10)))
    about = asked(name, corner)
    found = violation_on_equations(about)
    assert found is not None
    state = {s: found.state[s.name] for s in (X, Y, Z)}
    assert truth(about.hypothesis, state, exact=True) and not truth(corner, state, exact=True)


def test_it_ends_when_it_is_late() -> None:
    about = asked("circle", Compare("<=", ASKED, Number(Fraction(1, 5))))
    looks = iter([False] * 3)
    assert violation_on_equations(about, lambda: next(looks, True)) is None
    assert next(looks, None) is None
