"""Normal forms of polynomials, and which equalities of a domain a flow keeps."""

from fractions import Fraction
from math import prod
from random import Random

import pytest
from generators.ir_builder import term

from dl2c.flows.conserved import is_darboux, is_invariant
from dl2c.ir.evaluate import evaluate
from dl2c.ir.model import Add, And, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.ir.normal import Normal, normal_form
from dl2c.lower.flow import lower_flow
from dl2c.options import Options
from dl2c.parse.parser import parse_program
from dl2c.parse.tree import ODESystem

SYMBOLS = (Symbol("x", "variable"), Symbol("y", "variable"), Symbol("c", "constant"))


def random_polynomial(rng: Random, depth: int) -> Term:
    if depth == 0:
        return rng.choice((*SYMBOLS, Number(Fraction(rng.randint(-3, 3), rng.randint(1, 3)))))
    one, other = (random_polynomial(rng, depth - 1) for _ in range(2))
    number = Number(Fraction(rng.randint(1, 4)))
    return rng.choice(
        (Add(one, other), Sub(one, other), Mul(one, other), Neg(one), Div(one, number), Pow(one, 2))
    )


def value(form: Normal, at: dict[Symbol, Fraction]) -> Fraction:
    values = {(s.kind, s.name): v for s, v in at.items()}
    return sum((c * prod(values[k, n] ** e for k, n, e in m) for m, c in form.items()), Fraction(0))


def test_a_normal_form_has_the_value_of_its_term() -> None:
    rng = Random(0)
    for _ in range(300):
        polynomial = random_polynomial(rng, 3)
        form = normal_form(polynomial)
        assert form is not None and all(form.values())
        at = {s: Fraction(rng.randint(-9, 9), 4) for s in SYMBOLS}
        assert value(form, at) == evaluate(polynomial, at, True)


@pytest.mark.parametrize("text", ["(x + y)**2 - x*x - 2*x*y - y**2", "x/3 - x/6 - x/6", "-(x - y) - y + x"])
def test_zero_has_no_coefficients(text: str) -> None:
    assert normal_form(term(text)) == {}


@pytest.mark.parametrize("text", ["sin(x)", "x / y", "x + abs(y)", "sqrt(x) * 2", "(x + y + z + w + 1)**12"])
def test_other_terms_have_no_normal_form(text: str) -> None:
    """Nor have polynomials of very many monomials."""
    assert normal_form(term(text)) is None


@pytest.mark.parametrize(
    ("difference", "rates", "kept"),
    [
        ("x*x + y*y - 1", {"x": "y", "y": "-x"}, True),
        ("x*x + y*y - 1", {"x": "y", "y": "-2*x"}, False),
        ("2*x*x + y*y - 1", {"x": "y", "y": "-2*x"}, True),
        ("x**2 * y - 3", {"x": "x*y", "y": "-2*y**2"}, True),
        ("x - y", {"x": "x + y", "y": "y + x"}, True),
        ("x - y", {"x": "sin(x)", "y": "sin(x)"}, True),
        ("x - y", {"x": "sin(x)", "y": "sin(y)"}, False),
        ("sin(x)", {"x": "0"}, True),
        ("w*w/2 - g/l*cos(x)", {"x": "w", "w": "-g/l*sin(x)"}, True),
        ("w*w/2 - g*cos(x)", {"x": "w", "w": "-g/l*sin(x)"}, False),
        (
            "(v*v + w*w)/2 - 1/sqrt(x*x + y*y)",
            {"x": "v", "y": "w", "v": "-x/sqrt(x*x + y*y)**3", "w": "-y/sqrt(x*x + y*y)**3"},
            True,
        ),
        (
            "(v*v + w*w)/2 - 2/sqrt(x*x + y*y)",
            {"x": "v", "y": "w", "v": "-x/sqrt(x*x + y*y)**3", "w": "-y/sqrt(x*x + y*y)**3"},
            False,
        ),
        ("y - exp(x)", {"x": "1", "y": "y"}, False),
        ("y/exp(x)", {"x": "1", "y": "y"}, True),
        ("tan(x) - y", {"x": "1", "y": "1 + tan(x)**2"}, True),
        ("arctan(x) - y", {"x": "z", "y": "z/(1 + x*x)"}, True),
        ("tanh(x) - y", {"x": "1", "y": "1 - tanh(x)**2"}, True),
        ("abs(x)", {"x": "1"}, False),
        ("x + (y - c)/r", {"x": "v*z/r", "y": "-v*z"}, True),
        ("x - 1", {"x": "y - y"}, True),
        ("x*x + y*y - 1", {"x": "-y*w", "y": "x*w", "w": "z/y"}, True),  # w' has no part in it
    ],
)
def test_an_invariant_has_no_derivative_along_the_flow(
    difference: str, rates: dict[str, str], kept: bool
) -> None:
    assert is_invariant(term(difference), {x: term(rate) for x, rate in rates.items()}) is kept


