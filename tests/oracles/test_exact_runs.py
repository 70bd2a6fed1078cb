"""The exact runner itself, on models whose answers are known."""

from fractions import Fraction
from itertools import pairwise
from random import Random

import pytest
from oracles.exact_motion import Flow, Moment, Stuck, after
from oracles.exact_numbers import Unclear
from oracles.exact_random import first_invariant, initial, refutation, run
from oracles.exact_runs import premises, refutes, theorem
from oracles.exact_time import Poly, isolated, points, squarefree
from oracles.exact_values import truth
from oracles.sturm import from_roots, value
from selection import few_and_many

from dl2c.parse import tree
from dl2c.parse.parser import parse_formula, parse_program

F = Fraction


def flow(text: str) -> tree.ODESystem:
    found = parse_program(text)
    assert isinstance(found, tree.ODESystem)
    return found


def model(problem: str) -> tree.Formula:
    variables = "Real x; Real y; Real v; Real t; Real a;"
    return theorem(f'ArchiveEntry "M" ProgramVariables {variables} End. Problem {problem} End. End.')


# Polynomials ------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(30))
def test_roots_are_isolated(seed: int) -> None:
    random = Random(seed)
    roots = [F(random.randint(-9, 9), random.choice((1, 2, 3))) for _ in range(random.randint(1, 6))]
    c = squarefree(tuple(from_roots(roots, random.choice((-2, 3)))))
    assert len(c) == len(set(roots)) + 1
    found = isolated(c, F(-10), F(10))
    assert len(found) == len(set(roots))
    for (a, b), root in zip(found, sorted(set(roots)), strict=True):
        assert a < root < b or a == root == b


@pytest.mark.parametrize("seed", range(30))
def test_points_meet_every_combination_of_signs(seed: int) -> None:
    random = Random(seed)
    roots = [[F(random.randint(-4, 4)) for _ in range(random.randint(0, 4))] for _ in range(3)]
    polynomials = [from_roots(r) for r in roots]
    polynomials[0] = [a * b for a, b in zip(polynomials[0], [F(2)] * len(polynomials[0]), strict=True)]
    ends = [F(-10), *sorted({r for some in roots for r in some}), F(10)]
    samples = [*ends, *((a + b) / 2 for a, b in pairwise(ends))]
    expected = {tuple((value(c, s) > 0) - (value(c, s) < 0) for c in polynomials) for s in samples}
    assert {tuple(map(point, polynomials)) for point in points(polynomials, F(-10), F(10))} == expected


def test_irrational_zeros_are_points() -> None:
    square, cube = (F(-2), F(0), F(1)), (F(-2), F(0), F(0), F(1))
    signs = [(point(square), point(cube)) for point in points([square, cube], F(0), F(2))]
    assert signs == [(-1, -1), (-1, -1), (-1, 1), (1, 1), (-1, 0), (0, 1), (1, 1)]


def test_a_germ_has_the_sign_of_its_first_coefficient() -> None:
    t = Poly((F(0), F(1)), order=4)
    assert t.sign() == 1
    assert (t * t - t).sign() == -1
    assert (1 / (1 - t)).c == (1, 1, 1, 1, 1)
    with pytest.raises(Unclear):
        (t - t).sign()


# Motion -----------------------------------------------------------------------


def test_a_ball_falls() -> None:
    later = after(flow("{h' = v, v' = -10 & h >= 0}"), {"h": F(5), "v": F(0)}, Flow(F(1)))
    assert later == {"h": 0, "v": -10}


@pytest.mark.parametrize(
    ("domain", "time", "allowed"),
    [
        ("x <= 1", "1", True),
        ("x < 1", "1", False),
        ("x^2 <= 2", "1.41", True),
        ("x^2 <= 2", "1.42", False),
        ("x^2 != 2", "1.42", False),
        ("(x - 1)^2 >= 0", "2", True),
        ("(x - 1)^2 > 0", "2", False),
        ("(x - 1)^2 > 0", "1/2", True),
        ("x <= 1 | x >= 1", "2", True),
        ("x < 1 | x > 1", "2", False),
        ("x <= 1 | x > 2", "3", False),
        ("abs(x - 1) <= 1", "2", True),
        ("abs(x - 1) < 1", "1/2", False),
        ("max(x, 1) <= 2 & min(x, 3) >= 0", "2", True),
        ("max(x, 1) <= 2", "5/2", False),
        ("1/y > 0", "1", False),
        ("!(1/y > 0) | x >= 0", "1", True),
        ("x < 0", "0", False),
    ],
)
def test_the_domain_holds_all_the_time(domain: str, time: str, allowed: bool) -> None:
    state = {"x": F(0), "y": F(0)}
    ode = flow(f"{{x' = 1 & {domain}}}")
    if allowed:
        assert after(ode, state, Flow(F(time)))["x"] == F(time)
    else:
        with pytest.raises(Stuck):
            after(ode, state, Flow(F(time)))


def test_motion_that_is_no_polynomial_is_unclear() -> None:
    ode = flow("{x' = a*x}")
    with pytest.raises(Unclear):
        after(ode, {"x": F(1), "a": F(1)}, Flow(F(1)))
    assert after(ode, {"x": F(1), "a": F(0)}, Flow(F(1)))["x"] == 1


