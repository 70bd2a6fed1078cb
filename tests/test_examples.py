"""The models that come with dl2c: other tools accept each of them, and it keeps its promise."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import dl2c
from dl2c.commands.describe import describe
from dl2c.env.actions import encoding
from dl2c.env.opening import manifest_of
from dl2c.env.registration import EXAMPLES
from dl2c.env.spaces import observation_space
from dl2c.native.binding import Batch
from dl2c.options import Options, UnknownOption
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import check_model
from dl2c.source import Source

FOLDER = Path(__file__).resolve().parent.parent / "examples"
NAMES = sorted(path.stem for path in FOLDER.glob("*.kyx"))
IDENTIFIERS = {model: f"dl2c/{name}-v0" for name, model in EXAMPLES.items()}
UNSAFE = {"forced_acceleration"}

POLYNOMIAL = ("exact", "its solution is a polynomial of time")
LINEAR = ("linear", "its equations are linear: power series to the last digit")
KERNELS = dict.fromkeys(NAMES, POLYNOMIAL) | {
    "dubins": LINEAR,
    "thermostat": LINEAR,
    "static_safety": ("cvodes", "dx' depends on itself, directly or through other variables"),
    "passive_safety": ("cvodes", "dx' depends on itself, directly or through other variables"),
    "pendulum": ("cvodes", "theta' depends on itself, directly or through other variables"),
}


def seeded(batch: Batch) -> Batch:
    batch.reset(seeds=np.arange(batch.n, dtype=np.uint64))
    return batch


def masked_step(batch: Batch, rng: np.random.Generator) -> None:
    """Choose uniformly among the enabled alternatives, and inputs uniformly within their limits."""
    start = 0
    for column, choice in enumerate(batch.library.manifest.choices):
        end = start + len(choice.alternatives)
        enabled = batch.mask[:, start:end]
        batch.choices[:, column] = (rng.random(enabled.shape) * enabled).argmax(axis=1)
        start = end
    for column, given in enumerate(batch.library.manifest.inputs):
        batch.inputs[:, column] = rng.uniform(given.low, given.high, batch.n)
    batch.step()


def test_every_example_has_an_identifier_and_a_paragraph() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert sorted(IDENTIFIERS) == NAMES
    for name, identifier in IDENTIFIERS.items():
        assert identifier in gym.registry
        assert f"`{name}.kyx`" in text and f"`{identifier}`" in text


@pytest.mark.parametrize("name", NAMES)
def test_models_are_readable_by_keymaera_x(name: str) -> None:
    """Comments `/* */` only, ASCII only, and nothing that dl2c warns of; bounds and units throughout."""
    text = (FOLDER / f"{name}.kyx").read_text(encoding="ascii")
    archive, warnings = parse_archive(Source(name, text))
    assert not warnings and len(archive.entries) == 1
    assert "//" not in text and text.startswith("/* ")
    assert text.count("bound=") == text.count("def=")


@pytest.mark.parametrize("name", NAMES)
def test_models_have_no_warnings(name: str) -> None:
    assert check_model(Source.read(FOLDER / f"{name}.kyx"), Options()) == ()


@pytest.mark.parametrize("name", NAMES)
def test_info_says_which_kernel_follows_a_flow_and_why(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = dl2c.build(f"example:{name}").library.manifest
    assert [(f.kernel, f.reason) for f in manifest.flows] == [KERNELS[name]]
    describe(manifest)
    lines = (line for line in capsys.readouterr().out.splitlines() if line.startswith(f"{name}.kyx:"))
    (_, ode, *columns), *events = (re.split("  +", line) for line in lines)
    assert ode.startswith("{") and tuple(columns) == KERNELS[name]
    assert [event[1] for event in events] == [condition for condition, _ in manifest.flows[0].events]
    assert all("certified" in how or how == "exact" for _, how in manifest.flows[0].events)


FORMATS = ["auto", "dict", "box", "discrete", "multidiscrete"]


def shown(space: gym.Space[Any]) -> str:
    """A space as Gymnasium writes it, but a Box by its size and type."""
    match space:
        case gym.spaces.Box():
            return f"Box({space.shape[0]}, {space.dtype})"
        case gym.spaces.Dict():
            return f"Dict({', '.join(f'{key!r}: {shown(part)}' for key, part in space.items())})"
        case _:
            return str(space)


@pytest.mark.parametrize("name", NAMES)
def test_info_shows_the_spaces_of_the_environment(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = manifest_of(f"example:{name}", {})
    for action_format in FORMATS:
        given = replace(manifest, options=manifest.options | {"action_format": action_format})
        try:
            actions = encoding(given).space()
        except UnknownOption as problem:
            assert action_format.endswith("discrete")
            with pytest.raises(UnknownOption, match=re.escape(str(problem))):
                describe(given)
            capsys.readouterr()
            continue
        describe(given)
        lines = capsys.readouterr().out.splitlines()
        assert lines[1] == f"observation space  {shown(observation_space(given))}"
        assert lines[2] == f"action space       {shown(actions)}"


@pytest.mark.parametrize("name", ["waypoint", "dubins"])
def test_info_says_that_a_kernel_was_asked_for(name: str) -> None:
    flows = dl2c.build(f"example:{name}", integrator="cvodes").library.manifest.flows
    assert [(f.kernel, f.reason) for f in flows] == [("cvodes", "integrator=cvodes was asked for")]


@pytest.mark.filterwarnings("ignore:.*normalized.*")
@pytest.mark.parametrize("name", NAMES)
def test_gymnasium_accepts_it(name: str) -> None:
    check_env(gym.make(f"dl2c:{IDENTIFIERS[name]}").unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", NAMES)
def test_stable_baselines_accepts_it(name: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    model = f"example:{name}"
    env: Any = dl2c.make(model)
    if isinstance(env.action_space, gym.spaces.Dict):
        env = dl2c.make(model, action_format="box")
    checker.check_env(env, warn=False)


@pytest.mark.parametrize("name", NAMES)
def test_safety_holds_in_every_run(name: str) -> None:
    batch = seeded(dl2c.build(f"example:{name}").library.batch(20, autoreset="same_step"))
    rng = np.random.default_rng(0)
    violations = 0
    for _ in range(100):
        masked_step(batch, rng)
        assert not batch.blocked.any()
        violations += int(batch.cost.sum())
    assert (violations > 0) == (name in UNSAFE)


def test_forced_acceleration_ends_when_predicted() -> None:
    """The flow is cut where the predicate fails; a tolerance would be part of that place."""
    env = dl2c.make("example:forced_acceleration", tolerance=0)
    action = env.action_space.sample()
    for seed in range(20):
        env.reset(seed=seed)
        s = env.state
        d, v, a, b = s["xo"] - s["x"], s["v"], s["A"], s["b"]
        predicted = (math.sqrt((b * v**2 + 2 * a * b * d) / (a + b)) - v) / a
        terminated, info = False, {"time": 0.0}
        while not terminated:
            _, _, terminated, _, info = env.step(action)
        assert (info["reason"], info["status"]) == ("isSafe", "failure")
        assert abs(info["time"] - predicted) <= 1e-9
