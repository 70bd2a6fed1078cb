"""How well a policy does: rates and means over fixed episodes, each with a 95 % interval."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from dl2c.env.actions import encoding, flat_format
from dl2c.env.infos import FAILURE, FIRST_PREDICATE, SUCCESS
from dl2c.env.opening import Model, open_library, source_of
from dl2c.env.vector import Dl2cVectorEnv
from dl2c.native.manifest import Manifest
from dl2c.training.policies import Policy, policy_of
from dl2c.training.run import Estimate, Evaluation

if TYPE_CHECKING:
    from dl2c.native.binding import Batch

NORMAL = 1.959963984540054
"""Half the width of a two-sided 95 % interval of the standard normal distribution."""

FIRST_SEED = 10**6
"""Episode k of an evaluation is seeded with this plus k: far from the seeds one trains with."""


Watch: TypeAlias = Callable[[Dl2cVectorEnv, NDArray[Any] | None, NDArray[np.bool_]], None]
"""Called where episodes have begun, without actions, and after each step with the actions (n, ...) and where
(n) the episode was not over before it.
"""


@dataclass(frozen=True, slots=True)
class Outcomes:
    """One entry per episode."""

    success: NDArray[np.bool_]
    violated: NDArray[np.bool_]
    blocked: NDArray[np.bool_]
    time: NDArray[np.float64]
    total: NDArray[np.float64]

    def evaluation(self) -> Evaluation:
        """Rates and means of these episodes."""
        return Evaluation(
            len(self.success),
            rate(self.success),
            rate(self.violated),
            rate(self.blocked),
            mean(self.time[self.success]),
            mean(self.total),
        )


def evaluate(
    policy: str | Path | Policy,
    model: Model,
    episodes: int = 200,
    seed: int = FIRST_SEED,
    masked: bool = True,
    watch: Watch | None = None,
    **options: Any,
) -> Evaluation:
    """Run a policy (see `policy_of`) for so many episodes, all at once; episode k is seeded `seed + k`.

    Raises what `Dl2cVectorEnv` raises.
    """
    return outcomes(policy, model, episodes, seed, masked, watch, **options).evaluation()


def outcomes(
    policy: str | Path | Policy,
    model: Model,
    episodes: int,
    seed: int,
    masked: bool,
    watch: Watch | None = None,
    **options: Any,
) -> Outcomes:
    """The single episodes of `evaluate`."""
    env = flat_environments(model, episodes, AutoresetMode.NEXT_STEP, **options)
    act = policy_of(policy, encoding(env.manifest), masked, seed)
    running = np.ones(episodes, np.bool_)
    found = _nothing_yet(episodes)
    observations, _ = env.reset(seed=seed)
    if watch is not None:
        watch(env, None, running)
    while running.any():
        actions = act(observations, env.action_masks())
        observations, rewards, terminated, truncated, _ = env.step(actions)
        found.total[running] += rewards[running]
        _note_step(found, env.batch, running)
        if watch is not None:
            watch(env, actions, running)
        if (ended := running & (terminated | truncated)).any():
            _note_ends(found, env.batch, ended, env.manifest)
            running &= ~ended
    env.close()
    return found


def flat_environments(
    model: Model, n: int, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP, **options: Any
) -> Dl2cVectorEnv:
    """Environments whose action space is no Dict."""
    source = source_of(model)
    action_format = flat_format(open_library(source, options).manifest)
    given: dict[str, Any] = options | {"action_format": action_format}
    return Dl2cVectorEnv(source, n, autoreset_mode=autoreset_mode, **given)


def _nothing_yet(n: int) -> Outcomes:
    none = np.zeros(n, np.bool_)
    return Outcomes(none, none.copy(), none.copy(), np.zeros(n), np.zeros(n))


def _note_step(found: Outcomes, batch: "Batch", running: NDArray[np.bool_]) -> None:
    """What the batch's arrays tell of a step; infos would take longer to make than to read."""
    found.violated[:] |= running & (batch.cost > 0)
    found.blocked[:] |= running & batch.blocked


def _note_ends(found: Outcomes, batch: "Batch", ended: NDArray[np.bool_], manifest: Manifest) -> None:
    safety = [FIRST_PREDICATE + i for i, p in enumerate(manifest.predicates) if p.category == "safety"]
    unsafe = (batch.status == FAILURE) & np.isin(batch.reason, safety)
    found.violated[ended & unsafe] = True
    found.success[ended] = batch.status[ended] == SUCCESS
    found.time[ended] = batch.time[ended]


def rate(hits: NDArray[np.bool_]) -> Estimate:
    """A fraction with its Wilson interval."""
    n = len(hits)
    if n == 0:
        return Estimate(math.nan, math.nan, math.nan)
    p, z2 = float(hits.mean()), NORMAL**2
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = NORMAL * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return Estimate(p, max(0.0, centre - half), min(1.0, centre + half))


def mean(values: NDArray[np.float64]) -> Estimate:
    """A mean with its normal interval; without one (NaN) for fewer than two values."""
    if len(values) == 0:
        return Estimate(math.nan, math.nan, math.nan)
    centre = float(values.mean())
    half = NORMAL * float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return Estimate(centre, centre - half, centre + half)