def test_given_solutions_are_checked() -> None:
    ode = flow("{x' = sqrt(x)}")
    good, bad = Flow(F(2), {"x": (0, 0, F(1, 4))}), Flow(F(2), {"x": (0, 0, 1)})
    assert after(ode, {"x": F(0)}, good)["x"] == 1
    for wrong, start in ((bad, F(0)), (good, F(1))):
        with pytest.raises(Stuck):
            after(ode, {"x": start}, wrong)
    with pytest.raises((Stuck, Unclear)):  # the root of (1 - t)^2 is t - 1 after 1
        after(flow("{x' = -2*sqrt(x) & x >= 0}"), {"x": F(1)}, Flow(F(2), {"x": (1, -2, 1)}))


def test_a_moment() -> None:
    later = after(flow("{x' = x^2 + 1, y' = 0}"), {"x": F(0), "y": F(3)}, Moment())
    assert truth(parse_formula("x > 0 & x < 0.001 & y = 3"), later)
    with pytest.raises(Stuck):
        after(flow("{x' = 1, y' = x & y <= 0}"), {"x": F(0), "y": F(0)}, Moment())


# Formulas ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "holds"),
    [
        ("\\forall y (y^2 >= x)", False),
        ("\\forall y (y^2 >= x - 1)", True),
        ("\\exists y (y^2 = x + 1)", True),
        ("\\exists y (y^2 = x - 3)", False),
        ("\\exists x (x = 2)", True),
        ("1/v > 0", False),
        ("!(1/v > 0)", False),
        ("1/v > 0 | x = 1", True),
        ("sqrt(2) < 1.4142135623730951", True),
        ("exp(x) > 2.718281828", True),
        ("[x := x + 1; ++ x := 5;] x >= 2", True),
        ("<x := x + 1; ++ x := 5;> x = 5", True),
        ("[{x := x + 1; ++ x := 5;}^@] x = 5", True),
        ("[{?x = 2;}^@] x = 1", False),
        ("[?x = 2;] false", True),
        ("x = 1 <-> v = 0", True),
        ("-x^2 = -1 & 2^3^2 = 512 & v^0 = 1", True),
    ],
)
def test_truth(formula: str, holds: bool) -> None:
    assert truth(parse_formula(formula), {"x": F(1), "y": F(0), "v": F(0)}) == holds


def test_overlapping_intervals_are_unclear() -> None:
    with pytest.raises(Unclear):
        truth(parse_formula("sqrt(2)*sqrt(2) = 2"), {})


# Whole theorems ------------------------------------------------------------------


TRUE = (
    "x >= 0 -> [{x := x + 1;}*@invariant(x >= 0)] x >= 0",
    "x >= 0 & v >= 0 -> [{x' = v}] x >= 0",
    "x <= 5 & t = 0 -> [{{a := *; ?a <= 5 - x; t := 0; {x' = a, t' = 1 & t <= 1}}}*] x <= 5",
    "x = 0 & v^2 <= 2*y & y >= 0 & v >= 0 -> [{x' = v, v' = -1 & v >= 0}] x <= y",
    "x = 0 -> [{?x < 5; x := x + 1;}*] x <= 5",
    "x = 1 -> [y := 1/(x - 1);] false",
    "x = 0 & y = 0 -> [{x' = 1, y' = 2*x}] y = x^2",
    "x >= 0 -> [{x' = 1 & x^2 <= 2}] x < 1.5",
    "x >= 1 -> [{x := x*y; ?x >= 1; ++ x := 2*x;}*] x >= 1",
    "x = 0 -> [{x' = 1 & x < 3} ?x >= 3;] false",
)

FALSE = (
    "x = 0 -> [{x := x + 1;}*] x <= 12",
    "x >= 0 -> [{x' = v}] x >= 0",
    "x <= 5 & t = 0 -> [{{a := *; ?a <= 6 - x; t := 0; {x' = a, t' = 1 & t <= 1}}}*] x <= 5",
    "x = 0 & v^2 <= 2*y & y >= 0 & v >= 0 -> [{x' = v, v' = -1 & v >= 0}] (x < y | y = 0)",
    "x^2 + y^2 = 1 -> [{x := -x; ++ y := -y;}*] x < 1",
    "x >= 0 -> [{x' = 1 & x^2 <= 2}] x < 1.4",
    "true -> [x := *; y := *; ?x + y = 3; ?x - y = 1;] false",
    "x > 0 -> [{x := x/2;}*] x >= 0.001",
)


@pytest.mark.parametrize("count", few_and_many(40, 150))
@pytest.mark.parametrize("problem", TRUE)
def test_true_theorems_are_not_refuted(count: int, problem: str) -> None:
    assert refutation(model(problem), Random(1), count) is None


@pytest.mark.parametrize("problem", FALSE)
def test_false_theorems_are_refuted_by_chance(problem: str) -> None:
    formula = model(problem)
    found = refutation(formula, Random(1), 1500)
    assert found is not None and found.kind == "postcondition"
    assert refutes(formula, found.start, found.decisions)


def test_invariants_are_judged() -> None:
    formula = model("x = 0 -> [{x := x + 1;}*@invariant(x <= 3)] x >= 0")
    found = next(f for seed in range(99) if (f := run(formula, Random(seed)).finding) is not None)
    assert found.kind == "invariant"
    assert found.state["x"] == 4 and sum(found.decisions) == 4


def test_initial_states_satisfy_p_and_are_near_boundaries() -> None:
    formula = model("x^2 + y^2 <= 1 & v = 2*x & a > y -> [{x := x;}*@invariant(x <= a)] x <= a + 5")
    inside = first_invariant(formula)
    given, _ = premises(formula)
    found = [initial(formula, Random(seed), inside) for seed in range(60)]
    states = [state for state in found if state is not None]
    assert len(states) > 30
    assert all(truth(part, state) for state in states for part in given)
    assert sum(state["x"] == state["a"] for state in states) > 3
