"""Linear flows that need too many power series, and flows that end in a singularity."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import shared

import dl2c
from dl2c.configuration import resolve_options
from dl2c.pipeline import emit
from dl2c.source import Source

pytestmark = pytest.mark.usefixtures("unoptimised")

STIFF = "x'=-1000000*(x-y), y'=-y"
FAST = "x'=-100000*y, y'=100000*x"


def text_of(ode: str, post: str = "true", start: str = "x=2&y=1", definitions: str = "") -> str:
    names = ["x", "y", "t"] if "y'" in ode else ["x", "t"]
    declared = " ".join(f"Real {name};" for name in names)
    return (
        f'Theorem "m" Definitions\n{definitions}\nEnd.\nProgramVariables {declared} End.\n'
        f"Problem {start}&t=0 -> [{{t := 0; {{{ode}, t'=1 & t<=1}} }}*] ({post}) End. End.\n"
    )


def stepped(text: str, **options: Any) -> tuple[dict[str, float], dict[str, Any]]:
    env: Any = dl2c.make(text, **options)
    env.reset(seed=0)
    info = env.step(0)[4]
    return env.state, info


# Stiff linear flows ------------------------------------------------------------


@pytest.mark.parametrize("rate", [1000000, 20000, 50])
def test_stiff_linear_flows_are_followed(rate: int) -> None:
    state, info = stepped(text_of(f"x'=-{rate}*(x-y), y'=-y"))
    right = rate / (rate - 1) * math.exp(-1) + (1 - 1 / (rate - 1)) * math.exp(-rate)
    assert (info["reason"], info["duration"]) == ("", 1)
    assert state["x"] == pytest.approx(right, rel=1e-8)
    assert state["y"] == pytest.approx(math.exp(-1), rel=1e-8)


def test_fast_oscillations_are_followed_by_many_series() -> None:
    state, info = stepped(text_of(FAST, start="x=1&y=0"))
    assert info["reason"] == ""
    assert state["x"] == pytest.approx(math.cos(1e5), abs=1e-9)
    assert state["y"] == pytest.approx(math.sin(1e5), abs=1e-9)


def test_what_is_watched_begins_anew_with_the_flow() -> None:
    """Safety ends the flow at y = 1/2; what is violated on the way alone is remembered."""
    ends = "/* @safety: penalty=-1, on_failure=terminate:failure */ Bool upper(Real y) <-> y >= 1/2;\n"
    seen = "/* @safety: penalty=-8, on_failure=continue:failure */ Bool lower(Real x) <-> x <= 3/2;"
    post = "upper(y) & lower(x)"
    state, info = stepped(text_of(STIFF, post, definitions=ends + seen))
    assert info["duration"] == pytest.approx(math.log(2), abs=1e-8)
    assert state["y"] == pytest.approx(0.5, abs=1e-8)
    assert (info["reason"], info["cost"]) == ("upper", 2)


def test_environments_of_a_batch_agree_whoever_follows_them() -> None:
    text = text_of(STIFF, start="0<=x&x<=2&y=1")
    single: Any = dl2c.make(text, default_bound="-10:10")
    for num_threads in (1, 2):
        many: Any = dl2c.make_vec(text, 70, default_bound="-10:10", num_threads=num_threads)
        many.reset(seed=5)
        observations = many.step(np.zeros(70, dtype=np.int64))[0]
        for k in (0, 69):
            single.reset(seed=5 + k)
            assert np.array_equal(single.step(0)[0], observations[k])


def test_a_mild_flow_has_no_solver_and_says_so() -> None:
    for ode, stiff in ((STIFF, True), ("x'=-y, y'=x", False)):
        env: Any = dl2c.make(text_of(ode))
        (flow,) = env.manifest.flows
        assert flow.kernel == "linear"
        assert flow.reason.endswith(", CVODES where stiff") == stiff
        made = emit(Source("m.kyx", text_of(ode)), "c", resolve_options({}))
        assert ("#define DL2C_SPARE_SOLVER 1" in made) == stiff


# Singularities -----------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
@pytest.mark.parametrize(
    ("ode", "post"),
    [("x'=x^2", "x <= 10^11"), ("x'=x^3", "x <= 10^9"), ("x'=x^2+1", "x >= -1"), ("x'=x^2", "true")],
)
def test_a_state_near_a_singularity_is_not_judged(ode: str, post: str, integrator: str) -> None:
    """1/(1/10 - t) is 10^11 a hundred thousandth of the tolerance before t = 1/10."""
    state, info = stepped(text_of(ode, post, "x=10"), integrator=integrator)
    assert (info["reason"], info["status"], info["duration"]) == ("solver", "none", 0)
    assert state["x"] == 10


@pytest.mark.parametrize("integrator", ["cvodes", "dopri5"])
def test_growth_alone_is_no_singularity(integrator: str) -> None:
    state, info = stepped(text_of("x'=25*x", "x <= 10^11", "x=1"), integrator=integrator)
    assert (info["reason"], state["x"]) == ("", pytest.approx(math.exp(25), rel=1e-6))
    state, info = stepped(text_of("x'=x^2", "x <= 10^6", "x=10"), integrator=integrator)
    assert info["reason"] == "postcondition", "there the time is known well enough"


def test_lanes_agree_on_a_singularity() -> None:
    text = text_of("x'=x^2", "x <= 10^11", "x=10 | x=1/2")
    many: Any = dl2c.make_vec(text, 64, default_bound="-10:10", integrator="dopri5")
    single: Any = dl2c.make(text, default_bound="-10:10", integrator="dopri5")
    many.reset(seed=1)
    observations, _, _, truncated, _ = many.step(np.zeros(64, dtype=np.int64))
    for k in range(8):
        single.reset(seed=1 + k)
        observation, _, _, cut, _ = single.step(0)
        assert cut == truncated[k]
        assert cut or np.array_equal(observation, observations[k])


@pytest.mark.slow
def test_published_blow_up_is_not_judged() -> None:
    path = shared("corpus") / "LS-Lab__KeYmaeraX-projects" / "lfcps" / "lfcps.kyx"
    entry = "LFCPS Textbook/10: Motzkin polynomial invariant"
    env: Any = dl2c.make(path, entry=entry, default_bound="-10:10")
    for seed in range(30):
        env.reset(seed=seed)
        assert env.step(0)[4]["reason"] in ("solver", "numerical", "end")


# Observations of large states --------------------------------------------------

LARGE = (
    'Theorem "m" ProgramVariables Real x; Real t; End.\n'
    "Problem x>=0 -> [{x := x*10; t := 0;}*] x >= 0 End. End.\n"
)


@pytest.mark.parametrize("bounds", ["declared", "unbounded"])
def test_large_states_saturate_at_the_largest_float(bounds: str) -> None:
    largest = np.finfo(np.float32).max
    env: Any = dl2c.make(LARGE, default_bound="0:1", observation_bounds=bounds)
    for start, shown, saturated in ((1e36, 1e37, False), (1e38, largest, True), (1e98, largest, True)):
        env.reset(options={"state": {"x": start, "t": 0.0}})
        observation, _, _, _, info = env.step(0)
        assert observation.dtype == np.float32 and np.isfinite(observation).all()
        assert observation[0] == np.float32(shown)
        assert info["saturated"] is saturated
        assert env.state["x"] == start * 10
