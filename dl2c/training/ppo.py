"""Training with PPO and MaskablePPO of Stable-Baselines3 on native environments.

Imports torch: import this module only where training happens.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from dl2c.env.actions import action_space
from dl2c.env.interface import interface_of
from dl2c.env.opening import Model, source_of
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.policy.files import write_policy
from dl2c.training.policies import PolicyError
from dl2c.training.run import Algorithm, Point, Progress, Run, Settings
from dl2c.training.saved import policy_data

SAMPLED_STEPS = 200
"""Steps of every environment from which observations are standardised."""


class Standardised(BaseFeaturesExtractor):
    """Observations shifted by `center` and divided by `scale`, one number of each per entry.

    Part of the policy, so that a saved policy takes the environment's own observations.
    """

    def __init__(
        self, observation_space: spaces.Box, center: Sequence[float], scale: Sequence[float]
    ) -> None:
        super().__init__(  # pyright: ignore[reportUnknownMemberType] # Space without its parameter
            observation_space, len(center)
        )
        self._center = torch.as_tensor(center, dtype=torch.float32)
        self._scale = torch.as_tensor(scale, dtype=torch.float32)

    @property
    def moments(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Center and scale."""
        return self._center, self._scale

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Standardised observations, of the same shape."""
        return (observations - self._center) / self._scale


def train(
    model: Model,
    algo: Algorithm = "ppo",
    *,
    seed: int = 0,
    directory: Path = Path("build/train"),
    settings: Settings | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Run:
    """Train a policy and write to `directory`: `policy.zip`, `policy.json` with `policy.npz`, `run.json`, and
    the model's text `model.kyx`.

    `options` are those of the environment. Raises what `Dl2cVecEnv` raises, and `PolicyError` for
    MaskablePPO on continuous actions.
    """
    chosen = settings or Settings()
    torch.set_num_threads(chosen.threads)
    source = source_of(model)
    env = Dl2cVecEnv(source, chosen.n_envs, **options)
    if algo == "maskable-ppo" and env.manifest.inputs:
        raise PolicyError("maskable-ppo needs discrete decisions only; use ppo")
    watch = _Watch(env, progress)
    moments = _moments(env, seed)
    learner = _learner(
        algo, VecNormalize(VecMonitor(env), norm_obs=False, gamma=chosen.gamma), moments, chosen, seed
    )
    started = time.perf_counter()
    learner.learn(chosen.steps, callback=watch)
    seconds = time.perf_counter() - started
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "model.kyx").write_text(source.text, encoding="utf-8", errors="surrogateescape")
    learner.save(directory / "policy.zip")
    data = policy_data(learner, interface_of(env.manifest), env.manifest, [], algo == "maskable-ppo")
    write_policy(data, directory)
    env.close()
    run = Run(directory / "policy.zip", tuple(watch.curve), seconds)
    _write(run, directory / "run.json", algo, seed, chosen, env)
    return run


def _moments(env: Dl2cVecEnv, seed: int) -> dict[str, list[float]]:
    """Mean and deviation of each observation entry while a random policy acts, for `Standardised`."""
    space: Any = batch_space(action_space(env.encoding), env.num_envs)
    space.seed(seed)
    env.seed(seed)
    seen = [env.reset()]
    for _ in range(SAMPLED_STEPS):
        env.step_async(space.sample())
        seen.append(env.step_wait()[0])
    rows = np.concatenate(seen).astype(np.float64)
    deviation = rows.std(axis=0)
    return {"center": rows.mean(axis=0).tolist(), "scale": np.where(deviation > 0, deviation, 1).tolist()}


def _learner(
    algo: Algorithm, env: VecNormalize, moments: dict[str, list[float]], settings: Settings, seed: int
) -> Any:
    kind: Any = MaskablePPO if algo == "maskable-ppo" else PPO
    return kind(
        "MlpPolicy",
        env,
        learning_rate=_falling(settings.learning_rate),
        n_steps=settings.n_steps,
        batch_size=min(settings.batch_size, settings.n_steps * settings.n_envs),
        n_epochs=settings.n_epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        ent_coef=settings.ent_coef,
        policy_kwargs={
            "net_arch": [settings.width, settings.width],
            "features_extractor_class": Standardised,
            "features_extractor_kwargs": moments,
        },
        seed=seed,
        device="cpu",
    )


def _falling(rate: float) -> Callable[[float], float]:
    """From `rate` down to 0, given the fraction of the training that is left."""
    return lambda left: rate * left


def _write(run: Run, path: Path, algo: Algorithm, seed: int, settings: Settings, env: Dl2cVecEnv) -> None:
    content = {
        "model": env.manifest.name,
        "algo": algo,
        "seed": seed,
        "options": env.manifest.options,
        "settings": asdict(settings),
        "seconds": run.seconds,
        "curve": [asdict(point) for point in run.curve],
    }
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


class _Watch(BaseCallback):
    """Collects a point of the learning curve per round of experience."""

    def __init__(self, env: Dl2cVecEnv, progress: Progress | None) -> None:
        super().__init__()
        self.curve: list[Point] = []
        self._env = env
        self._progress = progress
        self._blocked = np.zeros(env.num_envs, np.bool_)
        self._ended: list[tuple[bool, bool, bool, float]] = []
        self._started = 0.0

    def _on_training_start(self) -> None:
        self._started = time.perf_counter()

    def _on_step(self) -> bool:
        self._blocked |= self._env.batch.blocked
        dones: NDArray[np.bool_] = self.locals["dones"]
        for i in np.flatnonzero(dones).tolist():
            info = self.locals["infos"][i]
            blocked, total = bool(self._blocked[i]), float(info["episode"]["r"])
            self._ended.append((info["is_success"], info["cost"] > 0, blocked, total))
        self._blocked &= ~dones
        return True

    def _on_rollout_end(self) -> None:
        n = len(self._ended)
        rates = np.mean(self._ended, axis=0) if n else np.full(4, np.nan)
        success, violations, blocked, total = (float(r) for r in rates)
        speed = self.num_timesteps / (time.perf_counter() - self._started)
        self.curve.append(Point(self.num_timesteps, n, success, violations, blocked, total, speed))
        self._ended.clear()
        if self._progress is not None:
            self._progress(self.curve[-1])
