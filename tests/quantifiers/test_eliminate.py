"""Quantifiers are replaced by equivalent conditions, exactly; where that is not done, a place says why."""

import math
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import pytest
from differential import pair_of
from generators.ir_builder import formula
from generators.kyx_builder import codes, lowered, model_text, resolved
from hypothesis import example
from hypothesis import strategies as st
from oracles.ir import holds
from selection import few_and_many_examples

from dl2c.diagnostics import CompileError
from dl2c.env.single import Dl2cEnv
from dl2c.ir.evaluate import truth
from dl2c.ir.logic import atoms, symbols
from dl2c.ir.model import Add, And, Call, Compare, Div, Formula, Mul, Neg, Number, Or, Sub, Symbol, Term
from dl2c.ir.printer import print_formula
from dl2c.lower.terms import lower_formula, lower_predicate
from dl2c.parse.parser import parse_formula
from dl2c.quantifiers.eliminate import Quantifier, eliminated
from dl2c.smt.terms import condition, z3
from dl2c.source import NOWHERE

pytestmark = pytest.mark.usefixtures("unoptimised")

X, P, Q = (Symbol(name, "variable") for name in "xpq")
SCOPE = {name: Symbol(name, "variable") for name in ("a", "b", "c", "v", "x", "y", "z", "ep", "m")}


def quantified(everything: bool, body: Formula) -> Formula:
    return eliminated(Quantifier(everything, "x", X, False, NOWHERE), body)


def without(text: str) -> Formula:
    """The condition that a formula as users write it is lowered to."""
    return lower_formula(parse_formula(text), SCOPE)


def printed(text: str) -> str:
    return print_formula(without(text))


# The law --------------------------------------------------------------------------

numbers = st.sampled_from([Fraction(n) for n in (-2, -1, 0, 1, 2, 3)] + [Fraction(1, 2)])
coefficients = st.one_of(
    numbers.map(Number),
    st.sampled_from((P, Q, Neg(P), Add(P, Q), Sub(Q, Number(Fraction(1))), Mul(P, Q), Div(P, Q))),
)


@st.composite
def quadratics(draw: st.DrawFn, degree: int = 2) -> Term:
    result: Term = draw(coefficients)
    for power in range(1, draw(st.integers(0, degree)) + 1):
        monomial = X if power == 1 else Mul(X, X)
        result = Add(Mul(draw(coefficients), monomial), result)
    return result


lines = quadratics(1)
sides = st.one_of(
    quadratics(),
    quadratics(),
    quadratics(),
    lines.map(lambda t: Call("abs", (t,))),
    st.builds(lambda f, a, b: Call(f, (a, b)), st.sampled_from(("min", "max")), lines, lines),
    st.builds(Div, lines, lines),
    st.builds(Mul, lines, lines),
    st.builds(lambda a, b: Mul(a, Call("abs", (b,))), coefficients, lines),
)
comparisons = st.builds(
    Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), sides, st.one_of(lines, coefficients)
)
bodies = st.recursive(
    comparisons,
    lambda inner: st.builds(
        lambda make, parts: make(tuple(parts)),
        st.sampled_from((And, Or)),
        st.lists(inner, min_size=2, max_size=3),
    ),
    max_leaves=4,
)
values = st.sampled_from([Fraction(n, d) for n in range(-4, 5) for d in (1, 2)])


def decided_by_z3(everything: bool, body: Formula, at: dict[Symbol, Fraction]) -> bool:
    """For some or every x, by Z3's procedure for polynomials in one unknown."""
    context = z3.Context()
    solver = z3.SolverFor("QF_NRA", ctx=context)
    true = condition(body, context)
    solver.add(z3.Not(true) if everything else true)
    for symbol, value in at.items():
        solver.add(z3.Real(symbol.name, context) == z3.RealVal(str(value), context))
    answer = solver.check()
    assert answer != z3.unknown
    return (answer == z3.sat) != everything


@few_and_many_examples(
    40, 200, st.booleans(), bodies, st.lists(st.tuples(values, values), min_size=3, max_size=3)
)
@example(True, formula("x*x > p or x/q > 1"), [(Fraction(0), Fraction(0)), (Fraction(-1), Fraction(2))])
def test_the_result_holds_where_the_quantified_formula_does(
    everything: bool, body: Formula, points: list[tuple[Fraction, Fraction]]
) -> None:
    try:
        result = quantified(everything, body)
    except CompileError as refused:
        assert set(codes(refused)) == {"quantifier"}
        return
    assert X not in symbols(result)
    for p, q in points:
        at = {P: p, Q: q}
        assert holds(result, at) == decided_by_z3(everything, body, at), (print_formula(result), at)


