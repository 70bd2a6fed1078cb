"""`monitor_every_step`: the simulator judges its own steps by the monitor that is exported, in the same C."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY
from selection import quick_among

import dl2c
from dl2c.commands.monitor import unit_of
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.emit.monitor.files import monitor_files
from dl2c.native.errors import MonitorViolated
from dl2c.pipeline import emit
from dl2c.source import Source
from dl2c.training.evaluation import flat_environments
from dl2c.training.policies import policy_of

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
QUICK = ("bouncing_ball", "passive_safety", "watertank", "waypoint")
ENVIRONMENTS = 8


def run(example: str, steps: int) -> None:
    """So many steps of the random policy, half of it without masks, in a few environments."""
    envs = flat_environments(f"example:{example}", ENVIRONMENTS, monitor_every_step=True)
    for masked in (True, False):
        act = policy_of("random", envs._encoding, masked, 3)  # pyright: ignore[reportPrivateUsage]
        observations, _ = envs.reset(seed=11 + masked)
        for _ in range(steps // ENVIRONMENTS // 2):
            observations, *_ = envs.step(act(observations, envs.action_masks()))
    envs.close()


@pytest.mark.parametrize("example", quick_among(EXAMPLES, QUICK))
def test_every_step_satisfies_the_exported_monitor(example: str) -> None:
    run(example, 2000)


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_a_hundred_thousand_steps_satisfy_the_exported_monitor(example: str) -> None:
    run(example, 100_000)


@pytest.mark.parametrize("example", EXAMPLES)
def test_simulator_and_target_compile_one_text(example: str) -> None:
    built = dl2c.build(f"example:{example}", monitor_every_step=True)
    unit = unit_of(f"example:{example}", {})
    for name, text in monitor_files(unit).items():
        if name not in ("main.c", "README.md", "conditions.json"):
            assert (built.directory / name).read_text(encoding="utf-8") == text


IN_LANES = ("acc", "bouncing_ball", "forced_acceleration", "static_safety_line", "watertank", "waypoint")
"""Whose steps are made in lanes, unless they are judged."""

NOT_IN_LANES = ("static_safety", "thermostat")


@pytest.mark.parametrize("action_map", ["project", "squash"])
@pytest.mark.parametrize("on_blocked", ["fallback", "truncate"])
@pytest.mark.parametrize("example", quick_among((*IN_LANES, *NOT_IN_LANES), ("thermostat", "waypoint")))
def test_steps_are_the_same_with_and_without_a_monitor(
    example: str, on_blocked: str, action_map: str
) -> None:
    """Bit for bit, where the steps of one of them are made in lanes: every result, of any request."""
    model = REPOSITORY / "examples" / f"{example}.kyx"
    header = emit(Source.read(model), "c", resolve_options({}))
    assert ("DL2C_STEPS_IN_LANES = 1" in " ".join(header.split())) == (example in IN_LANES)
    seen: list[list[bytes]] = []
    for monitored in (True, False):
        library = dl2c.build(model, monitor_every_step=monitored).library
        batch = library.batch(70, autoreset="same_step", on_blocked=on_blocked, action_map=action_map)
        batch.reset(seeds=np.arange(5, 75, dtype=np.uint64))
        rng = np.random.default_rng(2)
        results: list[bytes] = []
        for _ in range(40):
            batch.choices[:] = rng.integers(-1, 5, batch.choices.shape)
            batch.inputs[:] = rng.uniform(-3, 3, batch.inputs.shape) * rng.choice(
                [0.3, 1, 5], batch.inputs.shape
            )
            batch.inputs[rng.random(batch.inputs.shape) < 0.05] = np.nan
            batch.step()
            results += [array.tobytes() for array in batch.arrays()]
        batch.close()
        seen.append(results)
    assert seen[0] == seen[1]


# Steps that the model does not explain ----------------------------------------------------------------

WRONG = """ProgramVariables
  /* @var: bound=[0:1] */ Real x;
  /* @var: bound=[0:1] */ Real y;
End.
Problem x = 0 & y = 0 -> [{ {?y >= 0; y := 2 * y + 1; ++ y := 0;} {x' = 1, y' = 0 & x <= y + 1} }*]x >= 0 End.
"""


def broken(monkeypatch: pytest.MonkeyPatch, old: str, new: str) -> None:
    """Compiles another model than the one that the monitor is made of."""
    from dl2c.emit.simulator import model_c

    original = model_c.model_c

    def changed(*given: Any) -> str:
        text = original(*given)
        assert old in text
        return text.replace(old, new)

    monkeypatch.setattr(model_c, "model_c", changed)


@pytest.fixture
def fresh_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))


@pytest.mark.usefixtures("fresh_cache")
def test_a_simulator_that_does_something_else_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    broken(monkeypatch, "return 2.0 * y_v + 1.0;", "return 2.0 * y_v + 1.01;")
    envs = dl2c.make_vec(WRONG, 3, monitor_every_step=True)
    envs.reset(seed=1)
    envs.step(np.array([1, 1, 1]))
    with pytest.raises(MonitorViolated, match=r"environment 1 violates condition \d+ .*controller") as caught:
        envs.step(np.array([1, 0, 1]))
    assert (caught.value.environment, caught.value.condition > 1) == (1, True)
    envs.close()


@pytest.mark.usefixtures("fresh_cache")
def test_a_motion_that_is_something_else_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    broken(monkeypatch, "* tau + l;", "* tau + 1.001 * l;")
    env = dl2c.make("example:watertank", monitor_every_step=True)
    env.reset(seed=1)
    with pytest.raises(MonitorViolated, match=r"model: l follows its solution \(watertank.kyx:34\)"):
        env.step(env.action_space.sample())
    env.close()


def test_a_model_without_a_monitor_is_refused_with_its_place() -> None:
    text = WRONG.replace("{?y >= 0;", "{ {?y < 3; y := y + 1;}*; ?!(y < 3);")
    with pytest.raises(CompileError) as refused:
        dl2c.build(text, monitor_every_step=True)
    assert {d.code for d in refused.value.diagnostics} == {"monitor-loop"}
    assert dl2c.build(text).library.manifest.conditions == ()


def test_a_state_that_is_set_is_where_the_next_step_begins() -> None:
    env = dl2c.make("example:waypoint", monitor_every_step=True)
    env.reset(seed=1)
    batch = env.unwrapped._batch
    x, p = batch.get_state(0)
    x[0] += 1
    batch.set_state(0, x, p)
    env.step(env.action_space.sample(mask=env.unwrapped._fresh_mask()))
    env.close()


def test_the_option_is_one_of_the_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from dl2c.cli import app

    arguments = ["rollout", "example:watertank", "--monitor-every-step", "--csv", str(tmp_path / "run.csv")]
    assert CliRunner().invoke(app, arguments).exit_code == 0
