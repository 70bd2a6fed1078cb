"""Laws of the algebra on terms and formulas: negation, relaxation, distance, substitution, polynomials."""

from collections.abc import Mapping
from fractions import Fraction
from math import isfinite

from generators.ir_builder import formula as ir_formula
from generators.ir_builder import term as ir_term
from hypothesis import assume, given
from hypothesis import strategies as st
from oracles.ir import SYMBOLS, X, exact, formulas, fractions, holds, leaves, terms

from dl2c.flows.solution import NotPolynomial, Solution, solve
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import (
    always_defined,
    atoms,
    conjunction,
    decided,
    delta,
    disjunction,
    folded,
    mapped,
    negation,
    oriented,
    sides,
    substituted,
)
from dl2c.ir.model import FALSE, TRUE, Add, Compare, Flow, Formula, Mul, Neg, Number, Sub, Symbol, Term
from dl2c.ir.polynomial import Coefficients, polynomial
from dl2c.ir.slack import relaxed

Point = Mapping[Symbol, Fraction]
points = st.fixed_dictionaries(dict.fromkeys(SYMBOLS, fractions))
small_points = st.fixed_dictionaries(dict.fromkeys(SYMBOLS, st.fractions(-4, 4, max_denominator=3)))
doubles = st.one_of(fractions.map(float), st.floats(-1e9, 1e9))
TOLERANCE = Fraction(1, 10**9)


def defined(formula: Formula, point: Point) -> bool:
    return all(exact(side, dict(point)) is not None for a in atoms(formula) for side in (a.left, a.right))


@given(formulas, points)
def test_truth_is_what_the_oracle_says(formula: Formula, point: Point) -> None:
    assert truth(formula, point, exact=True) == holds(formula, dict(point))


@given(formulas, points)
def test_negation_is_the_complement_where_everything_is_defined(formula: Formula, point: Point) -> None:
    assume(defined(formula, point))
    assert truth(negation(formula), point, exact=True) != truth(formula, point, exact=True)


@given(formulas, points)
def test_a_formula_and_its_negation_never_both_hold(formula: Formula, point: Point) -> None:
    assert not (truth(negation(formula), point, exact=True) and truth(formula, point, exact=True))


@given(st.builds(Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), terms, terms), points)
def test_an_undefined_atom_is_false_and_so_is_its_negation(atom: Compare, point: Point) -> None:
    if not defined(atom, point):
        assert not truth(atom, point, exact=True)
        assert not truth(negation(atom), point, exact=True)


def test_division_by_zero_is_undefined_in_both_polarities() -> None:
    atom = ir_formula("x / 0 == x / 0")
    point = {X: Fraction(1)}
    for exactly in (True, False):
        assert not truth(atom, point, exactly)
        assert not truth(negation(atom), point, exactly)


@given(formulas)
def test_negation_undoes_itself(formula: Formula) -> None:
    flat = negation(negation(formula))
    assert negation(negation(flat)) == flat


@given(st.lists(st.one_of(formulas, st.sampled_from((TRUE, FALSE))), max_size=4), points)
def test_conjunction_is_all_and_disjunction_is_any(parts: list[Formula], point: Point) -> None:
    each = [truth(p, point, exact=True) for p in parts]
    assert truth(conjunction(parts), point, exact=True) == all(each)
    assert truth(disjunction(parts), point, exact=True) == any(each)


@given(formulas, points)
def test_orientation_keeps_the_truth(formula: Formula, point: Point) -> None:
    turned = oriented(formula)
    assert truth(turned, point, exact=True) == truth(formula, point, exact=True)
    assert not any(a.op in (">", ">=") for a in atoms(turned))


# Relaxation -------------------------------------------------------------------


@given(formulas, points, st.sampled_from((Fraction(0), TOLERANCE, Fraction(1))))
def test_relaxation_only_grows(formula: Formula, point: Point, tolerance: Fraction) -> None:
    if truth(formula, point, exact=True):
        assert truth(relaxed(formula, tolerance), point, exact=True)


def has_values(formula: Formula, point: Mapping[Symbol, float]) -> bool:
    try:
        return all(isfinite(evaluate(side, point)) for side in sides(formula))
    except Undefined:
        return False


