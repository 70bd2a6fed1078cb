"""Following a flow from a state: its domain, what is watched along it, how long it lasts.

The reference of the compiled kernels for flows with polynomial solutions (semantics 4 and 6), in
doubles or exactly. In doubles these are the operations of cgen/runtime/travel.h and numeric.h in the
same order, so results are equal to the last bit; exactly, margins that are not polynomials of time are
sampled.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import cast

from dl2c.flows.enclosed import in_doubles
from dl2c.flows.events import Crossing, Events, exit_of, watched
from dl2c.flows.exact import Course, Motion, advance, before, course, horner, inside, landed, settled, stopped
from dl2c.flows.kernel import FlowPlan
from dl2c.flows.pieces import Track
from dl2c.flows.roots import crossings, curve_of, sign_after
from dl2c.flows.search import Halt, Search
from dl2c.flows.starts import begun
from dl2c.flows.stretch import Stretch
from dl2c.ir.evaluate import Undefined, Valuation, Value, evaluate, in_range, literal, truth
from dl2c.ir.logic import true_where
from dl2c.ir.model import Compare, Formula, Symbol
from dl2c.ir.polynomial import Coefficients

SAMPLES = 512
"""Places at which margins that are not polynomials are looked at in exact arithmetic."""

FARTHEST_BACK = 2.0**-12
"""A retreat steps back four times as far each time: by at most this part of a track, or to where all margins
last had certain signs."""
RETREAT_FINE = 2.0**-40
"""A retreat that went further than this is refined by bisection until it is known as well as this."""


def follow(
    plan: FlowPlan, env: Valuation, exact: bool = False, part: Value = 1, waiting: Sequence[int] = ()
) -> Motion:
    """Follow a flow for a part (0 to 1) of the longest time that its domain allows.

    `waiting` are the watches that are still open. Assumes that the domain holds in `env`.
    Raises `Undefined` where a coefficient, the horizon or the end state has no finite value, or where the
    search for events takes too long.
    """
    assert plan.solution is not None
    env = begun(plan.starts, env, exact)
    run = course(plan.flow, plan.solution, env, exact)
    if exact:
        return _exactly(plan, run, part, waiting)
    motion = _straight(plan, run, part, waiting) if plan.quick is not None else None
    if motion is not None:
        return motion
    limit = _limit(plan, run)
    if part < 1:
        longest, _ = _searched(plan, run, limit, ())
        limit = min(limit, longest.duration * part)
    return _searched(plan, run, limit, waiting)[0]


def _limit(plan: FlowPlan, run: Course) -> Value:
    """How long a searched flow may last: without a clock until its domain ends it, if that is in time."""
    if run.reach is not None:
        with suppress(Undefined):
            if _searched(plan, run, run.reach, ())[1]:
                return run.reach
    return run.horizon


# Straight-line motion -----------------------------------------------------------


def _straight(plan: FlowPlan, run: Course, part: Value, waiting: Sequence[int]) -> Motion | None:
    """Motion whose end is the root of a polynomial; None where that takes a closer look."""
    assert plan.quick is not None
    motion = advance(plan.quick, run.env, run.exact)
    if motion is not None and part < 1:
        motion = stopped(run, motion.duration * part)
    if motion is None or not waiting or _quiet(plan, run, motion):
        return motion
    length = motion.duration
    track = _track(run, float(length)) if length > 0 else _rest(run)
    search = Search(Stretch(plan, run.env, track), waiting)
    halt = search.along(bounded=False)
    if isinstance(halt, Halt) and 0.0 + track.length * halt.place < length:
        motion = stopped(run, 0.0 + track.length * halt.place)
    return None if motion is None else replace(motion, failed=tuple(search.failed), met=tuple(search.met))


def _quiet(plan: FlowPlan, run: Course, motion: Motion) -> bool:
    """Whether the motion plainly changes no watch that matters (`model_keeps_watches` in C)."""
    if plan.still is None:
        return False
    spans = [_span([in_doubles(c, run.env) for c in curve], motion.duration) for curve in plan.still_curves]
    end = {**run.env, **{Symbol(x, "variable"): v for x, v in motion.values.items()}}
    return _stays(plan.still, plan, spans) and all(truth(w.at_end, end) for w in plan.watches)


def _span(c: Sequence[Value], length: Value) -> tuple[Value, Value, Value]:
    """Bernstein coefficients of a margin of degree two at most, which enclose it."""
    if len(c) == 1:
        return c[0], c[0], c[0]
    if len(c) == 2:
        return c[0], c[0], c[1] * length + c[0]
    half = c[1] * length / 2.0
    middle = half + c[0]
    return c[0], middle, c[2] * (length * length) + half + middle


def _stays(formula: Formula, plan: FlowPlan, spans: Sequence[tuple[Value, Value, Value]]) -> bool:

    def stays(atom: Compare) -> bool:
        span = spans[plan.still_margins.index(atom.left)]
        if atom.op == "!=":
            return all(b > 0 for b in span) or all(b < 0 for b in span)
        return all(b > 0 if atom.op == ">" else b == 0 if atom.op == "=" else b >= 0 for b in span)

    return true_where(formula, stays)


# Searched motion ----------------------------------------------------------------


def _track(run: Course, stop: float) -> Track:
    """The whole motion over [0, stop]. Raises `Undefined` where it has an undefined or infinite value."""
    degree = max((len(c) - 1 for c in run.curves.values()), default=0)
    curves: dict[str, list[float]] = {}
    for x, coefficients in run.curves.items():
        scaled = [float(coefficients[0])]
        scale = stop
        for k in range(1, degree + 1):
            scaled.append(float(coefficients[k]) * scale if k < len(coefficients) else 0.0)
            scale *= stop
        curves[x] = scaled
    end = {x: float(horner(c, stop)) for x, c in run.curves.items()}
    return Track(stop, curves, end)


def _rest(run: Course) -> Track:
    """A track that stays, for what is watched where a flow has no time."""
    start = {x: float(c[0]) for x, c in run.curves.items()}
    return Track(0.0, {x: [v] for x, v in start.items()}, start)


def _searched(plan: FlowPlan, run: Course, stop: Value, waiting: Sequence[int]) -> tuple[Motion, bool]:
    """Motion for a time at most, whose events are searched, and whether the domain ended it."""
    if not stop > 0:
        search = Search(Stretch(plan, run.env, _rest(run)), waiting)
        search.along(bounded=False)
        return Motion({}, 0.0, tuple(search.failed), tuple(search.met)), False
    track = _track(run, float(stop))
    search = Search(Stretch(plan, run.env, track), waiting)
    halt = search.along(bounded=True)
    if isinstance(halt, Halt):
        time = 0.0 + track.length * halt.place
        motion = _arrived(plan, run, search.stretch, halt.place, time, None if halt.cut else halt.signs)
    else:
        motion = _arrived(plan, run, search.stretch, 1.0, float(stop), halt)
    ended = isinstance(halt, Halt) and not halt.cut
    return replace(motion, failed=tuple(search.failed), met=tuple(search.met)), ended


def _arrived(
    plan: FlowPlan, run: Course, stretch: Stretch, place: float, time: float, signs: Sequence[int] | None
) -> Motion:
    """The end of a flow at a place of its track; `signs` of margins there tell which bounds were met.

    Where that is outside the domain by rounding, a slightly earlier one.
    """
    values = cast("dict[str, Value]", stretch.track.at(place))
    if signs is not None:
        values = settled(run, values, time, [snap for k, snap in plan.snaps if signs[k] == 0])
    if not all(in_range(v) for v in values.values()):
        raise Undefined("overflow")
    if inside(run, values):
        return Motion(values, time)
    earlier = _back(run, stretch, place)
    if earlier is not None:
        return earlier
    if stretch.clear > 0 and not place < RETREAT_FINE:
        raise Undefined("no state inside the domain")
    return _back_to_start(run, stretch.track, place)


def _back_to_start(run: Course, track: Track, place: float) -> Motion:
    """Steps towards the start, which is inside, where no margin has a certain sign anywhere."""
    part = 0.5
    while part > RETREAT_FINE:
        if (found := _arriving(run, track, place * part)) is not None:
            return found
        part *= 0.5
    return Motion({}, 0.0)


def _arriving(run: Course, track: Track, place: float) -> Motion | None:
    """Motion that ends at a place of the track, if that is inside the domain."""
    values = cast("dict[str, Value]", track.at(place))
    return Motion(values, 0.0 + track.length * place) if inside(run, values) else None


def _back(run: Course, stretch: Stretch, place: float) -> Motion | None:
    """Steps back from a place of a track until the state is inside the domain."""

    def arrives(part: float) -> Motion | None:
        return _arriving(run, stretch.track, place - place * part)

    outside, within = 0.0, 2.0**-52
    farthest = max(FARTHEST_BACK, place - stretch.clear)
    while within < 1 and within * place <= farthest:
        if (found := arrives(within)) is None:
            outside, within = within, within * 4.0
            continue
        while within - outside > RETREAT_FINE:
            middle = 0.5 * (outside + within)
            if (nearer := arrives(middle)) is None:
                outside = middle
            else:
                within, found = middle, nearer
        return found
    return None


# Exact arithmetic ---------------------------------------------------------------


def _exactly(plan: FlowPlan, run: Course, part: Value, waiting: Sequence[int]) -> Motion:
    motion = _longest(plan, run)
    if part < 1:
        motion = _inside(stopped(run, motion.duration * part))
    if not waiting:
        return motion
    length = motion.duration
    events = _events(plan, run, length)
    stop, failed, met = watched(plan, waiting, events, literal(Fraction(1), run.exact), run.exact)
    if stop is not None and stop < 1:
        motion = _inside(stopped(run, stop * length))
    return replace(motion, failed=failed, met=met)


def _inside(motion: Motion | None) -> Motion:
    assert motion is not None, "nothing is rounded far outside a domain"
    return motion


def _longest(plan: FlowPlan, run: Course) -> Motion:
    """As long as the domain allows."""
    if plan.quick is not None:
        return _inside(advance(plan.quick, run.env, run.exact))
    if run.reach is not None:
        with suppress(Undefined):
            motion, ended = _within(plan, run, run.reach)
            if ended:
                return motion
    return _within(plan, run, run.horizon)[0]


def _within(plan: FlowPlan, run: Course, limit: Value) -> tuple[Motion, bool]:
    """As long as the domain allows, at most for this time; and whether the domain ended it."""
    end = limit
    if end <= 0:
        return Motion({}, literal(Fraction(0), run.exact)), False
    events = _events(plan, run, end)
    found = exit_of(plan.domain, plan.margins, events, run.exact)
    if found.found:
        end = found.at * end
        if end <= 0:
            return Motion({}, literal(Fraction(0), run.exact)), True
        end = end if found.holds else before(end)
    snaps = [snap for k, snap in plan.snaps if found.sign_at[k] == 0]
    return _inside(landed(run, end, snaps)), found.found


def _events(plan: FlowPlan, run: Course, length: Value) -> Events:
    if plan.curves is None:
        return scan(lambda tau: _margins_at(plan, run, tau), length)
    coefficients = [_coefficients(cs, run) for cs in plan.curves]
    curves = [curve_of(cs, Fraction(length)) for cs in coefficients]
    at_start = [_sign(cs[0]) for cs in coefficients]
    after = [sign_after(c) for c in curves] if length > 0 else at_start
    return Events(at_start, after, crossings(curves, after) if length > 0 else [])


def _coefficients(terms: Coefficients, run: Course) -> list[Fraction]:
    """One margin along the flow; zero where it has no value, which its conditions find out."""
    try:
        return [Fraction(evaluate(c, run.env, run.exact)) for c in terms]
    except Undefined:
        return [Fraction(0)]


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
