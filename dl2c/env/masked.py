"""Masks inside observations, where RLlib and TorchRL look for them."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dl2c.env.single import Dl2cEnv

Observation: TypeAlias = dict[str, NDArray[Any]]


class MaskedObservations(gym.Wrapper[Any, Any, Any, Any]):
    """Observations `{"observations": ..., "action_mask": ...}` of an environment with discrete decisions.

    `action_mask` has one float32 entry for each alternative, as `info["action_mask"]`: 1 where it has a
    run. Raises `ValueError` for a model without discrete decisions.
    """

    def __init__(self, env: Dl2cEnv) -> None:
        super().__init__(env)
        if not env.manifest.choices:
            raise ValueError(f"{env.manifest.name} has no discrete decisions, so there is nothing to mask")
        alternatives = len(env.action_masks())
        self.observation_space = spaces.Dict(
            {
                "observations": env.observation_space,
                "action_mask": spaces.Box(0.0, 1.0, (alternatives,), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As the environment's."""
        obs, info = self.env.reset(seed=seed, options=options)
        return _with_mask(obs, info), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """As the environment's."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        return _with_mask(obs, info), float(reward), terminated, truncated, info


def _with_mask(obs: NDArray[Any], info: dict[str, Any]) -> Observation:
    return {"observations": obs, "action_mask": info["action_mask"].astype(np.float32)}


def env_creator(config: Mapping[str, Any]) -> "gym.Env[Any, Any]":
    """An environment for RLlib: `register_env("waypoint", env_creator)`, then
    `config.environment("waypoint", env_config={"model": "model.kyx", ...})`.

    `config` holds `model` and the options of `dl2c.make`; with `masked=True` observations hold the
    action mask. Workers build the model from its text, or take it from the cache.
    """
    given = dict(config)
    masked = given.pop("masked", False)
    env = Dl2cEnv(given.pop("model"), **given)
    return MaskedObservations(env) if masked else env
