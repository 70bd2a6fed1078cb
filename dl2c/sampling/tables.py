"""The tables that initial states are drawn from: charts by names, boxes, and a test that proves what is kept.

A chart and the range of its draws come in; names, terms and the test go out. Where linear equalities have
exact solutions in doubles, names are drawn on a grid that has them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import Literal

import numpy as np

from dl2c.interval.arithmetic import Box, Interval
from dl2c.ir.logic import conjunction, conjuncts, limits_of, subterms
from dl2c.ir.model import ONE, Add, Bound, Compare, Formula, Number, Sub, Symbol, Term
from dl2c.sampling.acceptance import acceptance
from dl2c.sampling.arrays import Bools, Columns, Floats, values
from dl2c.sampling.charts import Chart
from dl2c.sampling.equalities.root_of import Definition
from dl2c.sampling.grid import Grid, grid_of, rounding

LONGEST_TEST = 20_000
"""How many numbers, names and operations a test may have; compilers take long over longer ones."""


@dataclass(frozen=True, slots=True)
class SampleChart:
    """`free` names are drawn, `between` and `definitions` computed in order from them. A draw is kept if
    `acceptance` holds in doubles, and then with probability sqrt(`squared_density` / that of its box).
    Drawn names of `grid` are rounded by adding and subtracting a number. Over the reals the chart is
    `region` without its boundary."""

    free: tuple[str, ...]
    grid: Mapping[str, float]
    between: tuple[tuple[str, Term], ...]
    definitions: tuple[tuple[str, Definition], ...]
    acceptance: Formula
    squared_density: Term
    region: Formula


@dataclass(frozen=True, slots=True)
class SampleBox:
    """A box of one chart of a block: limits of the chart's free names, in their order. `weight` is its
    probability, `squared_density` the largest value of the chart's in it."""

    chart: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    weight: float
    squared_density: float


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Names that are drawn independently of all others. `estimated_acceptance` of their draws are kept."""

    charts: tuple[SampleChart, ...]
    boxes: tuple[SampleBox, ...]
    estimated_acceptance: float


@dataclass(frozen=True, slots=True)
class SamplingPlan:
    """How to draw a state in which `precondition` holds: for each block in turn, until a draw is accepted,

    choose a box by weight; draw each free name of its chart as `low + u * (high - low)`, u uniform on
    [0, 1), not above `high`, and round it to the chart's grid; compute the definitions; where the plan is
    weighted, draw another u and start again unless `u * u * box.squared_density <= chart.squared_density`;
    accept if the chart's `acceptance` holds in doubles, where an atom with an undefined subterm is false;
    else start again.
    `names` are all names of the state, `Model.sampled`. `certificate` is "exact" where the doubles
    satisfy the whole precondition, "witness" where a state does whose defined names differ by at most
    `error_bound`.
    """

    names: tuple[str, ...]
    precondition: Formula
    blocks: tuple[SampleBlock, ...]
    certificate: Literal["exact", "witness"]
    error_bound: float
    around: Mapping[str, tuple[float, float]]
    """The doubles inside the bounds of each free name, where it has any."""

    @property
    def estimated_acceptance(self) -> float:
        """Acceptance rate of the worst block."""
        return min((b.estimated_acceptance for b in self.blocks), default=1.0)

    @property
    def charts(self) -> tuple[SampleChart, ...]:
        """Those of all blocks."""
        return tuple(c for block in self.blocks for c in block.charts)

    @property
    def boxes(self) -> tuple[SampleBox, ...]:
        """Those of all blocks."""
        return tuple(b for block in self.blocks for b in block.boxes)

    @property
    def weighted(self) -> bool:
        """Whether draws are kept by chance."""
        return any(c.squared_density != ONE for c in self.charts)


def tested(chart: Chart, around: Box, bounds: Mapping[Symbol, Bound]) -> tuple[SampleChart, float]:
    """A chart with its test, and a bound of the error of its defined names; draws lie in `around`.

    Raises `NoErrorBound`.
    """
    exact = [s for s, _ in chart.between]
    test = acceptance(chart.rest, chart.definitions, chart.bounds, around, exact)
    equalities = [c for c in conjuncts(chart.formula) if isinstance(c, Compare) and c.op == "="]
    rounded = any(test.errors[s] for s, _ in chart.definitions)
    if rounded and (grid := grid_of(chart.definitions, equalities, around)):
        rest = conjunction([chart.rest, *(limit for s in grid for limit in limits_of(s, bounds[s]))])
        wider = {s: _widened(i, grid[s]) if s in grid else i for s, i in around.items()}
        test = acceptance(rest, chart.definitions, chart.bounds, wider, exact, grid)
        return named(chart, test.formula, grid), 0.0
    error = max((test.errors[s] for s, _ in chart.definitions), default=0.0)
    return named(chart, test.formula, {}), error


def _widened(around: Interval, exponent: int) -> Interval:
    """The interval, wider by the largest error of rounding to the grid on either side."""
    if around.low == around.high:
        return around
    step = math.ldexp(1.0, exponent)
    return Interval(around.low - step, around.high + step)


def named(chart: Chart, test: Formula, grid: Grid) -> SampleChart:
    """A chart by names, with a test of what is drawn."""
    return SampleChart(
        free=tuple(s.name for s in chart.free),
        grid={s.name: rounding(k) for s, k in grid.items() if s in chart.free},
        between=tuple((s.name, _rounded(t, grid.get(s))) for s, t in chart.between),
        definitions=tuple((s.name, t) for s, t in chart.definitions),
        acceptance=test,
        squared_density=chart.measure.squared,
        region=chart.formula,
    )


def _rounded(term: Term, exponent: int | None) -> Term:
    if exponent is None:
        return term
    far = Number(Fraction(rounding(exponent)))
    return Sub(Add(term, far), far)


def is_short(formula: Formula) -> bool:
    """Whether a test has at most `LONGEST_TEST` numbers, names and operations."""
    return sum(1 for _ in islice(subterms(formula), LONGEST_TEST + 1)) <= LONGEST_TEST


def by_chance(
    chart: SampleChart, largest: Floats, columns: Columns, count: int, rng: np.random.Generator
) -> Bools:
    """Which draws their density keeps, whether accepted or not; `largest` is that of each draw's box."""
    if chart.squared_density == ONE:
        return np.full(count, True)
    u = rng.random(count)
    return u * u * largest <= values(chart.squared_density, columns, count)