@few_and_many_examples(15, 60, st.booleans(), bodies)
def test_an_undefined_part_makes_no_difference(everything: bool, body: Formula) -> None:
    """At q = 0 the coefficient p/q has no value: atoms that have it are false for every x."""
    try:
        result = quantified(everything, body)
    except CompileError:
        return
    for p in (Fraction(-1), Fraction(0), Fraction(2)):
        at = {P: p, Q: Fraction(0)}
        assert holds(result, at) == decided_by_z3(everything, body, at), print_formula(result)


def decided_with_quantifiers(text: str, result: Formula, quantified_text: Any) -> None:
    """Z3 finds no state at which they differ; `quantified_text` makes the formula of Z3's names."""
    context = z3.Context()
    real = {name: z3.Real(name, context) for name in "abcvxyzmt"}
    solver = z3.Solver(ctx=context)
    solver.add(z3.Xor(quantified_text(z3, **real), condition(result, context)))
    assert solver.check() == z3.unsat, text


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        (
            "\\exists x x^2 + b*x + c <= 0",
            lambda z3, x, b, c, **_: z3.Exists(x, x * x + b * x + c <= 0),
        ),
        (
            "\\exists x a*x^2 + b*x + c = 0",
            lambda z3, a, x, b, c, **_: z3.Exists(x, a * x * x + b * x + c == 0),
        ),
        (
            "\\forall x a*x^2 + b*x + c > 0",
            lambda z3, a, x, b, c, **_: z3.ForAll(x, a * x * x + b * x + c > 0),
        ),
        (
            "\\forall t (0 <= t & t <= c -> x + v*t <= m)",
            lambda z3, t, c, x, v, m, **_: z3.ForAll(t, z3.Implies(z3.And(t >= 0, t <= c), x + v * t <= m)),
        ),
        (
            "\\forall t (0 <= t & t <= c -> x + v*t - t^2/2 <= m)",
            lambda z3, t, c, x, v, m, **_: z3.ForAll(
                t, z3.Implies(z3.And(t >= 0, t <= c), x + v * t - t * t / 2 <= m)
            ),
        ),
        (
            "\\forall x \\exists y (y^2 = x & y > c | x < c)",
            lambda z3, x, y, c, **_: z3.ForAll(x, z3.Exists(y, z3.Or(z3.And(y * y == x, y > c), x < c))),
        ),
        (
            "\\exists x \\exists y (x^2 + y^2 = 1 & x + y = c)",
            lambda z3, x, y, c, **_: z3.Exists([x, y], z3.And(x * x + y * y == 1, x + y == c)),
        ),
    ],
)
def test_well_known_conditions_are_found(text: str, meaning: Any) -> None:
    decided_with_quantifiers(text, without(text), meaning)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("\\exists x x^2 + b*x + c <= 0", "b^2 >= 4 * c"),
        ("\\exists y (y > x & y < z)", "x < z"),
        ("\\exists y (y = x + 1 & y > 2)", "x > 1"),
        ("\\forall y (y > 0 -> y*x > 0)", "x > 0"),
        ("\\forall y y^2 >= 0", "true"),
        ("\\exists y a > b", "a > b"),
        ("\\forall x \\exists y y > x", "true"),
        ("\\exists y y > 1/c", "c != 0"),
        ("\\exists y y/0 > 1", "false"),
        ("\\exists y (y^3 - 4*y > 0 & y < 0 & c < 1)", "c < 1"),
        (
            "\\forall t (0 <= t & t <= ep -> x + v*t <= z)",
            "(ep < 0 | x <= z) & (v <= 0 | ep * v + x <= z | x > z)",
        ),
    ],
)
def test_simple_results_are_short(text: str, expected: str) -> None:
    assert printed(text) == expected


