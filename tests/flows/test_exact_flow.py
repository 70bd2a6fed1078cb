"""The exact kernel: closed forms, boundaries and the traps of event location."""

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dl2c.flows.exact import ExactPlan, Motion, NotExact, advance, exit_time, plan
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.interp.follow import follow
from dl2c.ir.evaluate import truth
from dl2c.ir.model import Flow, Symbol
from dl2c.lower.flow import lower_flow
from dl2c.options import Options
from dl2c.parse.parser import parse_program
from dl2c.parse.tree import ODESystem

NAMES = {n: Symbol(n, "variable") for n in ("x", "v", "a", "t", "T", "w")} | {
    n: Symbol(n, "constant") for n in ("ep", "b", "m")
}


def flow_of(text: str, **options: Any) -> Flow:
    ode = parse_program(text)
    assert isinstance(ode, ODESystem)
    return lower_flow(ode, NAMES, Options(**options))


def plan_of(text: str, **options: Any) -> ExactPlan:
    found = plan(flow_of(text, **options))
    assert isinstance(found, ExactPlan), found
    return found


def environment(**values: Any) -> dict[Symbol, Any]:
    return {NAMES[n]: v for n, v in ({"ep": 0.3, "b": 2.0, "m": 7.0, "T": 5.0, "w": 1.0} | values).items()}


def advanced(flow: ExactPlan, start: dict[Symbol, Any], exact: bool = False) -> Motion:
    motion = advance(flow, start, exact)
    assert motion is not None
    return motion


def followed(flow: Flow, start: dict[Symbol, Any]) -> Motion:
    found = plan_flow(flow, [])
    assert isinstance(found, FlowPlan)
    return follow(found, start)


CAR = "{x' = v, v' = a, t' = 1 & v >= 0 & t <= ep}"


def test_braking_at_rest_takes_no_time_and_keeps_the_velocity() -> None:
    motion = advanced(plan_of(CAR), environment(x=1.0, v=0.0, a=-2.0, t=0.0))
    assert (motion.duration, motion.values) == (0.0, {})


def test_coasting_at_rest_takes_the_whole_period() -> None:
    motion = advanced(plan_of(CAR), environment(x=1.0, v=0.0, a=0.0, t=0.0))
    assert motion.duration == 0.3
    assert motion.values == {"x": 1.0, "v": 0.0, "t": 0.3}


def test_stopping_sets_the_velocity_to_exactly_zero() -> None:
    for v in (0.1, 0.3, 0.55, 1e-9, 0.59999):
        motion = advanced(plan_of(CAR), environment(x=1.0, v=v, a=-2.0, t=0.0))
        assert motion.values["v"] == 0.0
        assert motion.duration == v / 2.0


def test_the_clock_ends_at_exactly_its_bound() -> None:
    motion = advanced(plan_of(CAR), environment(x=0.0, v=1.0, a=1.0, t=0.1))
    assert motion.values["t"] == 0.3
    assert motion.duration == 0.3 - 0.1


def test_a_tie_of_clock_and_boundary_settles_both() -> None:
    motion = advanced(plan_of(CAR), environment(x=0.0, v=0.5, a=-1.0, t=0.0, ep=0.5))
    assert (motion.values["t"], motion.values["v"], motion.duration) == (0.5, 0.0, 0.5)


def test_a_start_on_the_boundary_pointing_in_moves_on() -> None:
    motion = advanced(plan_of(CAR), environment(x=0.0, v=0.0, a=1.0, t=0.0))
    assert motion.duration == 0.3
    assert motion.values["v"] == 0.3


def test_a_strict_boundary_is_approached_but_not_met() -> None:
    motion = advanced(plan_of("{x' = v & x < m}", dt=Fraction(5)), environment(x=6.0, v=1.0, a=0.0, t=0.0))
    assert motion.values["x"] < 7.0
    assert motion.values["x"] == pytest.approx(7.0, abs=1e-12)


def test_a_flow_stops_before_a_point_it_must_avoid() -> None:
    for x, v in ((6.0, 1.0), (8.0, -1.0)):
        motion = advanced(plan_of("{x' = v & x != m}", dt=Fraction(5)), environment(x=x, v=v, a=0.0, t=0.0))
        assert motion.values["x"] != 7.0
        assert motion.values["x"] == pytest.approx(7.0, abs=1e-12)


def test_an_equality_that_motion_breaks_takes_no_time() -> None:
    motion = advanced(plan_of("{x' = v & x = m}", dt=Fraction(5)), environment(x=7.0, v=1.0, a=0.0, t=0.0))
    assert motion.duration == 0.0


