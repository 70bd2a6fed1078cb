"""Test 2: forced acceleration. Nothing is learned; the end of every episode is known in closed form."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.env.opening import source_of
from dl2c.env.single import Dl2cEnv
from dl2c.experiments.paper.closed_forms import violation_time
from dl2c.training.evaluation import FIRST_SEED, flat_environments, outcomes

MODEL = "example:forced_acceleration"
STRICT: dict[str, Any] = {"tolerance": 0}
"""The end is compared with mathematics, so predicates are not relaxed."""


@dataclass(frozen=True, slots=True)
class Forced:
    """What episodes of one seed did: the times at which they ended and were predicted to end, in seconds,
    how many steps they took, and in how many the safety predicate failed.
    """

    seed: int
    ended: NDArray[np.float64]
    predicted: NDArray[np.float64]
    steps: NDArray[np.float64]
    violated: NDArray[np.bool_]

    @property
    def error(self) -> float:
        """The largest difference between an end and its prediction, relative to it."""
        return float((abs(self.ended - self.predicted) / self.predicted).max())


@dataclass(frozen=True, slots=True)
class Approach:
    """One episode in detail, for the figure: times, states after each step, constants."""

    times: list[float]
    rows: list[dict[str, float]]
    predicted: float


def forced(seed: int, episodes: int) -> Forced:
    """So many episodes, the first of them seeded `FIRST_SEED + 1000*seed`."""
    first = FIRST_SEED + 1000 * seed
    states = initial_states(MODEL, episodes, first, **STRICT)
    x = {name: np.array([s[name] for s in states]) for name in states[0]}
    found = outcomes("first", MODEL, episodes, first, True, **STRICT)
    predicted = violation_time(x["xo"] - x["x"], x["v"], x["A"], x["b"])
    return Forced(seed, found.time, predicted, np.ceil(found.time / x["ep"]), found.violated)


def initial_states(model: str, episodes: int, seed: int, **options: Any) -> list[dict[str, float]]:
    """Variables and constants with which the episodes of `outcomes` begin."""
    env = flat_environments(model, episodes, **options)
    env.reset(seed=seed)
    states = [env.state(i) for i in range(episodes)]
    env.close()
    return states


def approach(state: dict[str, float]) -> Approach:
    """The episode that begins at a state."""
    env = Dl2cEnv(source_of(MODEL), **STRICT)
    env.reset(seed=0, options={"state": state})
    times, rows, ended = [0.0], [env.state], False
    while not ended:
        _, _, terminated, truncated, info = env.step(0)
        times.append(info["time"])
        rows.append(env.state)
        ended = terminated or truncated
    env.close()
    x = rows[0]
    numbers = (np.array(n) for n in (x["xo"] - x["x"], x["v"], x["A"], x["b"]))
    return Approach(times, rows, float(violation_time(*numbers)))
