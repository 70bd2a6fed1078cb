"""Estimates from several seeds."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dl2c.training.evaluation import NORMAL, mean, rate
from dl2c.training.run import Estimate

STUDENT = (math.nan, 12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622)
"""Half the width of a two-sided 95 % interval of Student's distribution, by degrees of freedom."""


def rate_over_seeds(hits: Sequence[NDArray[np.bool_]]) -> Estimate:
    """The mean rate of several policies, with the wider of two 95 % intervals: Wilson's of all episodes,
    which knows how few they are, and Student's of the seeds' rates, which knows how much they differ.
    """
    pooled = rate(np.concatenate(hits))
    low, high = _between([float(h.mean()) for h in hits])
    return Estimate(pooled.value, max(0.0, min(pooled.low, low)), min(1.0, max(pooled.high, high)))


def mean_over_seeds(values: Sequence[NDArray[np.float64]]) -> Estimate:
    """The mean over all episodes, with the wider of their normal interval and Student's of the seeds."""
    pooled = mean(np.concatenate(values))
    if math.isnan(pooled.value):
        return pooled
    low, high = _between([float(v.mean()) for v in values if len(v)])
    return Estimate(pooled.value, min(pooled.low, low), max(pooled.high, high))


def _between(means: Sequence[float]) -> tuple[float, float]:
    """Student's interval of the means of seeds; empty for a single one."""
    n = len(means)
    if n < 2:
        return math.inf, -math.inf
    quantile = STUDENT[n - 1] if n <= len(STUDENT) else NORMAL
    centre, half = float(np.mean(means)), quantile * float(np.std(means, ddof=1)) / math.sqrt(n)
    return centre - half, centre + half
