"""Pictures while Stable-Baselines3 learns. Imports stable_baselines3: import this only where it does."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback

from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.picture.figure import episode_figure, save
from dl2c.report.blame import model_of
from dl2c.report.pictures import episodes_of, track_of
from dl2c.training.evaluation import FIRST_SEED
from dl2c.training.policies import Masks


class PictureCallback(BaseCallback):
    """Every `every` environment steps, and at the end, runs `episodes` episodes of the policy as it is,
    without chance in its actions, and draws them to `folder/<steps>.png`.

    The environments that are learned on have to be dl2c's, with or without wrappers around them.
    """

    def __init__(self, folder: Path | str, every: int = 50_000, episodes: int = 8) -> None:
        super().__init__()
        self.folder, self.every, self.episodes = Path(folder), every, episodes
        self._next = 0

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self.every

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self.every
            self._draw()
        return True

    def _on_training_end(self) -> None:
        self._draw()

    def _draw(self) -> None:
        env: Any = self.training_env
        while not isinstance(env, Dl2cVecEnv):
            env = env.venv
        masked = _is_masked(self.model)
        seen = episodes_of(self._act, env.source, self.episodes, FIRST_SEED, masked, **env.manifest.options)
        title = f"{env.manifest.name} after {self.num_timesteps:,} steps"
        figure = episode_figure(model_of(seen[0]), [track_of(e) for e in seen], title)
        save(figure, self.folder / f"{self.num_timesteps}.png")

    def _act(self, observations: NDArray[Any], masks: Masks) -> NDArray[Any]:
        model: Any = self.model
        scaled = model.get_vec_normalize_env()
        given = observations if scaled is None else scaled.normalize_obs(observations)
        kept = {"action_masks": masks} if _is_masked(model) else {}
        return model.predict(given, deterministic=True, **kept)[0]


def _is_masked(model: Any) -> bool:
    """Whether its policy takes masks."""
    return "sb3_contrib" in type(model.policy).__module__
