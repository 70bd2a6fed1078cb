"""Which linear flows may need too many power series, so that a solver for stiff equations is kept ready.

A series reaches as far as the Jacobian's norm lets it: the flow needs about ten for every unit of norm
times duration. Both are bounded by intervals, from numbers, declared bounds and what a path assigns
before the flow. Variables may leave their bounds; a flow taken for mild by mistake has its series and
no more.
"""

from collections.abc import Mapping
from dataclasses import replace

from dl2c.flows.kernel import FlowPlan
from dl2c.interval.arithmetic import INF, WHOLE, Interval, evaluate
from dl2c.interval.bounded import interval_of
from dl2c.ir.logic import substituted, symbols
from dl2c.ir.model import ONE, ZERO, Flow, Model, Sub, Symbol, Term
from dl2c.ir.polynomial import polynomial
from dl2c.paths.path import Paths

MILD = 500.0
"""Norm times duration of a flow that needs no solver: half of what 10000 series are enough for."""

Box = Mapping[Symbol, Interval]


def may_be_stiff(k: int, plan: FlowPlan, model: Model, paths: Paths) -> bool:
    """Whether flow k is followed by power series and may need too many of them."""
    if plan.kernel != "linear":
        return False
    box = {v.symbol: interval_of(v.bound) for v in model.variables}
    box |= {c.symbol: interval_of(c.bound, c.value) for c in model.constants}
    starts = [p.updates for p in paths.paths if p.flow == k]
    longest = max((_longest(plan.flow, dict(updates), box) for updates in starts), default=INF)
    size = _norm(plan.flow, box) * longest
    return not size <= MILD


def with_solver(k: int, plan: FlowPlan, model: Model, paths: Paths) -> FlowPlan:
    """The plan of flow k, with CVODES where its series may be too many."""
    if not may_be_stiff(k, plan, model, paths):
        return plan
    return replace(plan, stiff=True, reason=f"{plan.reason}, CVODES where stiff")


def _longest(flow: Flow, updates: Mapping[str, Term], box: Box) -> float:
    """How long the flow lasts at most, begun after these assignments."""
    values = {Symbol(x, "variable"): term for x, term in updates.items()}
    found = [INF if flow.cap is None else float(flow.cap)]
    for horizon in flow.horizons:
        left = Sub(horizon.bound, Symbol(horizon.clock, "variable"))
        found.append(_value(substituted(left, values), box).high)
    return min(found)


def _norm(flow: Flow, box: Box) -> float:
    """The largest sum of a row of the Jacobian, in size."""
    moved = [Symbol(x, "variable") for x, rate in flow.equations if rate != ZERO]
    rows = [0.0]
    for _, rate in flow.equations:
        slopes = [polynomial(rate, {x: (ZERO, ONE)}) for x in moved]
        rows.append(sum(_size(s[1], box) for s in slopes if s is not None and len(s) > 1))
        if any(s is None for s in slopes):
            return INF
    return max(rows)


def _size(term: Term, box: Box) -> float:
    value = _value(term, box)
    return INF if value.empty else max(abs(value.low), abs(value.high))


def _value(term: Term, box: Box) -> Interval:
    return evaluate(term, {s: box.get(s, WHOLE) for s in symbols(term)})
