"""The waypoint example and a model with every kind of decision, compiled, through every door:
Gymnasium, its vector environments, Stable-Baselines3, the command line.
"""

import json
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from agreement import assert_batch_equals_singles
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

import dl2c
from dl2c.native.errors import ResetFailed
from dl2c.options import Options, UnknownOption, with_options
from dl2c.training.evaluation import evaluate

pytestmark = pytest.mark.usefixtures("unoptimised")

WAYPOINT = "example:waypoint"
REPOSITORY = Path(dl2c.__file__).parent.parent

MIXED = """
ArchiveEntry "Mixed"
Definitions
  Real W = 2;
  /* @const: bound=[0.5:1] */
  Real c;
  /* @safety: penalty=-1, on_failure=terminate:status=failure */
  Bool near(Real x) <-> x^2 <= 25;
  /* @progress: reward=1, on_success=terminate:status=success */
  Bool there(Real x) <-> x >= 4;
End.
ProgramVariables
  /* @var: bound=[-6:6] */
  Real x;
  /* @var: bound=[-2:2] */
  Real w;
  Real t;
End.
Problem
  -1 <= x & x <= 1 & c > 0 -> [{
    w := *; ?-W <= w & w <= W;
    { ?x <= 2; w := w + c; ++ ?x >= 0; }
    { w := w + 0; ++ w := 0; ++ w := -w; }
    t := 0; {x' = w, t' = 1 & t <= 0.5}
  }*](near(x))
End.
End.
"""


@pytest.mark.parametrize("options", [{}, {"action_map": "squash"}, {"obs_dtype": "float64"}])
def test_check_env_is_silent(options: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make("dl2c:dl2c/Waypoint-v0", **options).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("options", [{}, {"action_format": "box"}])
def test_check_env_is_silent_on_mixed_decisions(options: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("dl2c/Model-v0", model=MIXED, action_map="squash", **options)
        check_env(env.unwrapped, skip_render_check=True)


def test_check_env_of_stable_baselines3_is_silent() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gym.make("dl2c/Waypoint-v0"))
        checker.check_env(dl2c.make(MIXED, action_map="squash", action_format="box"))


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("on_blocked", ["fallback", "terminate"])
def test_a_batch_equals_single_environments(mode: AutoresetMode, on_blocked: str) -> None:
    assert assert_batch_equals_singles(WAYPOINT, mode, on_blocked=on_blocked, steps=150) > 4


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize(
    "options", [{"action_map": "squash"}, {"action_format": "box", "obs_dtype": "float64"}]
)
def test_a_batch_equals_single_environments_on_mixed_decisions(
    mode: AutoresetMode, options: dict[str, Any]
) -> None:
    assert assert_batch_equals_singles(MIXED, mode, steps=100, **options) > 4


def test_the_mask_tells_what_blocks() -> None:
    env = dl2c.make(WAYPOINT, on_blocked="terminate")
    rng = np.random.default_rng(0)
    for episode in range(60):
        _, info = env.reset(seed=episode)
        for _ in range(rng.integers(60)):
            _, _, terminated, _, info = env.step(int(info["action_mask"].argmax()))
            assert not info["blocked"]
            if terminated:
                break
        else:
            action = int(rng.integers(4))
            _, _, terminated, _, after = env.step(action)
            assert after["blocked"] == (info["action_mask"][action] == 0)
            assert not after["blocked"] or (terminated and after["reason"] == "blocked")


def test_a_squashed_action_is_executed_in_its_own_encoding() -> None:
    env = dl2c.make(MIXED, action_map="squash")
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(50):
        action = env.action_space.sample()
        _, _, terminated, truncated, info = env.step(action)
        taken = info["executed_action"]
        assert taken in env.action_space
        if not info["blocked"]:
            assert taken["assign_w"] == pytest.approx(action["assign_w"], abs=1e-6)
        if terminated or truncated:
            env.reset()


def test_masks_alone_solve_the_waypoint() -> None:
    for policy in ("first", "random"):
        found = evaluate(policy, WAYPOINT, 100, on_blocked="terminate")
        assert (found.success.value, found.violations.value, found.blocked.value) == (1, 0, 0)
    found = evaluate("random", WAYPOINT, 100, masked=False, on_blocked="terminate")
    assert found.success.value < 0.1 and found.blocked.value > 0.9


def test_a_pickled_environment_behaves_the_same() -> None:
    env = gym.make("dl2c/Waypoint-v0", on_blocked="terminate")
    twin = pickle.loads(pickle.dumps(env))
    for e in (env, twin):
        e.reset(seed=2)
    assert data_equivalence(env.step(2), twin.step(2), exact=True)
    vector = dl2c.make_vec(WAYPOINT, 2)
    twins = pickle.loads(pickle.dumps(vector))
    assert data_equivalence(vector.reset(seed=1), twins.reset(seed=1), exact=True)


def test_a_state_is_checked_against_the_precondition() -> None:
    env = dl2c.make(WAYPOINT, constants={"ep": 0.25})
    env.reset(seed=1)
    state = env.state
    assert state["ep"] == 0.25
    env.step(2)
    env.reset(options={"state": {k: v for k, v in state.items() if k != "ep"}})
    assert env.state == state
    with pytest.raises(ResetFailed):
        env.reset(options={"state": state | {"vr": 1.0}})
    with pytest.raises(ValueError, match=r"`ep` is fixed at 0\.25"):
        env.reset(options={"state": state | {"ep": 0.3}})


def test_an_observation_is_the_state_it_shows() -> None:
    env = dl2c.make(WAYPOINT, obs_dtype="float64")
    for seed in range(20):
        observation, _ = env.reset(seed=seed)
        names = [q.name for q in env.manifest.observations]
        assert observation.tolist() == [env.state[name] for name in names]


def test_options_that_do_not_exist_are_named() -> None:
    with pytest.raises(UnknownOption, match="no option `on_block`"):
        dl2c.make(WAYPOINT, on_block="terminate")
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):  # TorchRL asks so
        gym.make("dl2c/Waypoint-v0", frameskip=4)
    with pytest.raises(UnknownOption, match="'terminate'"):
        dl2c.make(WAYPOINT, on_blocked="stop")
    limited = gym.make("dl2c/Waypoint-v0", max_steps=7)
    assert limited.spec is not None and limited.spec.max_episode_steps == 7
    assert dl2c.make(WAYPOINT, max_steps=7).manifest.options["max_episode_steps"] == 7


