"""Test 1: an agent that is asked to be safe and nothing else.

On a line with a discrete choice, and in the paper's configuration: in the plane, with a Dict of a choice and
four continuous decisions that is flattened to a Box, and 10 000 steps of PPO with its default settings.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dl2c.env.actions import encoding
from dl2c.training.evaluation import FIRST_SEED, flat_environments
from dl2c.training.policies import policy_of
from dl2c.training.run import Settings

LINE, PLANE = "example:paper/safe_lock", "example:paper/dict_to_box"


@dataclass(frozen=True, slots=True)
class Locked:
    """Episodes of one policy: in which a safety predicate failed, the speed at the end in m/s, the fraction
    of the second half of the steps that began at a standstill, and the reward per step.
    """

    model: str
    seed: int | None
    violated: NDArray[np.bool_]
    speed: NDArray[np.float64]
    standing: NDArray[np.float64]
    per_step: NDArray[np.float64]


def locked(model: str, policy: str | Path, episodes: int, seed: int | None = None) -> Locked:
    """Measure a policy in so many episodes, up to the step before the one that the time limit truncates."""
    env = flat_environments(model, episodes)
    act = policy_of(policy, encoding(env.manifest), False, FIRST_SEED)
    steps = env.manifest.options["max_episode_steps"] - 1
    column = [q.name for q in env.manifest.observations].index("v")
    observations, _ = env.reset(seed=FIRST_SEED)
    violated, total, speeds = np.zeros(episodes, np.bool_), np.zeros(episodes), [observations[:, column]]
    for _ in range(steps):
        observations, rewards, terminated, truncated, _ = env.step(act(observations, env.action_masks()))
        total += np.where(violated, 0, rewards)
        violated |= terminated | truncated
        speeds.append(observations[:, column])
    env.close()
    standing = (np.array(speeds[steps // 2 :]) == 0).mean(axis=0)
    return Locked(model, seed, violated, speeds[-1].astype(np.float64), standing, total / steps)


def learned(model: str, seed: int, settings: Settings, episodes: int, folder: Path) -> Locked:
    """Train with PPO and measure."""
    from dl2c.training.learning import train

    train(model, "ppo", seed=seed, directory=folder, settings=settings, whole=True)
    return locked(model, folder, episodes, seed)
