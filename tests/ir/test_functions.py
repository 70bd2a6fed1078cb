"""The table of functions agrees with itself and with those who implement its rows."""

import math

import numpy as np
import pytest

from dl2c.flows import hull, taylor
from dl2c.ir.evaluate import evaluate
from dl2c.ir.functions import DEFINED, FUNCTIONS, KYX_MATH
from dl2c.ir.logic import subterms
from dl2c.ir.model import Call, Symbol
from dl2c.parse import tree
from dl2c.parse.parser import parse_term
from dl2c.symbolic.terms import casadi

X = Symbol("x", "variable")
PLACES = (0.125, 0.375, 0.75)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_is_computed_and_enclosed(name: str) -> None:
    row = FUNCTIONS[name]
    args = PLACES[: row.arity]
    assert math.isclose(row.value(*args), float(row.array(*map(np.asarray, args))), rel_tol=1e-15)
    assert math.isclose(row.value(*args), float(getattr(casadi, row.casadi)(*args)), rel_tol=1e-15)
    low, high = hull.FUNCTIONS[name](*((a, a) for a in args))
    assert low <= row.value(*args) <= high
    assert name in taylor.FUNCTIONS


@pytest.mark.parametrize("name", [n for n, row in FUNCTIONS.items() if row.slope is not None])
def test_slopes_are_derivatives(name: str) -> None:
    row = FUNCTIONS[name]
    assert row.slope is not None
    for x in PLACES:
        slope = float(evaluate(row.slope(Call(name, (X,)), X), {X: x}))
        step = 1e-6
        assert math.isclose(slope, (row.value(x + step) - row.value(x - step)) / (2 * step), rel_tol=1e-6)


@pytest.mark.parametrize("name", [n for n, row in FUNCTIONS.items() if row.rising and not row.has_poles])
def test_rising_functions_rise_between_their_limits(name: str) -> None:
    row = FUNCTIONS[name]
    values = [row.value(x) for x in (-0.9, -0.3, 0.0, 0.3, 0.9)]
    assert values == sorted(values)
    assert row.between[0] <= values[0] and values[-1] <= row.between[1]


@pytest.mark.parametrize("name", DEFINED)
def test_other_functions_are_terms_of_their_parameters(name: str) -> None:
    parameters, text = DEFINED[name]
    assert KYX_MATH[name] == len(parameters)
    assert isinstance(parse_term(text), tree.Term)


def test_domains_are_about_the_arguments() -> None:
    for row in FUNCTIONS.values():
        conditions = () if row.domain is None else row.domain(*[X] * row.arity)
        assert all(X in subterms(c) for c in conditions)
