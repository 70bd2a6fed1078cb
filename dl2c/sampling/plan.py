"""From a precondition to tables for drawing initial states.

A model comes in; boxes, definitions and an acceptance test go out, or the reason that
its initial states cannot be drawn. The law is uniform on the set of states in which the
precondition holds: where equalities leave a curve or a surface of them, by its length or
area (up to the rounding slack of the test). Every accepted state satisfies the precondition
over the reals; only solved equalities can be off, by `error_bound`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.interval.arithmetic import Box, hull_of
from dl2c.interval.contract import contractor
from dl2c.ir.logic import conjunction, conjuncts, size, symbols
from dl2c.ir.model import TRUE, Formula, Model
from dl2c.paths.enabled import enabling
from dl2c.sampling.arrays import completed, holds, uniform
from dl2c.sampling.charts import Chart, inward
from dl2c.sampling.conditional import conditional
from dl2c.sampling.density import density_bound
from dl2c.sampling.draw import draw_many
from dl2c.sampling.equalities.root_of import RootOf
from dl2c.sampling.paving import Leaf, Root, pave
from dl2c.sampling.refusal import imprecise, too_long, unbounded_density, without_sample
from dl2c.sampling.running import NoErrorBound
from dl2c.sampling.support import Support, support_of, transcendental_calls
from dl2c.sampling.tables import (
    SampleBlock,
    SampleBox,
    SampleChart,
    SamplingPlan,
    by_chance,
    is_short,
    named,
    tested,
)
from dl2c.smt.precondition import Decision, Unknown, decide, diagnose

SEED = 20240229
PROBES = 256
"""Points in each box that guide the paving."""

TRIALS = 2**18
"""Points in all boxes together from which the acceptance is estimated."""

RARE = 0.1
"""Below this acceptance names are drawn between limits; below this part of states with a run, what runs
need becomes part of the precondition."""

DRAWS = 256
"""States drawn to estimate how many of them may have a run."""

PAVING_S = 2.0

COORDINATES = 2**24
"""Limit of points times names: with many names there are fewer points."""


@dataclass(frozen=True, slots=True)
class NoSampler:
    """Initial states cannot be drawn; `reset` then needs a state."""

    diagnostic: Diagnostic


def plan_sampling(
    model: Model, *, boxes: int = 64, time_limit_s: float = PAVING_S, decision: Decision | None = None
) -> SamplingPlan | NoSampler:
    """Tables for drawing initial states; in each block at most `boxes` boxes, or one for each chart.

    `decision` is what `decide(model)` said, where that is known already. The time limit bounds the
    paving, by as much work as takes about that long. Resets draw again where a state has
    no run; where hardly any state has one, what runs need is made part of the precondition.
    """
    decision = decide(model) if decision is None else decision
    plan = _planned(model, boxes, time_limit_s, decision)
    if isinstance(plan, NoSampler) or not _is_rare(_algebraic(enabling(model)), model, plan):
        return plan
    needed = _algebraic(enabling(model, exact=True))
    narrowed = replace(model, precondition=conjunction([model.precondition, needed]))
    other = _planned(narrowed, boxes, time_limit_s, decide(narrowed))
    return plan if isinstance(other, NoSampler) else other


def _algebraic(formula: Formula) -> Formula:
    return conjunction(c for c in conjuncts(formula) if not any(transcendental_calls(c)))


def _is_rare(condition: Formula, model: Model, plan: SamplingPlan) -> bool:
    """Whether few of the drawn states satisfy the condition, or states are too rare to tell."""
    if condition == TRUE:
        return False
    if plan.estimated_acceptance * TRIALS < DRAWS:
        return True
    columns = draw_many(plan, np.random.default_rng(SEED), DRAWS)
    fixed = {c.name: c.value for c in model.constants if c.value is not None}
    zeros = {v.name: Fraction(0) for v in model.variables if v.initial == "zero"}
    columns |= {name: np.full(DRAWS, float(value)) for name, value in (fixed | zeros).items()}
    return float(np.mean(holds(condition, columns, DRAWS))) < RARE


def _planned(model: Model, boxes: int, time_limit_s: float, decision: Decision) -> SamplingPlan | NoSampler:
    try:
        support = support_of(model, decision)
        sizes = [_length(charts) for charts in support.blocks]
        planned = [
            _better_block(support, charts, boxes, time_limit_s * size / sum(sizes))
            for charts, size in zip(support.blocks, sizes, strict=True)
        ]
    except CompileError as refusal:
        return NoSampler(refusal.diagnostics[0])
    if not all(block.estimated_acceptance > 0 for block, _ in planned):
        thin = without_sample(support.formula)
        return NoSampler(diagnose(decision) if isinstance(decision, Unknown) else thin)
    error_bound = max((error for _, error in planned), default=0.0)
    return SamplingPlan(
        names=model.sampled,
        precondition=model.precondition,
        blocks=tuple(block for block, _ in planned),
        certificate="witness" if error_bound > 0 else "exact",
        error_bound=error_bound,
        around=_around(support),
    )


def _length(charts: Sequence[Chart]) -> int:
    """How much time a block deserves."""
    return 1 + size(*(c.formula for c in charts))


def _better_block(
    support: Support, charts: Sequence[Chart], boxes: int, time_limit_s: float
) -> tuple[SampleBlock, float]:
    """With names drawn between limits where boxes alone are too few and that helps."""
    plain = _block(support, charts, boxes, time_limit_s)
    if plain[0].estimated_acceptance >= RARE:
        return plain
    narrowed = [conditional(c) or c for c in charts]
    if narrowed == list(charts):
        return plain
    other = _block(support, narrowed, boxes, time_limit_s)
    return max(plain, other, key=lambda found: found[0].estimated_acceptance)


def _block(
    support: Support, charts: Sequence[Chart], boxes: int, time_limit_s: float
) -> tuple[SampleBlock, float]:
    """The tables of a block, and a bound of the error of its defined names."""
    for k, chart in enumerate(charts):
        if _effort(chart) > 1:
            _tested(support, chart, (), k)  # raises before boxes are made, which takes longer
    leaves = pave([_root(chart) for chart in charts], boxes=boxes, time_limit_s=time_limit_s)
    if not leaves:
        raise CompileError(without_sample(support.formula))
    if not all(math.isfinite(leaf.density) for leaf in leaves):
        raise CompileError(unbounded_density(support.formula))
    tested = [_tested(support, chart, leaves, k) for k, chart in enumerate(charts)]
    most = min(TRIALS // max(map(_effort, charts)), COORDINATES // max(1, len(charts[0].box)))
    points = max(1, most // len(leaves))
    accepted = [
        leaf.mass * _accepted(charts[leaf.chart], tested[leaf.chart][0], leaf.box, leaf.density, points)
        for leaf in leaves
    ]
    total = math.fsum(leaf.mass for leaf in leaves)
    block = SampleBlock(
        charts=tuple(chart for chart, _ in tested),
        boxes=tuple(_sample_box(leaf, charts[leaf.chart], total) for leaf in leaves),
        estimated_acceptance=sum(accepted) / total,
    )
    return block, max(error for _, error in tested)


def _root(chart: Chart) -> Root:
    wanted = conjunction([chart.rest, *chart.bounds.values()])
    plain = named(chart, wanted, {})
    bound = density_bound(chart.measure)
    return Root(
        chart.formula,
        contractor(chart.formula),
        chart.box,
        chart.wide,
        frozenset(symbols(chart.measure.squared)),
        bound.steep,
        bound.density,
        lambda box, density: _accepted(chart, plain, box, density, max(16, PROBES // _effort(chart))),
    )


def _effort(chart: Chart) -> int:
    """How many times longer a draw takes than one without roots to be looked for: the square of a degree."""
    degrees = (len(d.coefficients) - 1 for _, d in chart.definitions if isinstance(d, RootOf))
    return max((degree**2 for degree in degrees), default=1)


def _accepted(chart: Chart, sample: SampleChart, box: Box, density: float, points: int) -> float:
    """The part of a box that is accepted, estimated from `points` points."""
    rng = np.random.default_rng(SEED)
    columns = {s.name: uniform(box[s].low, box[s].high, points, rng) for s in chart.free}
    columns = completed(columns, (*sample.between, *sample.definitions), points)
    largest = (density / chart.measure.scale) ** 2
    kept = by_chance(sample, np.full(points, largest), columns, points, rng)
    return float(np.mean(kept & holds(sample.acceptance, columns, points)))


def _around(support: Support) -> dict[str, tuple[float, float]]:
    free = {s for charts in support.blocks for chart in charts for s in chart.free}
    limits = {s.name: inward(item.bound) for s, item in support.items.items() if s in free}
    return {n: (i.low, i.high) for n, i in limits.items() if math.isfinite(i.low) and math.isfinite(i.high)}


def _tested(support: Support, chart: Chart, leaves: Sequence[Leaf], k: int) -> tuple[SampleChart, float]:
    """A chart with its test, and a bound of the error of its defined names."""
    own = [leaf.box for leaf in leaves if leaf.chart == k] or [chart.box]
    around = {s: hull_of(box[s] for box in own) for s in chart.box}
    try:
        sample, error = tested(chart, around, {s: item.bound for s, item in support.items.items()})
    except NoErrorBound:
        raise CompileError(imprecise(support.formula)) from None
    if not is_short(sample.acceptance):
        raise CompileError(too_long(support.formula))
    return sample, error


def _sample_box(leaf: Leaf, chart: Chart, total: float) -> SampleBox:
    limits = [leaf.box[s] for s in chart.free]
    return SampleBox(
        chart=leaf.chart,
        low=tuple(i.low for i in limits),
        high=tuple(i.high for i in limits),
        weight=leaf.mass / total,
        squared_density=(leaf.density / chart.measure.scale) ** 2,
    )
