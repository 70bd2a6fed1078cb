"""Means of what was measured a few times, with their intervals of 95 %."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

QUANTILES = {3: 4.303, 5: 2.776, 7: 2.447, 9: 2.306}
"""97.5 % of Student's t, by the number of values."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean with its ends."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:7.3f} [{self.low:.3f}, {self.high:.3f}]"


def interval(values: Sequence[float]) -> Interval:
    """Of as many values as `QUANTILES` knows."""
    middle, half = fmean(values), QUANTILES[len(values)] * stdev(values) / math.sqrt(len(values))
    return Interval(middle, middle - half, middle + half)


def ratio_interval(here: Sequence[float], there: Sequence[float]) -> Interval:
    """How many times as much in rounds that belong together: the geometric mean."""
    logs = interval([math.log(a / b) for a, b in zip(here, there, strict=True)])
    return Interval(math.exp(logs.mean), math.exp(logs.low), math.exp(logs.high))
