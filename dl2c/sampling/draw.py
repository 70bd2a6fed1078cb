"""Draw initial states from a plan in Python: the reference for the generated sampler."""

import numpy as np

from dl2c.sampling.arrays import Floats, completed, holds, uniform
from dl2c.sampling.plan import SamplingPlan

LARGEST_BATCH = 2**16


def draw(plan: SamplingPlan, rng: np.random.Generator) -> dict[str, float]:
    """One initial state: a double for each of `plan.names`."""
    return {name: float(column[0]) for name, column in draw_many(plan, rng, 1).items()}


def draw_many(plan: SamplingPlan, rng: np.random.Generator, count: int) -> dict[str, Floats]:
    """`count` initial states: for each of `plan.names` an array of shape (count,)."""
    found: list[dict[str, Floats]] = []
    have = 0
    while have < count:
        expected = (count - have) / plan.estimated_acceptance
        batch = _accepted(plan, rng, int(min(1.1 * expected + 16, LARGEST_BATCH)))
        found.append(batch)
        have += len(batch[plan.names[0]]) if plan.names else count
    return {name: np.concatenate([b[name] for b in found])[:count] for name in plan.names}


def _accepted(plan: SamplingPlan, rng: np.random.Generator, count: int) -> dict[str, Floats]:
    """What is accepted of `count` tries."""
    weights = np.array([box.weight for box in plan.boxes])
    chosen = rng.choice(len(plan.boxes), size=count, p=weights / weights.sum())
    lows = np.array([box.low for box in plan.boxes])[chosen]
    highs = np.array([box.high for box in plan.boxes])[chosen]
    columns = {n: uniform(lows[:, k], highs[:, k], count, rng) for k, n in enumerate(plan.free)}
    columns = completed(columns, plan.definitions, count)
    accepted = holds(plan.acceptance, columns, count)
    return {name: columns[name][accepted] for name in plan.names}
