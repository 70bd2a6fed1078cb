"""Gymnasium modules that `emit --stage gym` writes: over the library, and in plain Python."""

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from selection import few_and_many

import dl2c
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.pipeline import emit
from dl2c.source import Source

pytestmark = pytest.mark.usefixtures("unoptimised")

HERE = Path(__file__).parents[1]
EXAMPLES = HERE.parent / "examples"
WAYPOINT = EXAMPLES / "waypoint.kyx"
REFUSED = {"etcs", "evasion", "passive_safety", "static_safety"}
"""In plain Python: the environment decides, or tests join inputs."""
SUPPORTED = sorted(path for path in EXAMPLES.glob("*.kyx") if path.stem not in REFUSED)
SMALL = EXAMPLES / "rewards" / "deadline.kyx"
QUICK = ("dubins", "waypoint")
NUMERIC = ("dubins", "pendulum", "thermostat")


@cache
def text_of(path: Path, pure: bool) -> str:
    return emit(Source.read(path), "gym", resolve_options({}), pure)


def some_quick(paths: list[Path]) -> list[Any]:
    return [pytest.param(p, marks=[] if p.stem in QUICK else [pytest.mark.slow], id=p.stem) for p in paths]


def imported(text: str, folder: Path) -> ModuleType:
    """The text as a module; its classes are found by their names."""
    file = folder / "generated.py"
    file.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("generated", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["generated"] = module
    spec.loader.exec_module(module)
    return module


def environment_of(module: ModuleType) -> Any:
    return next(v for k, v in vars(module).items() if k.endswith("Env") and k != "Dl2cEnv")


@pytest.mark.parametrize("pure", [False, True])
def test_modules_read_as_before(pure: bool, golden: Callable[[Path, str], None]) -> None:
    source = Source(WAYPOINT.name, WAYPOINT.read_text(encoding="utf-8"))
    name = f"waypoint{'_pure' if pure else ''}.txt"
    golden(HERE / "golden" / "gym" / name, emit(source, "gym", resolve_options({}), pure))


@pytest.mark.parametrize("pure", [False, True])
def test_modules_are_formatted_and_clean(pure: bool, tmp_path: Path) -> None:
    pytest.importorskip("ruff")
    for path in (*SUPPORTED, SMALL):
        (tmp_path / f"{path.stem}.py").write_text(text_of(path, pure), encoding="utf-8")
    for arguments in (["format", "--check", "--diff"], ["check"]):
        command = [sys.executable, "-m", "ruff", *arguments, "--isolated", "--no-cache", "."]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_plain_python_needs_no_dl2c_and_scipy_only_for_solvers() -> None:
    for path in SUPPORTED:
        imports = [line for line in text_of(path, True).splitlines() if line.startswith(("import ", "from "))]
        assert not any("dl2c" in line for line in imports)
        assert any("scipy" in line for line in imports) == (path.stem in NUMERIC)


@pytest.mark.parametrize("path", [EXAMPLES / "watertank.kyx"], ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_module_over_the_library_is_the_environment(path: Path, tmp_path: Path) -> None:
    module = imported(text_of(path, False), tmp_path)
    module.register("Generated-v0")
    env: Any = gym.make("Generated-v0").unwrapped
    other = dl2c.make(path)
    assert (env.observation_space, env.action_space) == (other.observation_space, other.action_space)
    assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
    check_env(env)
    for section in ("Action Space", "Observation Space", "Rewards", "Starting State", "Episode End"):
        assert f"## {section}" in environment_of(module).__doc__


@pytest.mark.parametrize("path", some_quick(SUPPORTED))
@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_plain_python_passes_the_checker(path: Path, tmp_path: Path) -> None:
    check_env(environment_of(imported(text_of(path, True), tmp_path))())


def agree(pure: Any, compiled: Any, module: ModuleType, episodes: int, steps: int) -> set[str]:
    """Steps both from the same states with the same actions; the reasons for which episodes ended."""
    reasons: set[str] = set()
    pure.action_space.seed(0)
    assert (pure.observation_space, pure.action_space) == (compiled.observation_space, compiled.action_space)
    for episode in range(episodes):
        _, info = pure.reset(seed=episode)
        state = {name: float(value) for name, value in vars(pure.state).items()}
        seen, other = compiled.reset(seed=episode, options={"state": state})
        assert info.get("action_mask", np.ones(1)).tolist() == other.get("action_mask", np.ones(1)).tolist()
        for _ in range(steps):
            pure.state = module.State(**compiled.state)
            action = pure.action_space.sample()
            observation, reward, *ends, info = pure.step(action)
            seen, wanted, *others, other = compiled.step(action)
            assert ends == others and set(info) == set(other)
            for key in ("status", "reason", "cost", "blocked", "postcondition", "saturated"):
                assert info[key] == other[key], (key, info, other)
            assert reward == pytest.approx(wanted, rel=1e-6, abs=1e-6)
            assert info["duration"] == pytest.approx(other["duration"], abs=1e-7)
            np.testing.assert_allclose(observation, seen, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(
                np.hstack(list(executed(info))), np.hstack(list(executed(other))), rtol=1e-6, atol=1e-9
            )
            assert (
                info.get("action_mask", np.ones(1)).tolist() == other.get("action_mask", np.ones(1)).tolist()
            )
            if any(ends):
                reasons.add(info["reason"])
                break
    return reasons


def executed(info: dict[str, Any]) -> list[Any]:
    action = info["executed_action"]
    return [action[key] for key in sorted(action)] if isinstance(action, dict) else [action]


@pytest.mark.parametrize("count", few_and_many(2, 5))
@pytest.mark.parametrize("path", some_quick(SUPPORTED))
def test_plain_python_agrees_with_compiled_code(count: int, path: Path, tmp_path: Path) -> None:
    """From the same state the same action has the same outcome."""
    module = imported(text_of(path, True), tmp_path)
    agree(environment_of(module)(), dl2c.make(path), module, count, 30)


def test_options_mean_the_same_in_plain_python(tmp_path: Path) -> None:
    options = {"on_blocked": "truncate", "blocked_penalty": -3.0, "max_episode_steps": 4}
    path = EXAMPLES / "thermostat.kyx"
    module = imported(text_of(path, True), tmp_path)
    pure = environment_of(module)(**options)
    assert agree(pure, dl2c.make(path, **options), module, 12, 5) == {"blocked", "time_limit"}


def test_without_a_loop_an_episode_has_one_step(tmp_path: Path) -> None:
    text = TRAP.replace("FLOW", "x' = 1 & t <= 1").replace("PRECONDITION", "x <= 0").replace("}*", "}")
    module = imported(emit(Source("trap.kyx", text), "gym", resolve_options({}), True), tmp_path)
    assert agree(environment_of(module)(), dl2c.make(text), module, 3, 2) == {"end"}


def test_constants_can_be_fixed_in_plain_python(tmp_path: Path) -> None:
    module = imported(text_of(EXAMPLES / "watertank.kyx", True), tmp_path)
    env = environment_of(module)(constants={"q": 0.2})
    for seed in range(5):
        env.reset(seed=seed)
        assert env.state.q == 0.2
    with pytest.raises(ValueError, match="precondition"):
        env.reset(options={"state": vars(env.state) | {"l": 6.0}})


def test_what_plain_python_cannot_do_is_refused_with_its_place() -> None:
    with pytest.raises(CompileError) as refused:
        text_of(EXAMPLES / "static_safety.kyx", True)
    assert {d.code for d in refused.value.diagnostics} == {"not-in-python"}
    assert all(d.span.source.name.endswith("static_safety.kyx") for d in refused.value.diagnostics)
    labels = {d.label for d in refused.value.diagnostics}
    assert {"chance decides some of this step", "an equality that decides an input"} <= labels


TRAPS = {
    "strict": ("x' = 1 & x < 1 & t <= 1", "x >= -1 & x < 1"),
    "graze": ("x' = v, v' = 2 & x >= 0 & t <= 3", "x >= 0 & x <= 2 & v >= -3 & v <= 0"),
    "cases": ("x' = v & (abs(x) <= 1 | x >= 2) & t <= 3", "abs(x) <= 1 & v >= -1 & v <= 1"),
    "cubic": ("x' = y, y' = v, v' = 1 & x <= 1 & t <= 4", "x <= 1 & x >= -1 & abs(y) <= 2 & abs(v) <= 2"),
    "square": ("x' = -x^2 & x >= 0.5 & t <= 3", "x >= 0.5 & x <= 2"),
    "sine": ("x' = cos(y), y' = 1 & x <= 1 & t <= 4", "x <= 1 & x >= 0 & abs(y) <= 2"),
}
"""Motions with their domains, and where they begin: bounds that are touched, met at once, or open."""

TRAP = """ArchiveEntry "Trap"
Definitions
  /* @safety: penalty=-1, on_failure=continue:failure */
  Bool low(Real x) <-> x^2 <= 0.64 | x <= 0;
End.
ProgramVariables
  /* @var: bound=[-9:9] */
  Real x;
  /* @var: bound=[-9:9] */
  Real y;
  /* @var: bound=[-9:9] */
  Real v;
  Real t;
End.
Problem
  PRECONDITION -> [{ t := 0; {t' = 1, FLOW} }*] low(x)
End.
End.
"""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in ("strict", "sine") else []) for n in TRAPS]
)
def test_boundaries_are_met_as_in_compiled_code(name: str, tmp_path: Path) -> None:
    """Every third state has halves only, so that boundaries are touched and left from exactly."""
    flow, precondition = TRAPS[name]
    text = TRAP.replace("FLOW", flow).replace("PRECONDITION", precondition)
    module = imported(emit(Source("trap.kyx", text), "gym", resolve_options({}), True), tmp_path)
    pure, compiled = environment_of(module)(), dl2c.make(text)
    left_early = 0
    for seed in range(60):
        pure.reset(seed=seed)
        state = {k: round(2 * v) / 2 if seed % 3 == 0 else float(v) for k, v in vars(pure.state).items()}
        if not module.precondition(module.State(**state)):
            continue
        pure.reset(options={"state": state})
        compiled.reset(seed=seed, options={"state": state})
        *_, info = pure.step(0)
        *_, other = compiled.step(0)
        assert (info["cost"], info["reason"]) == (other["cost"], other["reason"])
        assert vars(pure.state) == pytest.approx(compiled.state, abs=1e-7)
        left_early += info["duration"] < 0.9
    assert left_early
