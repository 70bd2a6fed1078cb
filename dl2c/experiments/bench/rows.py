"""What is compared: ways to run one model, and two environments of known speed for scale.

Every row steps environments with constant requests of zeros, which is the policy "first enabled
alternative" and costs nothing: what is measured is the environments.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import cycle, islice
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector.utils import create_empty_array
from numpy.typing import NDArray

from dl2c.configuration import resolve_options
from dl2c.env.opening import batch_options, open_library
from dl2c.env.registration import register
from dl2c.experiments.bench.baseline import Baseline, Start
from dl2c.experiments.bench.hand_written import HandWritten, is_there
from dl2c.pipeline import step_model
from dl2c.source import Source
from dl2c.version import install
from dl2c.work import require_memory_for_torch

if TYPE_CHECKING:
    from dl2c.native.binding import Library

BASELINE = "solve_ivp"
"""The row that all others are compared with."""

BATCHES = (1, 8, 64, 1024, 16384)
PYTHON_BATCHES = (64, 1024)
MANY = 4096
"""Environments of the Stable-Baselines3 row that is compared with what it cannot do without."""

LOOP = 1024
"""Environments of the rows that one batch is compared with."""

RECORDED = 1000
"""Steps of the episode that the empty environment plays, at most."""

STARTS = 256
"""Initial states of the baseline's episodes, drawn beforehand."""

ONE_BY_ONE = "-DDL2C_ONE_BY_ONE=1"
"""What the compiler is told to leave out lanes (cgen/runtime/numbers.h)."""

POLICY = {"on_blocked": "fallback", "action_map": "project"}
"""What a request of zeros needs to mean the first enabled alternative."""


@dataclass(frozen=True, slots=True)
class Row:
    """`run(k)` does k calls, each of which steps `n` environments once; ended episodes begin anew."""

    key: str
    title: str
    n: int
    run: Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Subject:
    """A model, its options and its built library."""

    source: Source
    options: Mapping[str, Any]
    library: "Library"


def subject(source: Source, options: Mapping[str, Any]) -> Subject:
    """Build what is measured. Raises what `open_library` does."""
    register()  # a command has not
    chosen = {**options, **POLICY}
    return Subject(source, chosen, open_library(source, chosen))


def rows(what: Subject) -> tuple[list[Row], list[str]]:
    """All rows that can be made here, the baseline first, and notes on those that cannot."""
    notes: list[str] = []
    found = [baseline_row(what), gym_row(what), *(batch_row(what, n) for n in BATCHES)]
    found.append(scalar_row(what, LOOP))
    found += [vector_row(what, n) for n in PYTHON_BATCHES]
    if find_spec("stable_baselines3") is None:
        notes.append(f"no row for Stable-Baselines3, which is not installed ({install('train')})")
    else:
        found += [*(sb3_row(what, n) for n in (*PYTHON_BATCHES, MANY)), infos_row(what, MANY)]
    if is_there(what.source) and not what.options.keys() - POLICY.keys() - {"native"}:
        loop = HandWritten(LOOP, what.options.get("native"))
        found.append(Row("loop", f"hand-written C loop, n = {LOOP}", LOOP, _repeated(loop.step)))
    found += [memory_row(what, LOOP), cartpole_row(), cartpole_vector_row(LOOP), empty_row(what)]
    return found, notes


def starts(library: "Library", count: int = STARTS) -> list[Start]:
    """Initial states of a model: those of the seeds 0, 1, ... Raises `ResetFailed`."""
    batch = library.batch(count, **batch_options(library.manifest))
    batch.reset(seeds=np.arange(count, dtype=np.uint64))
    states = [batch.get_state(i) for i in range(count)]
    batch.close()
    return [(tuple(x.tolist()), tuple(p.tolist())) for x, p in states]


def baseline(what: Subject, states: Sequence[Start]) -> Baseline:
    """The solve_ivp environment of a model."""
    manifest = what.library.manifest
    max_steps = manifest.options["max_episode_steps"]
    model, paths = step_model(what.source, resolve_options(what.options))
    return Baseline(model, paths, [q.name for q in manifest.observations], states, max_steps)


def baseline_row(what: Subject) -> Row:
    """One environment by the recipe of the paper."""
    env = baseline(what, starts(what.library))

    def run(k: int) -> None:
        step, reset = env.step, env.reset
        for _ in range(k):
            _, _, terminated, truncated = step()
            if terminated or truncated:
                reset()

    return Row(BASELINE, "scipy solve_ivp in Python", 1, run)


