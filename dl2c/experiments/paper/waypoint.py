"""Test 3: reach a waypoint before a deadline, with masks and without, learned and not.

Every policy is measured alike: a request whose guard fails ends the episode without success
(`on_blocked=terminate`), so an unmasked policy succeeds only if it has learned the guards.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.experiments.paper.closed_forms import Course, fastest_time, guarded_drive
from dl2c.experiments.paper.forced import initial_states
from dl2c.training.evaluation import FIRST_SEED, outcomes
from dl2c.training.run import Algorithm, Checked, Settings

MODEL = "example:waypoint"
STRICT: dict[str, Any] = {"on_blocked": "terminate"}

LESSONS: dict[str, Any] = {"on_blocked": "fallback", "blocked_penalty": -1000.0}
"""How the unmasked policy learns: such a request costs 1000, and the episode goes on with an enabled run."""


@dataclass(frozen=True, slots=True)
class Driven:
    """Episodes of one policy, with its evaluations while it was trained. `optimum` is the time of the only
    drive that the guards admit with the model's decision times, `infimum` that of all runs of the model.
    """

    name: str
    masked: bool
    seed: int | None
    success: NDArray[np.bool_]
    violated: NDArray[np.bool_]
    blocked: NDArray[np.bool_]
    time: NDArray[np.float64]
    optimum: NDArray[np.float64]
    infimum: NDArray[np.float64]
    policy: Path | None = None
    curve: Sequence[Checked] = ()

    def of_optimum(self) -> NDArray[np.float64]:
        """Travel times of the successful episodes, each relative to its optimum."""
        return self.time[self.success] / self.optimum[self.success]

    def of_infimum(self) -> NDArray[np.float64]:
        """Likewise, relative to the fastest run of the model."""
        return self.time[self.success] / self.infimum[self.success]


def driven(
    name: str, actor: str | Path, masked: bool, episodes: int, seed: int | None = None, **known: Any
) -> Driven:
    """Measure a policy in so many episodes, the same for all policies."""
    found = outcomes(actor, MODEL, episodes, FIRST_SEED, masked, **STRICT)
    course = course_of(initial_states(MODEL, episodes, FIRST_SEED, **STRICT))
    optimum, infimum = guarded_drive(course).time, fastest_time(course)
    measured = (found.success, found.violated, found.blocked, found.time, optimum, infimum)
    return Driven(name, masked, seed, *measured, **known)


def learned(algo: Algorithm, seed: int, settings: Settings, episodes: int, folder: Path) -> Driven:
    """Train a policy and measure it."""
    from dl2c.training.learning import train

    masked = algo == "maskable-ppo"
    name = "MaskablePPO" if masked else "PPO"
    options = STRICT if masked else LESSONS
    run = train(MODEL, algo, seed=seed, directory=folder, settings=settings, whole=True, **options)
    return driven(name, folder, masked, episodes, seed, policy=folder, curve=run.evaluations)


def course_of(states: Sequence[dict[str, float]]) -> Course:
    """Initial states as the closed forms take them."""
    x = {name: np.array([s[name] for s in states]) for name in states[0]}
    return Course(x["xg"] - x["GDelta"] - x["xr"], x["ep"], x["A"], x["b"], x["Vmax"])
