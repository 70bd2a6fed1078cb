"""Draw initial states from a plan in Python: the reference for the generated sampler."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dl2c.sampling.arrays import Floats, completed, holds, uniform
from dl2c.sampling.tables import SampleBlock, SampleChart, SamplingPlan, by_chance

LARGEST_BATCH = 2**16


def draw(plan: SamplingPlan, rng: np.random.Generator) -> dict[str, float]:
    """One initial state: a double for each of `plan.names`."""
    return {name: float(column[0]) for name, column in draw_many(plan, rng, 1).items()}


def draw_many(plan: SamplingPlan, rng: np.random.Generator, count: int) -> dict[str, Floats]:
    """`count` initial states: for each of `plan.names` an array of shape (count,)."""
    columns: dict[str, Floats] = {}
    for block in plan.blocks:
        columns |= _of_block(block, plan.names, rng, count)
    return {name: columns[name] for name in plan.names}


def _of_block(
    block: SampleBlock, wanted: Sequence[str], rng: np.random.Generator, count: int
) -> dict[str, Floats]:
    first = block.charts[0]
    names = [n for n in (*first.free, *dict(first.between), *dict(first.definitions)) if n in wanted]
    found: list[dict[str, Floats]] = []
    have = 0
    while names and have < count:
        expected = (count - have) / block.estimated_acceptance
        batch = _accepted(block, names, rng, int(min(1.1 * expected + 16, LARGEST_BATCH)))
        found.append(batch)
        have += len(batch[names[0]])
    return {name: np.concatenate([b[name] for b in found])[:count] for name in names}


def _accepted(
    block: SampleBlock, names: Sequence[str], rng: np.random.Generator, count: int
) -> dict[str, Floats]:
    """What is accepted of `count` tries."""
    weights = np.array([box.weight for box in block.boxes])
    chosen = rng.choice(len(block.boxes), size=count, p=weights / weights.sum())
    used = np.array([box.chart for box in block.boxes])[chosen]
    parts = [
        _of_chart(block, chart, chosen[used == k], rng)
        for k, chart in enumerate(block.charts)
        if (used == k).any()
    ]
    order = rng.permutation(sum(len(p[names[0]]) for p in parts))
    return {name: np.concatenate([p[name] for p in parts])[order] for name in names}


def _of_chart(
    block: SampleBlock, chart: SampleChart, chosen: NDArray[np.int64], rng: np.random.Generator
) -> dict[str, Floats]:
    """What is accepted of one try in each of the chosen boxes."""
    boxes, count = [block.boxes[int(k)] for k in chosen], len(chosen)
    lows, highs = np.array([b.low for b in boxes]), np.array([b.high for b in boxes])
    columns = {n: uniform(lows[:, k], highs[:, k], count, rng) for k, n in enumerate(chart.free)}
    columns |= {n: (columns[n] + far) - far for n, far in chart.grid.items()}
    columns = completed(columns, (*chart.between, *chart.definitions), count)
    kept = by_chance(chart, np.array([b.squared_density for b in boxes]), columns, count, rng)
    kept &= holds(chart.acceptance, columns, count)
    return {name: column[kept] for name, column in columns.items()}
