"""Following a flow from a state: its domain, what is watched along it, how long it lasts.

The reference of the compiled kernels for flows with polynomial solutions (semantics 4 and 6),
in doubles or exactly. Motions and margins that are polynomials are followed by the operations
of cgen/runtime in the same order, so results in doubles are equal to the last bit; margins
that are not polynomials are sampled.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from dl2c.ir.evaluate import Environment, Undefined, Value, evaluate, literal
from dl2c.ir.exact import Course, Motion, advance, before, course, horner, landed, stopped
from dl2c.ir.kernel import FlowPlan
from dl2c.ir.logic import holds
from dl2c.ir.model import And, Compare, Formula, Or, Symbol, Term, Truth
from dl2c.ir.roots import Crossing, Exit, crossings, curve_of, first_exit, sign_after
from dl2c.ir.starts import begun

Signs = Sequence[int]

SAMPLES = 512
"""Places at which margins that are not polynomials are looked at."""


@dataclass(frozen=True, slots=True)
class Events:
    """Signs of all margins over a stretch of time: at its start, just after, and where they change."""

    at_start: list[int]
    after_start: list[int]
    crossings: list[Crossing]


def follow(
    plan: FlowPlan, env: Environment, exact: bool = False, part: Value = 1, waiting: Sequence[int] = ()
) -> Motion:
    """Follow a flow for a part (0 to 1) of the longest time that its domain allows.

    `waiting` are the watches still to be kept an eye on. Assumes that the domain holds in `env`.
    Raises `Undefined` where a coefficient, the horizon or the end state has no finite value.
    """
    assert plan.solution is not None
    env = begun(plan.starts, env, exact)
    motion = _longest(plan, env, exact)
    run = course(plan.flow, plan.solution, env, exact)
    if part < 1:
        motion = stopped(run, motion.duration * part)
    if not waiting:
        return motion
    return _watched(plan, run, motion, waiting)


def _longest(plan: FlowPlan, env: Environment, exact: bool) -> Motion:
    """As long as the domain allows."""
    if plan.quick is not None:
        return advance(plan.quick, env, exact)
    assert plan.solution is not None and plan.curves is not None
    run = course(plan.flow, plan.solution, env, exact)
    end = run.horizon
    if end <= 0:
        return Motion({}, literal(Fraction(0), exact))
    events = _events(plan, run, end)
    found = _exit(plan.domain, plan.margins, events, exact)
    if found.found:
        end = found.at * end
        if end <= 0:
            return Motion({}, literal(Fraction(0), exact))
        end = end if found.holds else before(end)
    return landed(run, end, [snap for k, snap in plan.snaps if found.sign_at[k] == 0])


def _watched(plan: FlowPlan, run: Course, motion: Motion, waiting: Sequence[int]) -> Motion:
    """The motion with what happened on its way; shorter where a violation cuts it."""
    length = motion.duration
    events = _events(plan, run, length)
    exits = {w: _exit(plan.watches[w].stays, plan.margins, events, run.exact) for w in waiting}
    cuts = [e.at for w, e in exits.items() if e.found and plan.watches[w].cuts]
    stop = min(cuts, default=None)
    failed: list[int] = []
    met: list[int] = []
    for w, found in exits.items():
        watch = plan.watches[w]
        if not found.found or not _reached(found, stop, watch.cuts):
            continue
        signs = found.sign_after if found.holds else found.sign_at
        if holds_over(watch.goal, plan.margins, signs):
            met.append(w)
        elif holds_over(watch.due, plan.margins, signs):
            failed.append(w)
    if stop is not None and stop < 1:
        motion = stopped(run, stop * length)
    return replace(motion, failed=tuple(failed), met=tuple(met))


def _reached(found: Exit, stop: Value | None, cuts: bool) -> bool:
    """Whether the flow still went on where a watch failed."""
    if stop is None or found.at < stop:
        return True
    return found.at == stop and (cuts or not found.holds)


def _exit(formula: Formula, margins: Sequence[Term], events: Events, exact: bool) -> Exit:
    def over(signs: Signs) -> bool:
        return holds_over(formula, margins, signs)

    return first_exit(events.crossings, events.at_start, events.after_start, over, exact)


def holds_over(formula: Formula, margins: Sequence[Term], signs: Signs) -> bool:
    """The truth of a formula over margins whose signs are given."""
    match formula:
        case Truth(value):
            return value
        case Compare(op, left):
            return holds(op, signs[margins.index(left)], 0)
        case And(children):
            return all(holds_over(c, margins, signs) for c in children)
        case Or(children):
            return any(holds_over(c, margins, signs) for c in children)


def _events(plan: FlowPlan, run: Course, length: Value) -> Events:
    if plan.curves is None:
        return scan(lambda tau: _margins_at(plan, run, tau), length)
    coefficients = [_coefficients(cs, run) for cs in plan.curves]
    curves = [curve_of(cs, length) for cs in coefficients]
    at_start = [_sign(cs[0]) for cs in coefficients]
    after = [sign_after(c) for c in curves] if length > 0 else at_start
    return Events(at_start, after, crossings(curves, after) if length > 0 else [])


def _coefficients(terms: Sequence[Term], run: Course) -> list[Value]:
    """One margin along the flow; zero where it has no value, which its conditions find out."""
    try:
        return [evaluate(c, run.env, run.exact) for c in terms]
    except Undefined:
        return [literal(Fraction(0), run.exact)]


def _margins_at(plan: FlowPlan, run: Course, tau: Value) -> list[Value | None]:
    moved = {**run.env, **{Symbol(x, "variable"): horner(c, tau) for x, c in run.curves.items()}}
    values: list[Value | None] = []
    for margin in plan.margins:
        try:
            values.append(evaluate(margin, moved, run.exact))
        except Undefined:
            values.append(None)
    return values


def scan(margins_at: Callable[[Value], Sequence[Value | None]], length: Value) -> Events:
    """Sign changes between samples, each narrowed by bisection; contacts between samples are missed.

    A margin without a value counts as zero, which is what bounds its definedness.
    """

    def signs(tau: Value) -> list[int]:
        return [0 if v is None else _sign(v) for v in margins_at(tau)]

    at_start = signs(length * 0)
    if length <= 0:
        return Events(at_start, at_start, [])
    places = [length * k / SAMPLES for k in range(SAMPLES + 1)]
    after = signs(length / 2**30)
    found: list[Crossing] = []
    known = list(after)
    for low, high in zip([length / 2**30, *places[1:]], places[1:], strict=False):
        for margin, sign in enumerate(signs(high)):
            if sign != known[margin]:
                at = _narrowed(lambda tau, m=margin: signs(tau)[m], low, high, known[margin])
                found.append(Crossing(at / length, margin, sign))
                known[margin] = sign
    return Events(at_start, after, sorted(found, key=lambda c: (c.at, c.margin)))


def _narrowed(sign: Callable[[Value], int], low: Value, high: Value, before_it: int) -> Value:
    for _ in range(60):
        middle = (low + high) / 2
        if sign(middle) == before_it:
            low = middle
        else:
            high = middle
    return high


def _sign(value: Value) -> int:
    return (value > 0) - (value < 0)