def test_names_are_bound_where_the_quantifier_says() -> None:
    """Not by the program variable, constant or inner quantifier of the same name."""
    assert printed("x > 1 & \\exists x (x > z & x < y)") == "x > 1 & y > z"
    assert printed("\\exists x (x = z & \\forall x x^2 + 1 > y & x > b)") == "y < 1 & b < z"
    definitions = """
        Real c;
        Bool least(Real k) <-> k >= c;
        Bool above(Real y) <->
          \\exists x (x > y & x < 2 & \\forall c (c > 2 -> c > x)) & \\exists c (c < x & least(c));
    """
    precondition = lowered("above(x) & c > 0 -> [{x := v;}*] x > 0", definitions).precondition
    assert print_formula(precondition) == "x < 2 & c < x & c > 0"


def test_atoms_are_relaxed_before_elimination() -> None:
    formula = parse_formula("\\exists y (y >= x & y <= z)")
    made = lower_predicate("near", "safety", formula, SCOPE, Fraction(1, 100))
    strict, relaxed = made.formula, made.relaxed
    at = {SCOPE["x"]: Fraction(1), SCOPE["z"]: Fraction(99, 100)}
    assert not truth(strict, at, True) and truth(relaxed, at, True)
    assert not truth(relaxed, {**at, SCOPE["z"]: Fraction(9, 10)}, True)


def test_atoms_keep_a_place_in_the_source() -> None:
    """What comes of conditions on the quantified variable stands for the whole formula."""
    text = "\\forall t (v > 1 | 0<=t & t<=ep -> x + v*t <= z & a < b)"
    spans = {print_formula(a): a.span.text for a in atoms(without(f"c > 0 & {text}"))}
    assert spans.pop("c > 0") == "c > 0" and spans.pop("a < b") == "a < b"
    assert spans and set(spans.values()) <= {text, "v > 1"}


def test_a_negated_quantifier_is_the_opposite_condition() -> None:
    model = lowered("true -> [{if (\\exists y (y^2 < x & y > v)) {x := 0;} else {x := v;}}*] x > 0")
    (branch,) = model.body
    assert type(branch).__name__ == "If"


def test_parameters_are_not_bound_by_a_quantified_call() -> None:
    problem = resolved(
        "p(x) -> [{x := v;}*] \\forall y (y > x -> p(y))",
        "/* @safety: penalty=-1 */ Bool p(Real k) <-> k > 0;",
    )
    assert print_formula(lower_formula(problem.predicates[0].formula, SCOPE)) == "x > 0"


# Models ----------------------------------------------------------------------------


def test_a_quantified_test_runs_alike_in_both_forms(tmp_path: Path) -> None:
    """The first alternative where z^2 + v*z + x < 0 has a solution above -2."""
    pair = pair_of("{?\\exists z (z^2 + v*z + x < 0 & z > -2); x := x + v; ++ v := -v;}", tmp_path)
    rng = Random(0)
    seen = set[bool]()
    for _ in range(60):
        x, v = rng.randint(-6, 6) / 2, rng.randint(-12, 12) / 2
        step = pair.step_from({"x": x, "v": v}, {}, {"choice_0": 0}, {})
        solutions = v * v > 4 * x and -v + math.sqrt(v * v - 4 * x) > -4
        assert step.state == ({"x": x + v, "v": v} if solutions else {"x": x, "v": -v})
        seen.add(solutions)
    assert seen == {False, True}


def test_initial_states_satisfy_a_quantified_precondition(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    text = model_text(
        "0 <= v & v <= 4 & 0 <= x & \\forall t (0 <= t & t <= 1 -> x + v*t - t^2 <= 5) -> "
        "[{?\\exists y (y >= x & y <= 5); v := 0; {x' = v}}*] x <= 6"
    )
    file = tmp_path / "m.kyx"
    file.write_text(text, encoding="utf-8")
    with Dl2cEnv(file, default_bound=(-10, 10)) as env:
        for seed in range(30):
            env.reset(seed=seed)
            x, v = (env.state[name] for name in "xv")
            assert 0 <= v <= 4 and all(x + v * t / 64 - (t / 64) ** 2 <= 5 + 1e-9 for t in range(65))
            env.step(env.action_space.sample())


def test_very_many_quantifiers_are_refused() -> None:
    with pytest.raises(CompileError) as refused:
        lowered(
            "p4() -> [{x := v;}*] x > 0",
            "Bool p0 <-> \\exists y y > x;"
            + "".join(f"Bool p{k + 1} <-> p{k}() & p{k}() & p{k}() & p{k}();" for k in range(4)),
        )
    assert codes(refused.value) == ["quantifier"]
