"""The exact flow kernel: polynomial motion, events as polynomial roots.

`plan` turns a flow into what is watched along it; `advance` follows it from a state, in
doubles or exactly. The compiled kernel (cgen/runtime/flow_exact.h) performs the same
operations in the same order, so results in doubles are equal to the last bit.
"""

import math
from dataclasses import dataclass
from fractions import Fraction

from dl2c.ir.evaluate import (
    Environment,
    Undefined,
    Value,
    evaluate,
    finite,
    in_range,
    literal,
    square_root,
    truth,
)
from dl2c.ir.flow import NotPolynomial, Solution, solve
from dl2c.ir.logic import conjuncts
from dl2c.ir.model import ZERO, Compare, Flow, Sub, Symbol, Term
from dl2c.ir.polynomial import Coefficients
from dl2c.source import Span

MAX_ROOT_DEGREE = 2
"""Events are roots of polynomials of at most this degree."""

RETREATS = 27
"""How often a rounded end point may step back into the domain, each time four times as far."""


@dataclass(frozen=True, slots=True)
class Snap:
    """Where the atom ends the flow, `variable` is set to `target`, which is constant along it."""

    variable: str
    target: Term


@dataclass(frozen=True, slots=True)
class Watch:
    """An atom of the domain as `c0 + c1*tau + c2*tau^2`, positive inside.

    kind "closed" ends the flow where the margin becomes negative, "open" where it becomes zero,
    "apart" (`!=`) where it becomes zero from either side, "equal" at once.
    """

    kind: str
    margin: Coefficients
    snap: Snap | None
    span: Span


@dataclass(frozen=True, slots=True)
class ExactPlan:
    flow: Flow
    solution: Solution
    watches: tuple[Watch, ...]


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
    watches: list[Watch] = []
    for atom in conjuncts(flow.watched):
        if not isinstance(atom, Compare):
            return NotExact("its domain is not a conjunction of comparisons", flow.span)
        margin = solution.compose(margin_of(atom))
        if margin is None:
            return NotExact("a condition of its domain is not a polynomial along it", atom.span)
        if len(margin) > MAX_ROOT_DEGREE + 1:
            return NotExact(f"a condition of its domain has degree {len(margin) - 1} along it", atom.span)
        if len(margin) > 1:
            watches.append(_watch(atom, margin, solution))
    return ExactPlan(flow, solution, tuple(watches))


def margin_of(atom: Compare) -> Term:
    """A term that is positive inside the atom and 0 on its boundary; for `=` and `!=` left minus right."""
    left, right = (atom.right, atom.left) if atom.op in ("<", "<=") else (atom.left, atom.right)
    return left if right == ZERO else Sub(left, right)


def _watch(atom: Compare, margin: Coefficients, solution: Solution) -> Watch:
    kinds = {"<=": "closed", ">=": "closed", "<": "open", ">": "open", "!=": "apart", "=": "equal"}
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
    return Watch(kinds[atom.op], margin, snap, atom.span)


@dataclass(frozen=True, slots=True)
class Motion:
    """Where a flow led: new values of the variables of its ODE, and how long it took."""

    values: dict[str, Value]
    duration: Value


def advance(flow: ExactPlan, env: Environment, exact: bool = False) -> Motion:
    """Follow the flow as long as its domain allows. Assumes the domain holds in `env`.

    Raises `Undefined` where a coefficient, the horizon or the end state has no finite value.
    """
    curves = {x: [evaluate(c, env, exact) for c in cs] for x, cs in flow.solution.variables.items()}
    margins = [[evaluate(c, env, exact) for c in w.margin] for w in flow.watches]
    remaining = [finite(evaluate(h.bound, env, exact) - _variable(h.clock, env)) for h in flow.flow.horizons]
    limits = [*remaining, *([literal(flow.flow.cap, exact)] if flow.flow.cap is not None else [])]
    end = min(limits)
    exits = [exit_time(w.kind, *_padded(m)) for w, m in zip(flow.watches, margins, strict=True)]
    for leave in exits:
        if leave is not None and leave < end:
            end = leave
    hits = [k for k, leave in enumerate(exits) if leave is not None and leave <= end]
    if end <= 0:
        return Motion({}, literal(Fraction(0), exact))
    if any(flow.watches[k].kind in ("open", "apart") for k in hits):
        end = _before(end)
    values = {x: _horner(c, end) for x, c in curves.items()}
    for horizon, left in zip(flow.flow.horizons, remaining, strict=True):
        if left == end:
            values[horizon.clock] = evaluate(horizon.bound, env, exact)
    for k in hits:
        if (snap := flow.watches[k].snap) is not None:
            values[snap.variable] = evaluate(snap.target, env, exact)
    if _inside(flow, env, values, exact):
        return Motion(values, end)
    return _retreated(flow, env, curves, end, exact)


def _retreated(
    flow: ExactPlan, env: Environment, curves: dict[str, list[Value]], end: Value, exact: bool
) -> Motion:
    """Rounding put the end point outside the domain: step back until it is inside."""
    for k in range(RETREATS):
        earlier = end - end * literal(Fraction(4**k, 2**52), exact)
        values = {x: _horner(c, earlier) for x, c in curves.items()}
        if _inside(flow, env, values, exact):
            return Motion(values, earlier)
    return Motion({}, literal(Fraction(0), exact))


def exit_time(kind: str, c0: Value, c1: Value, c2: Value) -> Value | None:
    """When a margin `c0 + c1*tau + c2*tau^2`, inside at 0, first leaves; None for never."""
    if kind == "equal":
        return c0 * 0
    if kind == "apart" and c0 < 0:
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


def _padded(margin: list[Value]) -> tuple[Value, Value, Value]:
    zero = margin[0] * 0
    c = [*margin, zero, zero]
    return c[0], c[1], c[2]


def _horner(coefficients: list[Value], tau: Value) -> Value:
    value = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = value * tau + c
    if not in_range(value):
        raise Undefined("overflow")
    return value


def _before(end: Value) -> Value:
    return math.nextafter(end, 0.0) if isinstance(end, float) else end - end / 2**60


def _variable(name: str, env: Environment) -> Value:
    value = env[Symbol(name, "variable")]
    if value is None:
        raise Undefined(name)
    return value


def _inside(flow: ExactPlan, env: Environment, values: dict[str, Value], exact: bool) -> bool:
    moved = {**env, **{Symbol(x, "variable"): v for x, v in values.items()}}
    return truth(flow.flow.domain, moved, exact)
