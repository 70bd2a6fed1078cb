"""Recording episodes as they happen: failures become files that `dl2c replay` reads."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from dl2c.emit.names import file_stem
from dl2c.env.seeding import draw_seed
from dl2c.env.single import Dl2cEnv, Step
from dl2c.env.state import read_states
from dl2c.env.vector import Dl2cVectorEnv
from dl2c.report.episode import Episode, Moment, Start, moment, write_episode


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Calls `ended` with every episode, as soon as it has ended.

    A seed that is not given to the first reset is drawn here, so that every episode can be replayed.
    """

    def __init__(self, env: gym.Env[Any, Any], ended: Callable[[Episode], None]) -> None:
        super().__init__(env)
        self._ended = ended
        self._start: Start | None = None
        self._initial: Mapping[str, float] = {}
        self._moments: list[Moment] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        """As without recording."""
        before, number = self._start, 0
        if seed is None and before is None:
            seed = draw_seed(self.np_random)
        elif seed is None and before is not None:
            number = before.number + 1
        result = self.env.reset(seed=seed, options=options)
        kept = before.seed if seed is None and before is not None else seed
        state: Mapping[str, float] | None = (options or {}).get("state")
        assert kept is not None
        self._start = Start(kept, number, None if state is None else {n: float(v) for n, v in state.items()})
        self._initial, self._moments = self._model.state, []
        return result

    def step(self, action: Any) -> Step:  # pyright: ignore[reportIncompatibleMethodOverride] # a supertype of float there
        """As without recording."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._moments.append(moment(self._model, action, float(reward), info))
        if terminated or truncated:
            assert self._start is not None
            env, moments = self._model, tuple(self._moments)
            how = info["status"], info["reason"]
            self._ended(Episode(env.source, env.manifest.options, self._start, self._initial, moments, *how))
        return observation, float(reward), terminated, truncated, info

    @property
    def _model(self) -> Dl2cEnv:
        """The environment inside all wrappers."""
        return cast("Dl2cEnv", self.unwrapped)


class Recording:
    """The first `count` of episodes that are played all at once, the first of them seeded `seed`: a `Watch`
    of `outcomes`.
    """

    def __init__(self, count: int, seed: int) -> None:
        self._count, self._seed = count, seed
        self._begun: list[Episode] = []
        self._moments: list[list[Moment]] = []
        self._ends: list[tuple[str, str]] = []

    def __call__(self, env: Dl2cVectorEnv, actions: NDArray[Any] | None, running: NDArray[np.bool_]) -> None:
        if actions is None:
            self._begin(env)
        else:
            self._note(env, actions, running.tolist())

    def _begin(self, env: Dl2cVectorEnv) -> None:
        options = env.manifest.options
        for i, initial in enumerate(self._states(env)):
            begun = Episode(env.source, options, Start(self._seed + i), initial, (), "none", "")
            self._begun.append(begun)
            self._moments.append([])
            self._ends.append(("none", ""))

    def _note(self, env: Dl2cVectorEnv, actions: NDArray[Any], running: list[bool]) -> None:
        b, statuses, reasons = env.batch, env.status_names, env.reason_names
        told = (b.time, b.duration, b.rewards, b.cost, b.blocked, b.postcondition, b.status, b.reason)
        columns = (array[: self._count].tolist() for array in (actions, *told))
        rows = zip(self._states(env), *columns, strict=True)
        for i, (state, action, *said, status, reason) in enumerate(rows):
            if running[i]:
                self._moments[i].append(Moment(action, state, *said))
                self._ends[i] = statuses[status], reasons[reason]

    def _states(self, env: Dl2cVectorEnv) -> list[dict[str, float]]:
        return read_states(env.manifest, env.batch, range(min(self._count, env.num_envs)))

    def episodes(self) -> list[Episode]:
        """What was recorded."""
        together = zip(self._begun, self._moments, self._ends, strict=True)
        return [replace(e, moments=tuple(m), status=s, reason=r) for e, m, (s, r) in together]


def failures_to(folder: Path | str) -> Callable[[Episode], None]:
    """For a `Recorder`: writes every episode that ends in failure, or in which a @safety predicate failed,
    to a file of its own, named by the model, the seed, and how many episodes came before since the seed.
    """

    def ended(episode: Episode) -> None:
        if episode.failed:
            start = episode.start
            stem = file_stem(Path(episode.source.name).stem)
            write_episode(episode, Path(folder, f"{stem}-{start.seed}-{start.number}.json"))

    return ended
