"""From a precondition to tables for drawing initial states.

A model comes in; boxes, definitions and an acceptance test go out, or the reason that
its initial states cannot be drawn. The law is uniform: names that equalities determine
are computed from the others, which are uniform on the set where the precondition holds
(up to the rounding slack of the test). Every accepted state satisfies the precondition
over the reals; only solved equalities can be off, by `error_bound`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.interval.arithmetic import Box, hull_of
from dl2c.ir.logic import conjunction
from dl2c.ir.model import Formula, Model, Symbol, Term
from dl2c.sampling.acceptance import Acceptance, Unbounded, acceptance
from dl2c.sampling.arrays import completed, holds, uniform
from dl2c.sampling.paving import Leaf, pave
from dl2c.sampling.problem import Problem, problem_of
from dl2c.sampling.refusal import no_error_bound, without_sample
from dl2c.smt.precondition import Decision, Unknown, decide, diagnose

SEED = 20240229
PROBES = 256
"""Points in each box that guide the paving."""

TRIALS = 2**18
"""Points in all boxes together from which the acceptance is estimated."""

COORDINATES = 2**24
"""Numbers that all these points may have together: states of many names get fewer points."""


@dataclass(frozen=True, slots=True)
class SampleBox:
    """Limits of the free names, in their order, and the probability of the box."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    weight: float


@dataclass(frozen=True, slots=True)
class SamplingPlan:
    """How to draw an initial state.

    Choose a box by weight; draw each free name as `low + u * (high - low)`, u uniform on [0, 1),
    not above `high`; compute the definitions in order; accept if `acceptance` holds in doubles,
    where an atom with an undefined subterm is false; else start again. `names` are all names of
    the state, `Model.sampled`. `certificate` is "exact" where the doubles satisfy the whole
    precondition, "witness" where a state does whose defined names differ by at most `error_bound`.
    """

    names: tuple[str, ...]
    free: tuple[str, ...]
    boxes: tuple[SampleBox, ...]
    definitions: tuple[tuple[str, Term], ...]
    acceptance: Formula
    certificate: Literal["exact", "witness"]
    error_bound: float
    estimated_acceptance: float


@dataclass(frozen=True, slots=True)
class NoSampler:
    """Initial states cannot be drawn; `reset` then needs a state."""

    diagnostic: Diagnostic


def plan_sampling(
    model: Model, *, boxes: int = 64, time_limit_s: float = 10.0, decision: Decision | None = None
) -> SamplingPlan | NoSampler:
    """Tables for drawing initial states, with at most `boxes` boxes.

    `decision` is what `decide(model)` said, where that is known already. The time limit bounds Z3
    in seconds, and the paving by as much work as takes about that long.
    """
    decision = decide(model, time_limit_s) if decision is None else decision
    try:
        problem = problem_of(model, decision)
        leaves = _paved(problem, boxes, time_limit_s)
        test = _test(problem, leaves)
    except CompileError as refusal:
        return NoSampler(refusal.diagnostics[0])
    total = sum(leaf.volume for leaf in leaves)
    points = min(TRIALS, COORDINATES // len(model.sampled)) // len(leaves) if model.sampled else TRIALS
    accepted = [leaf.volume * _accepted(problem, test.formula, leaf.box, points) for leaf in leaves]
    if sum(accepted) == 0:
        thin = without_sample(problem.formula)
        return NoSampler(diagnose(decision) if isinstance(decision, Unknown) else thin)
    error_bound = max((test.errors[s] for s, _ in problem.definitions), default=0.0)
    return SamplingPlan(
        names=model.sampled,
        free=tuple(s.name for s in problem.free),
        boxes=tuple(_sample_box(leaf, problem.free, total) for leaf in leaves),
        definitions=_by_name(problem),
        acceptance=test.formula,
        certificate="witness" if error_bound > 0 else "exact",
        error_bound=error_bound,
        estimated_acceptance=sum(accepted) / total,
    )


def _paved(problem: Problem, boxes: int, time_limit_s: float) -> tuple[Leaf, ...]:
    wanted = conjunction([problem.rest, *problem.bounds.values()])
    leaves = pave(
        problem.formula,
        problem.box,
        problem.free,
        lambda part: _accepted(problem, wanted, part, PROBES),
        boxes=boxes,
        time_limit_s=time_limit_s,
    )
    if not leaves:
        raise CompileError(without_sample(problem.formula))
    return leaves


def _accepted(problem: Problem, test: Formula, box: Box, points: int) -> float:
    """How much of a box passes a test, estimated from so many points."""
    rng = np.random.default_rng(SEED)
    columns = {s.name: uniform(box[s].low, box[s].high, points, rng) for s in problem.free}
    return float(np.mean(holds(test, completed(columns, _by_name(problem), points), points)))


def _by_name(problem: Problem) -> tuple[tuple[str, Term], ...]:
    return tuple((symbol.name, term) for symbol, term in problem.definitions)


def _test(problem: Problem, leaves: Sequence[Leaf]) -> Acceptance:
    around = {s: hull_of(leaf.box[s] for leaf in leaves) for s in problem.free}
    try:
        return acceptance(problem.rest, problem.definitions, problem.bounds, around)
    except Unbounded as exc:
        raise CompileError(no_error_bound(exc.subject, problem.items)) from None


def _sample_box(leaf: Leaf, free: Sequence[Symbol], total: float) -> SampleBox:
    limits = [leaf.box[s] for s in free]
    return SampleBox(tuple(i.low for i in limits), tuple(i.high for i in limits), leaf.volume / total)