@given(
    formulas,
    st.fixed_dictionaries(dict.fromkeys(SYMBOLS, doubles)),
    st.sampled_from((TOLERANCE, Fraction(1))),
)
def test_what_holds_in_doubles_holds_relaxed(
    formula: Formula, point: dict[Symbol, float], tolerance: Fraction
) -> None:
    """Rounding does not matter."""
    wide = relaxed(formula, tolerance)
    assume(has_values(wide, point))
    assert truth(wide, point) or not truth(formula, point)


def test_no_tolerance_relaxes_nothing() -> None:
    formula = ir_formula("x < 1 and (y == 2 or x != 3)")
    assert relaxed(formula, Fraction(0)) == formula


def test_each_atom_is_relaxed_by_its_own_size() -> None:
    half = Fraction(1, 2)
    for text, x, grown in (
        ("x <= 3", 10, True),  # 10 <= 3 + (1 + 10 + 3)/2
        ("x <= 3", 11, False),  # 11 > 3 + (1 + 11 + 3)/2
        ("x >= 3", -1, False),  # -1 + (1 + 1 + 3)/2 < 3
        ("x >= 3", 0, False),  # 0 + (1 + 0 + 3)/2 < 3
        ("x >= 3", 1, True),  # 1 + (1 + 1 + 3)/2 >= 3
        ("x == 0", -1, True),  # 1 <= (1 + 1)/2
        ("x == 0", 2, False),  # 2 > (1 + 2)/2
        ("x != 0", 0, False),  # not relaxed
    ):
        assert truth(relaxed(ir_formula(text), half), {X: Fraction(x)}, exact=True) == grown, (text, x)


# Distance ---------------------------------------------------------------------


@given(formulas, points)
def test_a_positive_distance_means_satisfied(formula: Formula, point: Point) -> None:
    distance = delta(formula)
    assume(distance is not None and defined(formula, point))
    assert distance is not None
    measured = evaluate(distance, point, exact=True)
    if measured > 0:
        assert truth(formula, point, exact=True)
    if truth(formula, point, exact=True):
        assert measured >= 0


def test_distances_are_those_of_the_paper() -> None:
    """Equations 4 and 5, and their extension to `!=`, & and |."""
    point = {s: Fraction(k) for s, k in zip(SYMBOLS, (7, 3, 1), strict=True)}
    for text, expected in (
        ("x <= y", -4),
        ("x < y", -4),
        ("x >= y", 4),
        ("x > y", 4),
        ("x == y", -4),
        ("x != y", 4),
        ("x > y and z > 0", 1),
        ("x > y or z > 0", 4),
    ):
        distance = delta(ir_formula(text))
        assert distance is not None
        assert evaluate(distance, point, exact=True) == expected, text
    assert delta(TRUE) is None


# Terms ------------------------------------------------------------------------


@given(terms, points, st.sampled_from(SYMBOLS), terms)
def test_substitution_commutes_with_evaluation(term: Term, point: Point, symbol: Symbol, by: Term) -> None:
    inner = exact(by, dict(point))
    assume(inner is not None)
    assert inner is not None
    replaced = substituted(term, {symbol: by})
    assert exact(replaced, dict(point)) == exact(term, {**point, symbol: inner})


@given(formulas, points, st.sampled_from(SYMBOLS), leaves)
def test_mapping_a_substitution_keeps_the_truth(
    formula: Formula, point: Point, symbol: Symbol, by: Term
) -> None:
    moved = mapped(formula, lambda t: substituted(t, {symbol: by}))
    inner = exact(by, dict(point))
    assert inner is not None
    assert truth(moved, point, exact=True) == holds(formula, {**point, symbol: inner})


@given(terms, points)
def test_folding_keeps_the_value(term: Term, point: Point) -> None:
    assert exact(folded(term), dict(point)) == exact(term, dict(point))


@given(terms, points)
def test_what_is_always_defined_has_a_value(term: Term, point: Point) -> None:
    if always_defined(term):
        assert exact(term, dict(point)) is not None


def test_atoms_between_numbers_are_decided_only_where_rounding_agrees() -> None:
    assert decided(Compare("<", Number(Fraction(1)), Number(Fraction(2)))) == TRUE
    third = Compare("!=", Number(Fraction(1, 3)), Number(Fraction(1, 3) + Fraction(1, 10**30)))
    assert decided(third) == third


# Polynomials ------------------------------------------------------------------

coefficients = st.lists(leaves, min_size=1, max_size=3).map(tuple)


