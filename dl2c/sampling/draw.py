"""Draw initial states from a plan in Python: the reference for the generated sampler."""

import numpy as np
from numpy.typing import NDArray

from dl2c.sampling.arrays import Floats, completed, holds, uniform
from dl2c.sampling.plan import SampleChart, SamplingPlan, by_chance

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
    used = np.array([box.chart for box in plan.boxes])[chosen]
    parts = [
        _of_chart(plan, chart, chosen[used == k], rng)
        for k, chart in enumerate(plan.charts)
        if (used == k).any()
    ]
    order = rng.permutation(sum(len(p[plan.names[0]]) for p in parts)) if plan.names else None
    return {name: np.concatenate([p[name] for p in parts])[order] for name in plan.names}


def _of_chart(
    plan: SamplingPlan, chart: SampleChart, chosen: NDArray[np.int64], rng: np.random.Generator
) -> dict[str, Floats]:
    """What is accepted of one try in each of the chosen boxes."""
    boxes, count = [plan.boxes[int(k)] for k in chosen], len(chosen)
    lows, highs = np.array([b.low for b in boxes]), np.array([b.high for b in boxes])
    columns = {n: uniform(lows[:, k], highs[:, k], count, rng) for k, n in enumerate(chart.free)}
    columns = completed(columns, chart.definitions, count)
    kept = by_chance(chart, np.array([b.squared_density for b in boxes]), columns, count, rng)
    kept &= holds(chart.acceptance, columns, count)
    return {name: columns[name][kept] for name in plan.names}
