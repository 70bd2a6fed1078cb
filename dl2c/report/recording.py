"""Recording episodes as they happen: failures become files that `dl2c replay` reads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium as gym

from dl2c.emit.names import file_stem
from dl2c.env.seeding import draw_seed
from dl2c.env.single import Dl2cEnv, Step
from dl2c.report.episode import Episode, Moment, Start, moment, write_episode


class RecordFailures(gym.Wrapper[Any, Any, Any, Any]):
    """Writes every episode that ends in failure, or in which a @safety predicate failed, to `folder`.

    `episode` is the one under way, from its reset on. `written` lists the files: one per failure, named by
    model, seed, and how many resets came since the seed.
    """

    def __init__(self, env: gym.Env[Any, Any], folder: Path | str) -> None:
        super().__init__(env)
        self.folder = Path(folder)
        self.written: list[Path] = []
        self.episode: Episode | None = None
        self._moments: list[Moment] = []

    @property
    def model(self) -> Dl2cEnv:
        """The environment inside all wrappers."""
        return cast("Dl2cEnv", self.unwrapped)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        """As without recording. The first seed is drawn here if none is given, to be written down."""
        before = None if self.episode is None else self.episode.start
        if seed is None and before is None:
            seed = draw_seed(self.np_random)
        number = 0 if seed is not None or before is None else before.number + 1
        kept = seed if seed is not None or before is None else before.seed
        assert kept is not None
        state: Mapping[str, float] | None = (options or {}).get("state")
        result = self.env.reset(seed=seed, options=options)
        env, self._moments = self.model, []
        start = Start(kept, number, None if state is None else {n: float(v) for n, v in state.items()})
        self.episode = Episode(env.source, env.manifest.options, start, env.state, (), "none", "")
        return result

    def step(self, action: Any) -> Step:  # pyright: ignore[reportIncompatibleMethodOverride] # a supertype of float there
        """As without recording; writes a file where the episode ends in failure."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        assert self.episode is not None
        self._moments.append(moment(self.model, action, float(reward), info))
        if terminated or truncated:
            at = self.episode
            ended = Episode(
                at.source,
                at.options,
                at.start,
                at.initial,
                tuple(self._moments),
                info["status"],
                info["reason"],
            )
            self.episode = ended
            if ended.failed:
                self._write(ended)
        return observation, float(reward), terminated, truncated, info

    def _write(self, episode: Episode) -> None:
        start = episode.start
        name = f"{file_stem(self.model.manifest.name)}-{start.seed}-{start.number}.json"
        write_episode(episode, self.folder / name)
        self.written.append(self.folder / name)