def at_time(curve: Coefficients, tau: Fraction, point: Point) -> Fraction:
    return sum((evaluate(c, point, exact=True) * tau**k for k, c in enumerate(curve)), Fraction(0))


@given(terms, st.fixed_dictionaries(dict.fromkeys(SYMBOLS[:2], coefficients)), small_points, fractions)
def test_a_composed_polynomial_has_the_value_of_the_term(
    term: Term, curves: dict[Symbol, Coefficients], point: Point, tau: Fraction
) -> None:
    found = polynomial(term, curves)
    moved = {**point, **{s: at_time(c, tau, point) for s, c in curves.items()}}
    wanted = exact(term, moved)
    if found is None or wanted is None:
        return
    try:
        assert at_time(found, tau, point) == wanted
    except Undefined:
        raise AssertionError("defined before composition, undefined after it") from None


def test_what_is_not_polynomial_in_time_is_recognised() -> None:
    moving = {X: (ir_term("x"), ir_term("y"))}
    for text in ("1 / x", "sqrt(x)", "abs(x)", "min(x, y)", "y / (x - x + x)"):
        assert polynomial(ir_term(text), moving) is None, text
    for text in ("x / y", "x**3", "sqrt(y) * x", "abs(y)"):
        assert polynomial(ir_term(text), moving) is not None, text
    assert polynomial(ir_term("0 / 0"), {}) == (ir_term("0 / 0"),)


rates = st.recursive(
    leaves,
    lambda inner: st.builds(lambda make, a, b: make(a, b), st.sampled_from((Add, Sub, Mul)), inner, inner),
    max_leaves=3,
)


def restricted(term: Term, names: tuple[Symbol, ...]) -> Term:
    """The term with every other symbol replaced by 2."""
    return substituted(term, {s: Number(Fraction(2)) for s in SYMBOLS if s not in names})


@given(st.tuples(rates, rates, rates), st.permutations(range(3)), small_points, fractions)
def test_polynomial_solutions_satisfy_the_ode(
    given_rates: tuple[Term, Term, Term], order: list[int], point: Point, tau: Fraction
) -> None:
    """x(0) = x, and the derivative of x(tau) is the right-hand side at x(tau)."""
    equations = [
        (s.name, restricted(r, SYMBOLS[k + 1 :]))
        for k, (s, r) in enumerate(zip(SYMBOLS, given_rates, strict=True))
    ]
    flow = Flow(tuple(equations[k] for k in order), TRUE, TRUE, (), Fraction(1))
    solution = solve(flow)
    if isinstance(solution, NotPolynomial):
        assert "degree" in solution.reason
        return
    assert_solves(solution, flow, point, tau)


def assert_solves(solution: Solution, flow: Flow, point: Point, tau: Fraction) -> None:
    moved = {**point, **{s: at_time(c, tau, point) for s, c in solution.curves.items()}}
    for name, rate in flow.equations:
        curve = solution.variables[name]
        derivative = [k * evaluate(c, point, exact=True) for k, c in enumerate(curve)][1:]
        slope = sum((d * tau**k for k, d in enumerate(derivative)), Fraction(0))
        assert curve[0] == Symbol(name, "variable")
        assert slope == evaluate(rate, moved, exact=True)


def test_what_stands_in_the_way_of_a_solution_is_named() -> None:
    def why(**rates: str) -> tuple[str, str]:
        solution = solve(Flow(tuple((x, ir_term(r)) for x, r in rates.items()), TRUE, TRUE, (), Fraction(1)))
        assert isinstance(solution, NotPolynomial)
        return solution.variable, solution.reason

    assert why(x="x") == ("x", "x' depends on itself, directly or through other variables")
    assert why(t="1", x="y", y="-x")[0] == "x"
    assert why(y="1", x="1 / y") == ("x", "x' is not a polynomial in the variables that evolve")
    assert "degree 13" in why(y="1", x="y**12")[1]


def test_a_variable_at_rest_does_not_move_others() -> None:
    solution = solve(Flow((("x", ir_term("v / v")), ("v", ir_term("0"))), TRUE, TRUE, (), Fraction(1)))
    assert isinstance(solution, Solution)
    assert solution.variables["v"] == (ir_term("v"),)
    assert solution.variables["x"] == (ir_term("x"), ir_term("v / v"))


def test_numbers_are_negated_exactly() -> None:
    assert folded(Neg(Number(Fraction(1, 10)))) == Number(Fraction(-1, 10))
