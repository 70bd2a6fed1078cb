"""What goes into a training and what comes out of it, as data."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

Algorithm: TypeAlias = Literal["ppo", "maskable-ppo"]


@dataclass(frozen=True, slots=True)
class Settings:
    """PPO's settings, in Stable-Baselines3's terms; `width` is the size of two hidden layers.

    `threads` is torch's, for the whole process: networks this small are much quicker on one.
    """

    steps: int = 400_000
    n_envs: int = 64
    n_steps: int = 128
    batch_size: int = 1024
    n_epochs: int = 6
    learning_rate: float = 1e-3
    gamma: float = 0.995
    gae_lambda: float = 0.95
    ent_coef: float = 0.003
    width: int = 64
    threads: int = 1


@dataclass(frozen=True, slots=True)
class Point:
    """The episodes that ended during one round of experience: how many succeeded, violated a safety
    predicate, met a request that blocked, as fractions, and their mean return.
    """

    steps: int
    episodes: int
    success: float
    violations: float
    blocked: float
    episode_return: float
    steps_per_second: float


@dataclass(frozen=True, slots=True)
class Run:
    """A finished training: the saved policy and its learning curve."""

    policy: Path
    curve: tuple[Point, ...]
    seconds: float


Progress: TypeAlias = Callable[[Point], None]
"""Is told about every round of experience."""
