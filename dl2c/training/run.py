"""What goes into a training and what comes out of it, as data."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from math import isnan
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from dl2c.diagnostics import Mistake

Algorithm: TypeAlias = Literal["ppo", "maskable-ppo", "sac"]
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)

RUN, TEXT = "run.json", "model.kyx"
PROOF, CERTIFICATE, UNPROVED = "proof.json", "certificate.json", "unproved"
"""In the folder of a training: what was asked for and what came of it, and the text of the model."""

MOST_BYTES = 64 * 1024**2
"""A longer `run.json` is not read."""


class TrainingError(Mistake):
    """A training that cannot be done as it is wanted; the message says why."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How to train; None is the default of the algorithm (`dl2c.training.hyper`).

    `hyper` holds hyperparameters by the names of Stable-Baselines3, and `net_arch`, `activation`,
    `schedule`. With `normalize` observations are normalised by VecNormalize, whose statistics go on
    changing; else by those of a random policy. Every `eval_every` steps the policy is evaluated in
    `eval_episodes` episodes, in environments with `eval_options` over the other options; every
    `checkpoint_every` steps all is saved; 0: never. `threads` is torch's, for the whole process: networks
    this small are much quicker on one.
    """

    steps: int | None = None
    n_envs: int | None = None
    hyper: Mapping[str, Any] = field(default_factory=dict[str, Any])
    normalize: bool = False
    eval_every: int = 0
    eval_episodes: int = 100
    eval_options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    checkpoint_every: int = 0
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
class Estimate:
    """A value with its 95 % interval; all NaN if there is nothing to estimate from."""

    value: float
    low: float
    high: float

    def shown(self, form: str, nothing: str = "-") -> str:
        """`value [low, high]`, each in that format; the value alone where there is no interval."""
        if isnan(self.value):
            return nothing
        ends = "" if isnan(self.low) else f" [{self.low:{form}}, {self.high:{form}}]"
        return f"{self.value:{form}}{ends}"


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a policy achieved. `success`, `violations` and `blocked` are fractions of the episodes.

    A violation is an episode in which a @safety predicate failed; blocked is one in which a request
    blocked, whether that ended it or not. `travel_time` is the mean duration of the successful episodes in
    seconds.
    """

    episodes: int
    success: Estimate
    violations: Estimate
    blocked: Estimate
    travel_time: Estimate
    episode_return: Estimate


@dataclass(frozen=True, slots=True)
class Checked:
    """An evaluation during the training, after so many steps."""

    steps: int
    found: Evaluation


@dataclass(frozen=True, slots=True)
class Run:
    """A training: the saved policy, its learning curve, its evaluations, and how long it took so far."""

    policy: Path
    curve: tuple[Point, ...]
    seconds: float
    evaluations: tuple[Checked, ...] = ()
    interrupted: bool = False


@dataclass(frozen=True, slots=True)
class Given:
    """What was asked for, complete: that of `run.json`, from which a training can go on."""

    model: str
    algo: Algorithm
    seed: int
    options: Mapping[str, Any]
    settings: Settings

    def content(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


Progress: TypeAlias = Callable[[Point], None]
"""Is told about every round of experience."""
