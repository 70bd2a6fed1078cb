"""Events of published problems, in models as a user writes them, by every kernel that can follow them."""

from typing import Any

import pytest
from both_forms import quick_builds
from generators.kyx_builder import model_text

import dl2c
from dl2c.env.single import Dl2cEnv

REACTION = "x' = -0.04*x + 10000*y*z, y' = 0.04*x - 10000*y*z - 30000000*y^2, z' = 30000000*y^2"


def declared(**limits: int) -> str:
    """Variables that begin between 0 and these."""
    return "\n".join(f"/* @var: bound=[-1:{limit}] */ Real {name};" for name, limit in limits.items())


ROBERTSON = model_text(
    f"""x = 1 & y = 0 & z = 0 & n = 0 -> [{{
      if (n = 0) {{ {{{REACTION} & z <= 1/100}} }} else {{ {{{REACTION} & x >= 1/10000}} }}
      n := n + 1;
    }}*] x + y + z <= 2""",
    variables=declared(x=1, y=1, z=1, n=9),
)
"""A chemical reaction whose rates differ by nine orders of magnitude; SUNDIALS' cvRoberts."""

ROCKET = model_text(
    """h = 0 & v = 0 & fuel = 1 -> [{
      if (h < 4000) { {h' = v, v' = 2200/(10 + fuel) - 3/10*v - 32, fuel' = -1/10 & h <= 4000 & fuel >= 0} }
      else { {h' = v, v' = -3/10*v - 32 & v >= 0} }
    }*] h >= 0""",
    variables=declared(h=9999, v=9999, fuel=1),
)
"""Its engine is cut off at a height of 4000, then it rises to its apex; SUNDIALS' cvRocket."""

BALL = model_text(
    "h = 1 & v = 0 -> [{ {h' = v, v' = -9.81 & h >= 0} v := -0.7 * v; }*] h >= 0",
    variables=declared(h=9, v=9),
)
"""Every bounce keeps 0.7 of the speed; the BouncingBall of the Reference FMUs."""

BOUNCES = (0.4515236409857309, 1.0836567383657542, 1.5261499065317705)
ZENO = 2.5586339655858085


def begun(text: str, **options: Any) -> Dl2cEnv:
    """The first state of a model with one."""
    with quick_builds():
        env = dl2c.make(text, **options)
    env.reset(seed=0)
    return env


def kernels(env: Dl2cEnv) -> list[str]:
    return [f.kernel for f in env.manifest.flows]


@pytest.mark.parametrize("stiff", ["auto", "true"])
def test_robertson_passes_its_published_roots(stiff: str) -> None:
    env = begun(ROBERTSON, dt=4 * 10**10, stiff=stiff)
    assert kernels(env) == ["cvodes", "cvodes"]
    *_, info = env.step(0)
    assert info["duration"] == pytest.approx(0.264019078188, rel=1e-8)
    assert env.state["z"] == 0.01
    assert env.state["x"] == pytest.approx(0.989965, rel=1e-4)
    *_, info = env.step(0)
    assert info["time"] == pytest.approx(2.07954968830e7, rel=1e-6)
    assert env.state["x"] == 0.0001
    assert sum(env.state[v] for v in "xyz") == pytest.approx(1, abs=1e-9)


def test_a_rocket_is_cut_off_and_turns_where_sundials_says() -> None:
    env = begun(ROCKET, dt=100)
    assert kernels(env) == ["cvodes", "linear"]
    *_, info = env.step(0)
    assert info["duration"] == pytest.approx(9.999726468544715, abs=1e-9)
    assert env.state["h"] == 4000
    *_, info = env.step(0)
    assert info["time"] == pytest.approx(16.19115643193773, abs=1e-8)
    assert env.state["v"] == 0
    *_, info = env.step(0)
    assert info["duration"] == 0


@pytest.mark.parametrize(("kernel", "accuracy"), [("exact", 1e-12), ("cvodes", 1e-5)])
def test_a_ball_bounces_when_the_reference_says_until_its_time_stands_still(
    kernel: str, accuracy: float
) -> None:
    """Flights lower than the solver's absolute tolerance are not resolved: the last microseconds."""
    env = begun(BALL, dt=9, integrator=kernel, stall_limit=3, max_episode_steps=300)
    assert kernels(env) == [kernel]
    times, info, over = [0.0], {}, False
    while not over:
        _, _, terminated, over, info = env.step(0)
        assert not terminated and env.state["h"] == 0
        times.append(info["time"])
    assert info["reason"] == "stalled"
    assert times[1:4] == pytest.approx(BOUNCES, abs=1e-9)
    assert times[-1] == pytest.approx(ZENO, abs=accuracy)
    assert times == sorted(times)
    assert times[-5] < times[-4] == times[-1]
