"""A model without annotations is an environment as it is; a default bound limits what nothing else does."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from generators.ir_builder import model
from hypothesis import given
from hypothesis import strategies as st

import dl2c
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.interval.bounded import bounded, closed
from dl2c.ir.model import Bound
from dl2c.options import Options, UnknownOption, with_options
from dl2c.pipeline import check_model
from dl2c.source import Source

BRAKING = """Theorem "brake"
Definitions Real A; Real B; Real m; End.
ProgramVariables Real x; Real v; Real a; Real t; End.
{above}
Problem
  A > 0 & B > 0 & v >= 0 & x + v^2 / (2 * B) <= m
    -> [{{ {{a := -B; ++ a := *; ?-B <= a & a <= A & v = 0;}} t := 0;
           {{x' = v, v' = a, t' = 1 & t <= 1 & v >= 0}} }}*] x <= m
End.
End.
"""
PLAIN = BRAKING.format(above="")

numbers = st.fractions(-100, 100)


def test_an_unannotated_model_works_with_a_default_bound() -> None:
    env = dl2c.make(PLAIN, default_bound="-10:10")
    space: Any = env.observation_space
    assert space.shape == (7,) and np.isinf(space.low[:4]).all() and np.isinf(space.high[:4]).all()
    env.action_space.seed(0)
    for seed in range(5):
        env.reset(seed=seed)
        start = env.state
        assert all(abs(value) <= 10 for name, value in start.items() if name != "t") and start["t"] == 0
        assert start["x"] + start["v"] ** 2 / (2 * start["B"]) <= start["m"]
        for _ in range(20):
            _, reward, terminated, truncated, info = env.step(env.action_space.sample())
            assert reward == -info["cost"]
            assert terminated == (info["cost"] == 1) == (info["status"] == "failure")
            if terminated or truncated:
                break


def test_the_postcondition_ends_an_unannotated_episode() -> None:
    env = dl2c.make(
        'Theorem "grow" ProgramVariables Real x; End. Problem x = 0 -> [{x := x + 1;}*] x <= 2 End. End.\n'
    )
    env.reset(seed=0)
    steps = [env.step(env.action_space.sample()) for _ in range(3)]
    assert [(reward, terminated) for _, reward, terminated, _, _ in steps] == [
        (0, False),
        (0, False),
        (-1, True),
    ]
    assert steps[-1][4]["reason"] == "postcondition"


@pytest.mark.parametrize(("text", "names"), [(PLAIN, ["a"]), (PLAIN.replace("a := *; ?", "?"), ["x", "m"])])
def test_without_a_default_bound_unlimited_names_are_errors(text: str, names: list[str]) -> None:
    with pytest.raises(CompileError) as refused:
        check_model(Source("m.kyx", text), Options())
    message = str(refused.value)
    assert all(f"`{name}" in message for name in names) and "--default-bound" in message


def test_the_options_of_an_episode_have_a_default_bound() -> None:
    check_model(Source("m.kyx", BRAKING.format(above="/* @episode: default_bound=[-10:10] */")), Options())
    with pytest.raises(CompileError, match="malformed bound"):
        check_model(Source("m.kyx", BRAKING.format(above="/* @episode: default_bound=10 */")), Options())


@pytest.mark.parametrize("value", ["-10:10", "[-10:10]", (-10, 10), ["-10", 10.0], " -1e1 : 10 "])
def test_a_default_bound_is_written_in_many_ways(value: Any) -> None:
    assert resolve_options({"default_bound": value}).default_bound == (-10, 10)


@pytest.mark.parametrize("value", ["10", "1:1", "2:1", "a:b", "1:2:3", 5, ("1",), "inf:3"])
def test_a_wrong_default_bound_is_refused(value: Any) -> None:
    with pytest.raises(UnknownOption, match="default_bound"):
        with_options(Options(), {"default_bound": value})


@given(st.none() | numbers, st.none() | numbers, numbers, st.fractions(Fraction(1, 10), 100))
def test_closed_keeps_given_ends_and_is_never_empty(low: Any, high: Any, start: Any, width: Any) -> None:
    if low is not None and high is not None and low >= high:
        low = None
    found = closed(low, high, (start, start + width))
    assert found[0] < found[1]
    assert low in (None, found[0]) and high in (None, found[1])


def test_only_open_sides_are_closed() -> None:
    given_model = model(
        "x >= 20 and y > x and z*z <= 4", {"x": ":", "y": ":", "z": ":", "w": "5:"}, {"c": ":"}
    )
    found = bounded(given_model, (Fraction(-10), Fraction(10)))
    bounds = {i.name: i.bound for i in (*found.variables, *found.constants)}
    assert bounds["x"] == Bound(None, Fraction(40)) and bounds["w"] == Bound(Fraction(5), Fraction(10))
    assert bounds["z"] == Bound(None, None) and bounds["c"] == Bound(Fraction(-10), Fraction(10))
    assert bounds["y"].low is None and bounds["y"].high is not None and math.isfinite(bounds["y"].high)