def test_a_wrong_model_raises_a_compile_error() -> None:
    with pytest.raises(dl2c.CompileError, match="error: "):
        dl2c.make(MIXED.replace("x' = w", "x' = y"))


def command(*arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run `dl2c` as a process of its own."""
    code = "from dl2c.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=REPOSITORY, check=check
    )


def test_built_files_can_be_loaded(tmp_path: Path) -> None:
    out = command("build", WAYPOINT, "-o", str(tmp_path), "--json").stdout
    directory = Path(json.loads(out)["directory"])
    names = {path.name for path in directory.iterdir()}
    assert {"manifest.json", "model.ir"} < names
    assert any(name.endswith(".c") for name in names) and any(name.endswith(".so") for name in names)
    library = dl2c.load(directory)
    assert library.manifest.name == directory.name
    library.batch(2).reset(seeds=np.arange(2, dtype=np.uint64))


@pytest.mark.parametrize("stage", ["tree", "expanded", "ir", "paths", "c"])
def test_every_stage_can_be_printed(stage: str) -> None:
    result = command("emit", "--stage", stage, WAYPOINT)
    assert len(result.stdout) > 200 and result.stderr == ""


def test_wrong_text_exits_1_without_a_traceback(tmp_path: Path) -> None:
    wrong = {"empty": "", "noise": "End. ( ::= x'", "unbound": MIXED.replace("x' = w", "x' = y")}
    for name, text in wrong.items():
        path = tmp_path / f"{name}.kyx"
        path.write_text(text)
        result = command("check", str(path), check=False)
        assert (result.returncode, result.stdout) == (1, "")
        assert result.stderr.startswith("error: ") and "Traceback" not in result.stderr
    assert command("emit", "--stage", "soup", WAYPOINT, check=False).returncode == 2


def test_importing_dl2c_is_cheap_and_registers_the_ids() -> None:
    code = (
        "import sys, gymnasium, dl2c;"
        "heavy = {'casadi', 'z3', 'torch', 'matplotlib', 'cffi', 'stable_baselines3'};"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules);"
        "assert {'dl2c/Model-v0', 'dl2c/Waypoint-v0'} <= set(gymnasium.registry)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, check=True)


CHOSEN = {
    "duration": "sample",
    "safety_check": "step",
    "integrator": "exact",
    "stiff": "true",
    "rtol": "1e-6",
    "atol": "0.0001",
    "tolerance": "1e-7",
    "progress_failure": "literal",
    "dt": "0.25",
    "max_flow": "12.5",
    "mask_depth": "step",
    "on_blocked": "truncate",
    "blocked_penalty": "-0.5",
    "max_episode_steps": 7,
    "stall_limit": 3,
    "action_format": "box",
    "action_map": "squash",
    "observe_constants": False,
    "obs_dtype": "float64",
    "observation_bounds": "unbounded",
}
"""An option of every kind, each with a value that is not its default."""


def test_every_door_takes_every_option(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command line, Python and `@episode` lead to the same environment."""
    monkeypatch.setenv("CFLAGS", "-O0")
    python = dl2c.make(MIXED, **CHOSEN).manifest
    chosen = with_options(Options(), CHOSEN)
    assert all(getattr(chosen, name) != getattr(Options(), name) for name in CHOSEN)
    words = {name: str(value).lower() for name, value in CHOSEN.items()}
    written = ", ".join(f"{name}={value}" for name, value in words.items())
    episode = dl2c.make(MIXED.replace("Problem", f"/* @episode: {written} */\nProblem")).manifest
    assert episode.options == python.options
    del words["observe_constants"]
    flags = [part for name, value in words.items() for part in (f"--{name.replace('_', '-')}", value)]
    shown = json.loads(command("info", MIXED, "--json", "--no-observe-constants", *flags).stdout)
    assert shown["options"] == json.loads(python.to_json())["options"]


@pytest.mark.parametrize("name", ["duration", "safety_check", "integrator", "stiff", "rtol", "atol"])
def test_every_door_refuses_what_an_option_does_not_take(name: str) -> None:
    with pytest.raises(UnknownOption, match=f"`{name}` takes"):
        dl2c.make(MIXED, **{name: "soup"})
    with pytest.raises(dl2c.CompileError, match=r"soup|decimal"):
        dl2c.make(MIXED.replace("Problem", f"/* @episode: {name}=soup */\nProblem"))
    refused = command("check", WAYPOINT, f"--{name.replace('_', '-')}", "soup", check=False)
    assert refused.returncode == 2 and f"`{name}` takes" in refused.stderr