def test_an_equality_that_motion_keeps_does_not_end_the_flow() -> None:
    motion = advanced(plan_of("{x' = v & w = 1}", dt=Fraction(5)), environment(x=7.0, v=1.0, a=0.0, t=0.0))
    assert motion.duration == 5.0


def test_grazing_contact_does_not_end_a_closed_domain_but_an_open_one() -> None:
    # x(tau) = (tau - 1)^2 touches 0 at 1.
    start = environment(x=1.0, v=-2.0, a=2.0, t=0.0)
    closed, opened = (flow_of(f"{{x' = v, v' = a & x {op} 0}}", dt=Fraction(3)) for op in (">=", ">"))
    for flow in (closed, opened):
        straight = plan(flow)
        assert isinstance(straight, ExactPlan) and advance(straight, start) is None, "rounding may decide"
    closed, opened = (followed(flow, start) for flow in (closed, opened))
    assert closed.duration == 3.0
    assert opened.duration == pytest.approx(1.0, abs=1e-7)
    assert opened.values["x"] > 0


def test_an_excursion_inside_one_period_is_not_missed() -> None:
    # x(tau) = tau^2 - 3 tau + 2 is negative on (1, 2) only.
    motion = advanced(
        plan_of("{x' = v, v' = a & x >= 0}", dt=Fraction(10)), environment(x=2.0, v=-3.0, a=2.0, t=0.0)
    )
    assert motion.duration == 1.0
    assert motion.values["x"] == 0.0


def test_without_a_clock_a_flow_lasts_dt() -> None:
    assert advanced(plan_of("{x' = v}"), environment(x=0.0, v=1.0, a=0.0, t=0.0)).duration == 0.1
    assert plan_of(CAR).flow.cap is None


@pytest.mark.parametrize(
    "text",
    [
        "{x' = x}",
        "{x' = v, v' = -x}",
        "{x' = v & x >= 0 | v >= 0}",
        "{x' = v^2 * t, v' = t, t' = 1 & x >= 0}",
    ],
)
def test_what_is_not_polynomial_of_degree_two_is_refused(text: str) -> None:
    assert isinstance(plan(flow_of(text)), NotExact)


numbers = st.integers(-40, 40).map(lambda k: Fraction(k, 8))


@given(
    c0=st.integers(0, 40).map(lambda k: Fraction(k, 8)),
    c1=numbers,
    c2=numbers,
    kind=st.sampled_from(["closed", "open"]),
)
def test_exit_time_is_the_first_time_outside(c0: Fraction, c1: Fraction, c2: Fraction, kind: str) -> None:
    if kind == "open" and c0 == 0:
        return
    leave = exit_time(kind, c0, c1, c2)

    def margin(tau: Fraction) -> Fraction:
        return c0 + c1 * tau + c2 * tau * tau

    horizon = Fraction(64) if leave is None else Fraction(leave)
    for k in range(64):
        inside = margin(horizon * k / 64)
        assert inside >= 0 if kind == "closed" else inside > 0 or k == 0
    if leave is not None:
        after = margin(horizon + Fraction(1, 10**6))
        touched = abs(margin(horizon)) < Fraction(1, 10**20)
        assert touched and (after < 0 or kind == "open")


@given(x=st.floats(-5, 5), v=st.floats(0, 5), a=st.floats(-5, 5), ep=st.floats(0.01, 2), m=st.floats(-6, 6))
def test_no_state_after_a_flow_violates_its_domain(x: float, v: float, a: float, ep: float, m: float) -> None:
    flow = flow_of("{x' = v, v' = a, t' = 1 & v >= 0 & x + v <= m & x != 0 & t <= ep}")
    start = environment(x=x, v=v, a=a, t=0.0, ep=ep, m=m)
    if not truth(flow.domain, start):
        return
    motion = followed(flow, start)
    after = start | {NAMES[n]: value for n, value in motion.values.items()}
    assert truth(flow.domain, after)
    assert 0 <= motion.duration <= ep


@given(x=numbers, v=st.integers(0, 40).map(lambda k: Fraction(k, 8)), a=numbers)
def test_doubles_and_rationals_agree(x: Fraction, v: Fraction, a: Fraction) -> None:
    flow = plan_of(CAR)
    exact = advanced(flow, environment(x=x, v=v, a=a, t=Fraction(0), ep=Fraction(3, 8)), True)
    rounded = advanced(flow, environment(x=float(x), v=float(v), a=float(a), t=0.0, ep=0.375))
    assert float(exact.duration) == pytest.approx(rounded.duration, abs=1e-12)
    for name, value in exact.values.items():
        assert float(value) == pytest.approx(rounded.values[name], abs=1e-12)
