"""Modes, timers and jumps of switched systems, and the weights of modes."""

from fractions import Fraction
from math import exp

import pytest

from dl2c.parse import tree
from dl2c.parse.parser import parse_program
from dl2c.verify.stability.dwell import Weight, truncated, weights
from dl2c.verify.stability.switching import Jump, Mode, Switching, number, switching

BODY = """
  {?u = 1; {?s >= 3/2; s := 0; u := 2; ++ u := u;} ++ ?u = 2; {?!(s < 4); s := 0; u := 1; ++ u := u;}}
  {?u = 1; {x' = -x, s' = 1 & s <= 2} ++ ?u = 2; {x' = -x, s' = 1}}
"""


def found(body: str) -> Switching:
    system = switching(parse_program(body))
    assert system is not None
    return system


def test_modes_and_jumps() -> None:
    system = found(BODY)
    assert system.timer == "s"
    assert [m.longest for m in system.modes] == [2, None]
    assert [number(t.right) for m in system.modes for t in m.tests] == [1, 2]
    assert set(system.jumps) == {
        Jump(0, 1, Fraction(3, 2), True),
        Jump(0, 0, Fraction(0), False),
        Jump(1, 0, Fraction(4), True),
        Jump(1, 1, Fraction(0), False),
    }


def test_equal_equations_are_different_modes() -> None:
    system = found("?u = 1; {x' = -x, s' = 1} ++ ?u = 2; {x' = -x, s' = 1}")
    assert [number(m.tests[0].right) for m in system.modes] == [1, 2]


@pytest.mark.parametrize(
    ("body", "timer"),
    [
        ("{x' = 1} s := 0;", None),  # does not move
        ("{x' = 1, s' = 2} s := 0;", None),
        ("{x' = 1, s' = 1}", None),  # is never set to 0
        ("{s' = 1, r' = 1} s := 0; r := 0;", None),  # which of the two?
        ("{x' = 1, s' = 1} s := 0; {x' = 2}", None),
        ("{x' = 1, s' = 1} s := 0;", "s"),
    ],
)
def test_timers(body: str, timer: str | None) -> None:
    assert found(body).timer == timer


def test_a_run_that_sets_the_timer_to_something_else_is_no_jump() -> None:
    system = found("{{s := 0; ++ s := 1;} ?u = 1; {x' = -x, s' = 1}}")
    assert system.jumps == (Jump(0, 0, Fraction(0), True),)


def test_too_many_runs_and_loops_are_left() -> None:
    assert switching(parse_program("{x := 1; ++ x := 2;} " * 10 + "{x' = 1}")) is None
    assert switching(parse_program("{{x' = 1}}*")) is None


def mode(longest: Fraction | None = None) -> Mode:
    equation = tree.AtomicODE("x", tree.Number(Fraction(1)))
    return Mode(tree.ODESystem((equation,), tree.Truth(True)), (), longest)


def test_weights_keep_jumps_from_growing() -> None:
    """A mode that grows like exp(4*s) for 1/2 at most, and one that falls like exp(-2*s) for 2 at least."""
    jumps = (Jump(0, 1, Fraction(0), True), Jump(1, 0, Fraction(2), True))
    system = Switching((mode(Fraction(1, 2)), mode()), "s", jumps)
    ratios = {(0, 0): 1.0, (1, 1): 1.0, (0, 1): 1.5, (1, 0): 1.5}
    chosen = weights(system, (-4.0, 2.0), ratios)
    assert chosen is not None
    grows, falls = chosen
    assert 1.5 * falls.scale * falls.at(0.0) <= grows.scale * grows.least()
    assert 1.5 * grows.scale * grows.at(0.0) <= falls.scale * falls.least(2.0)
    for k in range(100):
        s, h = k / 200, 1e-6
        assert (grows.at(s + h) * exp(4 * h) - grows.at(s)) / h <= 1e-3  # w*V does not grow
        assert (falls.at(4 * s + h) * exp(-2 * h) - falls.at(4 * s)) / h <= 1e-3


def test_there_are_none_where_jumps_gain_more() -> None:
    jumps = (Jump(0, 1, Fraction(0), True), Jump(1, 0, Fraction(1, 4), True))
    system = Switching((mode(Fraction(1, 2)), mode()), "s", jumps)
    same = dict.fromkeys([(0, 0), (1, 1), (0, 1), (1, 0)], 1.0)
    assert weights(system, (-4.0, 2.0), same) is None
    assert weights(Switching((mode(), mode()), "s", jumps), (-4.0, 2.0), same) is None  # grows for ever


def test_weights_are_what_they_say() -> None:
    weight = Weight(Fraction(1, 2), Fraction(3), 4, Fraction(2))
    assert weight.at(0.5) == pytest.approx(truncated(4.5, 4))
    assert weight.least() == 1.0
    assert truncated(1.0, 12) == pytest.approx(exp(1))
