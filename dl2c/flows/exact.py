"""Straight-line motion: polynomial flows whose domain is left at roots of degree two at most.

`plan` turns a flow into the edges of its domain; `advance` follows it from a state, in
doubles or exactly. The compiled kernel (cgen/runtime/flow_exact.h) performs the same
operations in the same order, so results in doubles are equal to the last bit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from dl2c.flows.solution import NotPolynomial, Solution, solve
from dl2c.ir.evaluate import (
    Undefined,
    Valuation,
    Value,
    evaluate,
    finite,
    in_range,
    literal,
    square_root,
    truth,
)
from dl2c.ir.logic import conjuncts, domain_at_end
from dl2c.ir.margins import margin_of
from dl2c.ir.model import Compare, Flow, Symbol, Term
from dl2c.ir.polynomial import Coefficients
from dl2c.source import Span

MAX_ROOT_DEGREE = 2
"""Events are roots of polynomials of at most this degree."""

RETREATS = 7
"""How often a rounded end point may step back into the domain, each time four times as far."""


@dataclass(frozen=True, slots=True)
class Snap:
    """Where the atom ends the flow, `variable` is set to `target`, which is constant along it."""

    variable: str
    target: Term


@dataclass(frozen=True, slots=True)
class Edge:
    """An atom of the domain as `c0 + c1*tau + c2*tau^2`, positive inside.

    kind "closed" ends the flow where the margin becomes negative, "open" where it becomes zero,
    "unequal" (`!=`) where it becomes zero from either side, "equal" at once.
    """

    kind: str
    margin: Coefficients
    snap: Snap | None
    span: Span


@dataclass(frozen=True, slots=True)
class ExactPlan:
    flow: Flow
    solution: Solution
    edges: tuple[Edge, ...]


@dataclass(frozen=True, slots=True)
class NotExact:
    """Why the exact kernel does not apply, and where."""

    reason: str
    span: Span


def plan(flow: Flow) -> ExactPlan | NotExact:
    """The exact kernel for a flow, or the reason that it has none."""
    solution = solve(flow)
    if isinstance(solution, NotPolynomial):
        return NotExact(solution.reason, flow.span)
    edges: list[Edge] = []
    for atom in conjuncts(flow.watched):
        if not isinstance(atom, Compare):
            return NotExact("its domain is not a conjunction of comparisons", flow.span)
        margin = solution.compose(margin_of(atom))
        if margin is None:
            return NotExact("a condition of its domain is not a polynomial along it", atom.span)
        if len(margin) > MAX_ROOT_DEGREE + 1:
            return NotExact(f"a condition of its domain has degree {len(margin) - 1} along it", atom.span)
        if len(margin) > 1:
            edges.append(_edge(atom, margin, solution))
    return ExactPlan(flow, solution, tuple(edges))


def _edge(atom: Compare, margin: Coefficients, solution: Solution) -> Edge:
    kinds = {"<=": "closed", ">=": "closed", "<": "open", ">": "open", "!=": "unequal", "=": "equal"}
    snap = None
    if atom.op in ("<=", ">="):
        for variable, target in ((atom.left, atom.right), (atom.right, atom.left)):
            fixed = solution.compose(target)
            if (
                isinstance(variable, Symbol)
                and variable.name in solution.variables
                and fixed
                and len(fixed) == 1
            ):
                snap = Snap(variable.name, target)
    return Edge(kinds[atom.op], margin, snap, atom.span)


@dataclass(frozen=True, slots=True)
class Motion:
    """Where a flow led: new values of the variables of its ODE, and how long it took.

    `failed` and `met` are the watches that were violated and the obligations that were met on
    the way, by their places in `FlowPlan.watches`.
    """

    values: dict[str, Value]
    duration: Value
    failed: tuple[int, ...] = ()
    met: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Course:
    """A flow from one state: its polynomials there and the time that clocks leave it."""

    flow: Flow
    env: Valuation
    curves: dict[str, list[Value]]
    remaining: list[Value]
    exact: bool

    @property
    def horizon(self) -> Value:
        cap = self.flow.cap
        return min([*self.remaining, *([literal(cap, self.exact)] if cap is not None else [])])

    @property
    def reach(self) -> Value | None:
        """The time in which the domain may end it, where it has no clock."""
        return None if self.flow.reach is None else literal(self.flow.reach, self.exact)


def course(flow: Flow, solution: Solution, env: Valuation, exact: bool) -> Course:
    """Raises `Undefined` where a coefficient or the horizon has no finite value."""
    curves = {x: [evaluate(c, env, exact) for c in cs] for x, cs in solution.variables.items()}
    remaining = [finite(evaluate(h.bound, env, exact) - _variable(h.clock, env)) for h in flow.horizons]
    return Course(flow, env, curves, remaining, exact)


def advance(plan: ExactPlan, env: Valuation, exact: bool = False) -> Motion | None:
    """Follow the flow as long as its domain allows; None where rounding may decide where it ends.

    Assumes the domain holds in `env`. Raises `Undefined` where a coefficient, the horizon or the end state
    has no finite value.
    """
    run = course(plan.flow, plan.solution, env, exact)
    margins = [[evaluate(c, env, exact) for c in e.margin] for e in plan.edges]
    if not exact and any(e.kind != "equal" and doubtful(m) for e, m in zip(plan.edges, margins, strict=True)):
        return None
    exits = [exit_time(e.kind, *_padded(m)) for e, m in zip(plan.edges, margins, strict=True)]
    end = run.horizon
    if run.reach is not None and _meets(run, exits, run.reach):
        end = run.reach
    for leave in exits:
        if leave is not None and leave < end:
            end = leave
    hits = [k for k, leave in enumerate(exits) if leave is not None and leave <= end]
    if end <= 0:
        return Motion({}, literal(Fraction(0), exact))
    if any(plan.edges[k].kind in ("open", "unequal") for k in hits):
        end = before(end)
    return landed(run, end, [snap for k in hits if (snap := plan.edges[k].snap) is not None])


def doubtful(margin: Sequence[Value]) -> bool:
    """Whether rounding may decide if and where a margin is zero: it nearly has a double zero ahead."""
    c0, c1, c2 = _padded(margin)
    ahead = -c1 if c0 < 0 else c1
    return c2 != 0 and ahead < 0 and abs(c1 * c1 - 4 * c2 * c0) <= c1 * c1 * 2.0**-20


def _meets(run: Course, exits: Sequence[Value | None], reach: Value) -> bool:
    """Whether the domain ends the flow in that time, in a state of finite numbers."""
    first = min((leave for leave in exits if leave is not None and leave <= reach), default=None)
    try:
        return first is not None and all(in_range(horner(c, first)) for c in run.curves.values())
    except Undefined:
        return False


def landed(run: Course, end: Value, snaps: Sequence[Snap]) -> Motion | None:
    """The state at the end of a flow; None where rounding puts it far outside the domain."""
    values = settled(run, {x: horner(c, end) for x, c in run.curves.items()}, end, snaps)
    return Motion(values, end) if inside(run, values) else retreated(run, end)


def settled(run: Course, values: dict[str, Value], end: Value, snaps: Sequence[Snap]) -> dict[str, Value]:
    """With clocks that ran out and bounds that were met, which hold exactly."""
    values = dict(values)
    for horizon, left in zip(run.flow.horizons, run.remaining, strict=True):
        if left == end:
            values[horizon.clock] = evaluate(horizon.bound, run.env, run.exact)
    for snap in snaps:
        values[snap.variable] = evaluate(snap.target, run.env, run.exact)
    return values


def retreated(run: Course, end: Value) -> Motion | None:
    """Rounding put the end point outside the domain: step back until it is inside; None if that is far."""
    for k in range(RETREATS):
        earlier = end - end * literal(Fraction(4**k, 2**52), run.exact)
        values = {x: horner(c, earlier) for x, c in run.curves.items()}
        if inside(run, values):
            return Motion(values, earlier)
    return None


def stopped(run: Course, end: Value) -> Motion | None:
    """The state at a time before the flow would end by itself."""
    if end <= 0:
        return Motion({}, literal(Fraction(0), run.exact))
    values = {x: horner(c, end) for x, c in run.curves.items()}
    return Motion(values, end) if inside(run, values) else retreated(run, end)


def exit_time(kind: str, c0: Value, c1: Value, c2: Value) -> Value | None:
    """When a margin `c0 + c1*tau + c2*tau^2`, inside at 0, first leaves; None for never."""
    if kind == "equal":
        return c0 * 0
    if kind == "unequal" and c0 < 0:
        c0, c1, c2 = -c0, -c1, -c2
    if c0 <= 0:
        if c1 <= 0:
            return c0 * 0 if c1 < 0 or c2 < 0 else None
        return -c1 / c2 if c2 < 0 else None
    if c1 >= 0 and c2 >= 0:
        return None
    if c2 == 0:
        return c0 / -c1
    disc = c1 * c1 - 4 * c2 * c0
    touching = c2 > 0 and kind == "closed"
    if disc < 0 or (disc == 0 and touching):
        return None
    root = square_root(disc)
    if c1 < 0:
        return c0 / ((root - c1) / 2)
    return (-(c1 + root) / 2) / c2


def _padded(margin: Sequence[Value]) -> tuple[Value, Value, Value]:
    zero = margin[0] * 0
    c = [*margin, zero, zero]
    return c[0], c[1], c[2]


def horner(coefficients: list[Value], tau: Value) -> Value:
    value = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = value * tau + c
    if not in_range(value):
        raise Undefined("overflow")
    return value


def before(end: Value) -> Value:
    return math.nextafter(end, 0.0) if isinstance(end, float) else end - end / 2**60


def _variable(name: str, env: Valuation) -> Value:
    value = env[Symbol(name, "variable")]
    if value is None:
        raise Undefined(name)
    return value


def inside(run: Course, values: dict[str, Value]) -> bool:
    """Whether the domain holds after the variables took these values."""
    moved = {**run.env, **{Symbol(x, "variable"): v for x, v in values.items()}}
    return truth(domain_at_end(run.flow), moved, run.exact)