@pytest.mark.parametrize(
    ("difference", "rates", "stays"),
    [
        ("x*x + y*y - 1", {"x": "y", "y": "-x"}, True),
        ("x - y", {"x": "x", "y": "y"}, True),
        ("x - y", {"x": "x", "y": "2*y"}, False),
        ("x*x + y*y - 1", {"x": "-x + y + x*(1 - x*x - y*y)", "y": "-x - y + y*(1 - x*x - y*y)"}, False),
        ("x*x + y*y - 1", {"x": "y + x*(1 - x*x - y*y)", "y": "-x + y*(1 - x*x - y*y)"}, True),
        ("x*y - z", {"x": "x*z", "y": "y", "z": "z*z + x*y"}, True),
        ("x*y - z", {"x": "x*z", "y": "y", "z": "z*z + y"}, False),
        ("x", {"x": "x*sin(y)"}, True),
        ("y - exp(x)", {"x": "1", "y": "y"}, True),
        ("y/x - 1", {"x": "x*x", "y": "y*x"}, True),
        ("sqrt(x)", {"x": "1"}, False),
        ("sqrt(x)*y + sqrt(x)/y", {"x": "1", "y": "y"}, False),
        ("sqrt(x)", {"x": "x"}, False),  # not found out
        ("x - y", {"x": "x*sqrt(z)", "y": "y*sqrt(z)", "z": "1"}, True),
        ("x", {"x": "x*y + 1"}, False),
        ("3 - 3", {"x": "1"}, True),
    ],
)
def test_a_darboux_equality_stays_true(difference: str, rates: dict[str, str], stays: bool) -> None:
    assert is_darboux(term(difference), {x: term(rate) for x, rate in rates.items()}) is stays


def test_equalities_stay_true_together() -> None:
    """On a circle because the velocity is orthogonal to the radius, as long as that is known."""
    rates = {x: term(r) for x, r in {"x": "v*c", "y": "v*s", "c": "-s*v/r", "s": "c*v/r"}.items()}
    circle, known = term("x*x + y*y - r*r"), [term("c + y/r"), term("s - x/r")]
    assert is_darboux(circle, rates, known)
    assert not is_darboux(circle, rates, known[:1]) and not is_darboux(circle, rates)


def test_a_kept_equality_is_no_condition_along_the_flow() -> None:
    """But one that the flow does not keep is."""
    names = {name: Symbol(name, "variable") for name in "xyt"}
    ode = parse_program("{x' = y, y' = -x & x^2 + y^2 = 1 & x = y & x <= 2}")
    assert isinstance(ode, ODESystem)
    flow = lower_flow(ode, names, Options())
    assert isinstance(flow.domain, And) and isinstance(flow.watched, And)
    kept, *conditions = flow.domain.children
    assert flow.watched.children == tuple(conditions) and len(conditions) == 2
    assert len(flow.invariants) == 1 and kept not in flow.watched.children
