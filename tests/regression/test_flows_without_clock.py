"""Flows without a clock in problems without a loop: they last to the end of their domain."""

import warnings
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from both_forms import Both, quick_builds, theorem
from generators.kyx_builder import lowered, model_text

import dl2c
from dl2c.configuration import resolve_options
from dl2c.options import Options, UnknownOption, with_options
from dl2c.pipeline import emit
from dl2c.report.falsify import falsify
from dl2c.source import Source

FALLS = model_text("x = 5 -> [{x' = -1 & x >= 0} ?x = 0;] x = 0", variables="Real x;")
"""No run but the one that lasts five seconds."""


@pytest.fixture(autouse=True)
def quick() -> Any:
    with quick_builds(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def once(motion: str, assumed: str, names: str = "x", **options: Any) -> Any:
    """The end of the only step of a problem without a loop: its state, duration and reason."""
    declared = "".join(f"Real {n}; " for n in names.split())
    env = dl2c.make(model_text(f"{assumed} -> [{motion}] true", variables=declared), **options)
    env.reset(seed=0)
    *_, info = env.step(0)
    return env.state, info["duration"], info["reason"]


def test_a_flow_without_clock_or_loop_lasts_to_the_end_of_its_domain() -> None:
    seen = Both(FALLS).first(x=5)
    assert (seen.state["x"], seen.duration, seen.cost) == (0, 5, 0)
    assert seen.ending == ("terminated", "none", "end") and seen.postcondition
    assert falsify(FALLS, episodes=20, n_envs=10).episode is None


@pytest.mark.parametrize(
    ("equations", "domain", "state", "duration"),
    [
        ("x' = -1", "x >= 0", {"x": 5}, 5),  # straight-line code
        ("x' = -1", "x > 0", {"x": 5}, 5),
        ("x' = -1", "x >= -2000", {"x": 5}, 0.1),  # not met in time
        ("x' = -1", "x >= -995", {"x": 5}, 1000),  # just in time
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 4, "a": -2}, 2),
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 4, "a": 2}, 0.1),
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 0, "a": -2}, 0),
        ("x' = v, v' = a", "v >= 0 & x <= 3", {"x": 0, "v": 4, "a": -2}, 1),
        ("x' = v, v' = a", "x^2 <= 100 | v <= -9", {"x": 0, "v": 0, "a": 2}, 10**0.5),  # roots isolated
        ("x' = v, v' = a", "x^2 <= 100 | v <= -9", {"x": 0, "v": 0, "a": 0}, 0.1),
        ("x' = v, v' = a", "x^3 <= 64 & v >= -1", {"x": 0, "v": 2, "a": 0}, 2),
        ("x' = -1", "v >= 0", {"x": 5, "v": 1}, 0.1),  # nothing moves it
        ("x' = 10^98, v' = -1", "v >= 0", {"x": 0, "v": 200}, 0.1),  # x gets too large before
    ],
)
def test_when_polynomial_flows_without_a_clock_end(
    equations: str, domain: str, state: dict[str, float], duration: float
) -> None:
    text = (
        theorem("", f"{{{equations} & {domain}}}").replace("}*]", "}]").replace("[-100:100]", "[-9999:9999]")
    )
    seen = Both(text).first(**state)
    assert seen.duration == pytest.approx(duration, abs=1e-12)


@pytest.mark.parametrize("integrator", ["auto", "cvodes", "dopri5"])
@pytest.mark.parametrize(
    ("equations", "domain", "start", "duration"),
    [
        ("x' = -x", "x >= 1", "x = 5", 1.6094379124341003),
        ("x' = -x", "x >= -1", "x = 5", 0.1),
        ("x' = -x * x", "x >= 1/100", "x = 1", 99),
        ("x' = x * x", "x >= -1", "x = 1", 0.1),  # no solution beyond one second
    ],
)
def test_when_other_flows_without_a_clock_end(
    integrator: str, equations: str, domain: str, start: str, duration: float
) -> None:
    state, lasted, reason = once(f"{{{equations} & {domain}}}", start, integrator=integrator)
    assert (lasted, reason) == (pytest.approx(duration, rel=1e-6), "end")
    assert duration == 0.1 or state["x"] == (1 if "x >= 1" in domain and "/" not in domain else 0.01)


@pytest.mark.slow
def test_a_dt_is_a_cap_and_max_flow_the_patience() -> None:
    motion, start = "{x' = -1 & x >= 0}", "x = 5"
    assert once(motion, start)[1] == 5
    assert once(motion, start, dt=2)[1] == 2
    assert once(motion, start, max_flow=4)[1] == pytest.approx(0.1)
    assert once(motion, start, max_flow=5)[1] == 5
    assert once(motion, "x = 1/20", max_flow="0.01")[1] == 0.05, "it ends with its domain even so"
    assert once("{x' = -1}", start)[1] == pytest.approx(0.1)
    with pytest.raises(UnknownOption, match="must be positive"):
        with_options(Options(), {"max_flow": 0})
    looped = lowered("x = 5 -> [{ {x' = -1 & x >= 0} }*] true", variables="Real x;")
    assert [(f.cap, f.reach) for f in looped.flows] == [(Fraction(1, 10), None)]


@pytest.mark.parametrize("integrator", ["auto", "dopri5"])
def test_watches_count_on_the_motion_that_is_taken(integrator: str) -> None:
    """x leaves 3 on the way to an end that is out of reach."""
    low = "/* @safety: on_failure=terminate:failure */ Bool low(Real x) <-> x <= 3;"
    for domain, cost, duration in (("x <= 9", 1, 1), ("x <= 99999", 0, 0.1)):
        text = model_text(f"x = 0 -> [{{x' = 3 & {domain}}}] low(x)", low, "Real x;")
        env = dl2c.make(text, integrator=integrator)
        env.reset(seed=0)
        *_, info = env.step(0)
        assert (info["cost"], info["duration"]) == (cost, pytest.approx(duration, abs=1e-6))


@pytest.mark.parametrize("integrator", ["auto", "dopri5"])
def test_lanes_follow_flows_without_a_clock_alike(integrator: str) -> None:
    text = model_text("0 <= x & x <= 2000 -> [{x' = -1 & x >= 0}] true", variables="Real x;")
    envs = dl2c.make_vec(text, 70, integrator=integrator)
    envs.reset(seed=3)
    *_, infos = envs.step(np.zeros(70, np.int64))
    for k in range(0, 70, 9):
        env = dl2c.make(text, integrator=integrator)
        env.reset(seed=3 + k)
        *_, info = env.step(0)
        assert info["duration"] == infos["duration"][k]
    assert {True, False} == set((infos["duration"] > 0.2).tolist())


def test_an_export_in_plain_python_says_that_it_cannot() -> None:
    with pytest.raises(dl2c.CompileError, match="plain Python"):
        emit(Source("falls.kyx", FALLS), "gym", resolve_options({}), True)