def gym_row(what: Subject) -> Row:
    """One environment as a Gymnasium user makes it."""
    env = gym.make("dl2c:dl2c/Model-v0", model=what.source, **_gym_options(what))  # pyright: ignore[reportUnknownMemberType] # gym.make has a bare type
    env.reset(seed=0)
    return Row("gym", "gym.make, one environment", 1, _episodes(env, [zero(env.action_space)]))


def batch_row(what: Subject, n: int) -> Row:
    """n environments stepped by one C call; masks, rewards, observations and autoreset included."""
    batch = what.library.batch(n, autoreset="same_step", **batch_options(what.library.manifest))
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    return Row(f"batch{n}", f"batch in C, n = {n}", n, _repeated(batch.step))


def scalar_row(what: Subject, n: int) -> Row:
    """The same batch, whose environments are moved one by one: what lanes gain."""
    flags = os.environ.get("CFLAGS")
    os.environ["CFLAGS"] = f"{flags or ''} {ONE_BY_ONE}"
    try:
        library = open_library(what.source, what.options)
    finally:
        if flags is None:
            del os.environ["CFLAGS"]
        else:
            os.environ["CFLAGS"] = flags
    row = batch_row(replace(what, library=library), n)
    return replace(row, key=f"scalar{n}", title=f"batch in C, moved one by one, n = {n}")


def vector_row(what: Subject, n: int) -> Row:
    """n environments as a Gymnasium vector environment."""
    env: Any = gym.make_vec("dl2c:dl2c/Model-v0", n, model=what.source, **_gym_options(what))  # pyright: ignore[reportUnknownMemberType] # gym.make_vec too
    env.reset(seed=0)
    actions = create_empty_array(env.single_action_space, n)
    return Row(f"vector{n}", f"gym.make_vec, n = {n}", n, _repeated(lambda: env.step(actions)))


def sb3_row(what: Subject, n: int) -> Row:
    """n environments as a Stable-Baselines3 VecEnv."""
    require_memory_for_torch()
    from dl2c.env.sb3 import Dl2cVecEnv

    env: Any = Dl2cVecEnv(what.source, n, **what.options)
    env.seed(0)
    env.reset()
    actions = create_empty_array(env.action_space, n)
    return Row(f"sb3_{n}", f"Stable-Baselines3 VecEnv, n = {n}", n, _repeated(lambda: env.step(actions)))


def infos_row(what: Subject, n: int) -> Row:
    """The least a VecEnv costs: a step of a batch, an info for each environment, a copy of the arrays."""
    batch = what.library.batch(n, autoreset="same_step", **batch_options(what.library.manifest))
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    returned = (batch.obs, batch.rewards, batch.terminated, batch.truncated)

    def step() -> tuple[list[NDArray[Any]], list[dict[str, Any]]]:
        batch.step()
        return [array.copy() for array in returned], [{} for _ in range(n)]

    return Row(f"infos{n}", f"batch, empty infos and copies, n = {n}", n, _repeated(step))


def cartpole_row() -> Row:
    """Gymnasium's CartPole, pushed left and right in turn."""
    env = gym.make("CartPole-v1")  # pyright: ignore[reportUnknownMemberType] # gym.make has a bare type
    env.reset(seed=0)
    return Row("cartpole", "CartPole-v1 of Gymnasium", 1, _episodes(env, [0, 1]))


def cartpole_vector_row(n: int) -> Row:
    """Gymnasium's own vector environment, in numpy."""
    env: Any = gym.make_vec("CartPole-v1", n, vectorization_mode="vector_entry_point")  # pyright: ignore[reportUnknownMemberType] # gym.make_vec too
    env.reset(seed=0)
    actions = np.arange(n) % 2
    title = f"CartPole-v1 of Gymnasium in numpy, n = {n}"
    return Row(f"cartpole{n}", title, n, _repeated(lambda: env.step(actions)))


def memory_row(what: Subject, n: int) -> Row:
    """Nothing but copying what a step of a batch reads and writes: the least any way of stepping costs."""
    batch = what.library.batch(n, **batch_options(what.library.manifest))
    sizes = what.library.sizes
    state = 8 * n * (sizes.nx + sizes.np)
    batch.close()
    source = np.zeros(state + sum(array.nbytes for array in batch.arrays()), np.uint8)
    target = np.empty_like(source)
    return Row("memory", f"copying its memory, n = {n}", n, _repeated(lambda: np.copyto(target, source)))


def empty_row(what: Subject) -> Row:
    """An environment that does nothing but make the same objects: the least Gymnasium costs."""
    model: Any = gym.make("dl2c:dl2c/Model-v0", model=what.source, **_gym_options(what))  # pyright: ignore[reportUnknownMemberType] # gym.make has a bare type
    spec = EnvSpec(
        "Empty-v0", entry_point=lambda **_: EmptyEnv(model), order_enforce=False, disable_env_checker=True
    )
    env: Any = gym.make(spec)  # pyright: ignore[reportUnknownMemberType] # gym.make has a bare type
    env.reset(seed=0)
    return Row("empty", "empty Gymnasium environment", 1, _episodes(env, [zero(env.action_space)]))


class EmptyEnv(gym.Env[NDArray[Any], Any]):
    """Plays an episode of `model` over and over, in fresh objects; actions are not looked at."""

    def __init__(self, model: "gym.Env[NDArray[Any], Any]") -> None:
        self.observation_space, self.action_space = model.observation_space, model.action_space
        self._first = model.reset(seed=0)
        steps: list[tuple[NDArray[Any], Any, bool, bool, dict[str, Any]]] = []
        while len(steps) < RECORDED and not (steps and (steps[-1][2] or steps[-1][3])):
            steps.append(model.step(zero(model.action_space)))
        self._steps = cycle(steps)
        self._copied = [k for k, v in steps[0][4].items() if isinstance(v, np.ndarray | dict)]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """A fresh observation and a fresh info."""
        super().reset(seed=seed)
        observation, info = self._first
        return observation.copy(), {key: copy(value) for key, value in info.items()}

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """The next step's results."""
        observation, reward, terminated, truncated, info = next(self._steps)
        info = info.copy()
        for key in self._copied:
            info[key] = info[key].copy()
        return observation.copy(), reward, terminated, truncated, info


def zero(space: gym.Space[Any]) -> Any:
    """The action of a request of zeros."""
    match space:
        case gym.spaces.Discrete():
            return 0
        case gym.spaces.Dict():
            return {key: zero(part) for key, part in space.spaces.items()}
        case _:
            return np.zeros(space.shape or (), space.dtype)


def _gym_options(what: Subject) -> dict[str, Any]:
    """The options under the names that `gym.make` leaves to the environment."""
    return {"max_steps" if name == "max_episode_steps" else name: v for name, v in what.options.items()}


def _repeated(step: Callable[[], Any]) -> Callable[[int], None]:
    def run(k: int) -> None:
        for _ in range(k):
            step()

    return run


def _episodes(env: "gym.Env[Any, Any]", actions: Sequence[Any]) -> Callable[[int], None]:
    """Step and, at the end of an episode, reset; the actions are taken in turn."""
    turns = cycle(actions)

    def run(k: int) -> None:
        step, reset = env.step, env.reset
        for action in islice(turns, k):
            _, _, terminated, truncated, _ = step(action)
            if terminated or truncated:
                reset()

    return run


def deviation(what: Subject, steps: int = 200) -> float:
    """How far the baseline and the C differ over so many steps from the same initial states.

    The largest difference of a variable, relative beyond 1; infinite if an episode ends in one only.
    """
    states = starts(what.library)
    env = baseline(what, states)
    batch = what.library.batch(1, **batch_options(what.library.manifest))
    batch.reset_to(0, 0, *states[0])
    worst = 0.0
    for episode in _steps(env, batch, steps):
        x, _ = batch.get_state(0)
        worst = max(worst, float(np.max(np.abs(np.array(env.x) - x) / np.maximum(1.0, np.abs(x)))))
        if episode is None:
            return np.inf
        if episode:
            env.reset()
            batch.reset_to(0, None, env.x, env.p)
    batch.close()
    return worst


def _steps(env: Baseline, batch: Any, count: int) -> Iterator[bool | None]:
    """Step both: whether the episode has ended, None where they disagree on that."""
    for _ in range(count):
        _, _, *ends = env.step()
        batch.step()
        yield any(ends) if ends == [bool(batch.terminated[0]), bool(batch.truncated[0])] else None
