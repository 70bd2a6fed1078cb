"""What is watched along a motion: every change of truth is bracketed.

cgen/runtime/stretch.h operation for operation, for motions that are polynomials of time; that file says
what is certain.
"""

import math
from bisect import insort
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dl2c.ir import hull, taylor
from dl2c.ir.doubles import from_ordinal, ordinal
from dl2c.ir.enclosed import Enclosed, in_doubles
from dl2c.ir.evaluate import Environment, Undefined
from dl2c.ir.events import Crossing, Events, exit_of, watched
from dl2c.ir.hull import Hull
from dl2c.ir.kernel import FlowPlan, constant_along
from dl2c.ir.margins import margin_of
from dl2c.ir.model import And, Compare, Formula, Or, Symbol, Term, Truth
from dl2c.ir.taylor import Taylor

LOOKS = 1 << 14
"""A track that needs more looks counts as one whose events cannot be found."""
NARROWEST = 2.0**-50
"""Stretches are not halved below this part of a track."""
CLOSE = 2.0**-44
"""A change of sign is bracketed well enough within this part of a track."""
TOGETHER = 2.0**-49
"""Events that are at most so far apart, relative to their place, are one."""
TRACK_ROUNDING = 2.0**-46


class TooManyLooks(Undefined):
    """The search for events takes too long."""


@dataclass(frozen=True, slots=True)
class Track:
    """A motion over [0, length]: each variable that the ODE names as a polynomial of s in [0,1], all of one
    degree, and where it is at 1."""

    length: float
    curves: Mapping[str, Sequence[float]]
    end: Mapping[str, float]

    def at(self, place: float) -> dict[str, float]:
        if place >= 1:
            return dict(self.end)
        found: dict[str, float] = {}
        for x, c in self.curves.items():
            value = c[-1]
            for k in range(len(c) - 2, -1, -1):
                value = value * place + c[k]
            found[x] = value
        return found

    def hulls(self) -> dict[Symbol, Hull]:
        """What the whole track stays in."""
        return {Symbol(x, "variable"): _terms_hull(c, self.end[x]) for x, c in self.curves.items()}

    def models(self, middle: float, half: float) -> dict[Symbol, Taylor]:
        return {
            Symbol(x, "variable"): taylor.of_polynomial(c, self.end[x], middle, half)
            for x, c in self.curves.items()
        }


def _terms_hull(c: Sequence[float], end: float) -> Hull:
    down = up = 0.0
    for a in c[1:]:
        down += hull.least(a, 0.0)
        up += hull.greatest(a, 0.0)
    rounding = (abs(c[0]) + up - down) * TRACK_ROUNDING
    return hull.hull_of(hull.least(c[0] + down - rounding, end), hull.greatest(c[0] + up + rounding, end))


@dataclass(frozen=True, slots=True)
class Leg:
    """What is known of a margin at the end of a stretch. `near`: it comes so near to zero that its sign is
    the one before."""

    sign: int
    near: bool


@dataclass(frozen=True, slots=True)
class Halt:
    """Where on a track a motion ends, by its domain or cut by a violation; the signs of margins there."""

    place: float
    cut: bool
    signs: Sequence[int]


@dataclass(slots=True)
class Search:
    """A look along one track from its start, stretch by stretch. `waiting` are the watches still open;
    `failed` and `met` collect what became of the others."""

    plan: FlowPlan
    env: Environment
    track: Track
    waiting: Sequence[int]
    failed: list[int] = field(default_factory=list[int])
    met: list[int] = field(default_factory=list[int])
    low: float = 0.0
    width: float = 1.0
    begun: bool = False
    known: bool = False
    here: list[int] = field(default_factory=list[int])
    since: list[int] = field(default_factory=list[int])
    near: list[bool] = field(default_factory=list[bool])
    at_start: list[bool] = field(default_factory=list[bool])
    at_end: list[bool] = field(default_factory=list[bool])

    def along(self, bounded: bool) -> Halt | Sequence[int]:
        """Where the motion ends; the signs at the end of the track if it does not. `bounded`: the domain is
        looked at too. Raises `TooManyLooks`."""
        signs: Sequence[int] = [1] * len(self.plan.margins)
        if not self.plan.margins or self._calm(self.track.hulls(), bounded):
            return signs
        looks = 0
        while self.low < 1:
            looks += 1
            if looks > LOOKS:
                raise TooManyLooks
            half = 0.5 * self.width
            models = self.track.models(self.low + half, half)
            calm = self.width < 1 and self._calm({s: m.hull for s, m in models.items()}, bounded)
            if calm:
                signs = [1] * len(self.plan.margins)
            else:
                events = self._events(models)
                if events is None:
                    self.width *= 0.5
                    continue
                found = exit_of(self.plan.domain, self.plan.margins, events)
                leaves = bounded and found.found
                limit = found.at if leaves else 1.0
                stop, failed, met = watched(self.plan, self.waiting, events, limit)
                self.failed += failed
                self.met += met
                self.waiting = [w for w in self.waiting if w not in (*failed, *met)]
                place = self.low + self.width * float(limit if stop is None else stop)
                signs = found.sign_at
                zero = self.at_end if limit >= 1 else self.at_start if not limit > 0 else [False] * len(signs)
                signs = [0 if z else s for s, z in zip(signs, zero, strict=True)]
                if stop is not None:
                    return Halt(place, True, signs)
                if leaves:
                    place = place if found.holds or not place > 0 else math.nextafter(place, 0.0)
                    return Halt(place, False, signs)
            self._next()
        return signs

    def _next(self) -> None:
        self.begun = True
        self.low += self.width
        if math.fmod(self.low, 2.0 * self.width) == 0:
            self.width *= 2.0

    def _moves(self, term: Term) -> bool:
        return not constant_along(term, self.plan.flow)

    def _calm(self, state: Mapping[Symbol, Hull], bounded: bool) -> bool:
        """Whether nothing happens: conditions hold in every state within hulls."""
        terms = Enclosed(hull.FUNCTIONS, lambda a: hull.hull_of(a, a), state, self.env, self._moves)
        domain, *stays = self.plan.written
        calm = (not bounded or _plainly(domain, terms)) and all(
            _plainly(stays[w], terms) for w in self.waiting
        )
        if calm:
            self.known = False
            self.begun = True
        return calm

    def _models(self, state: Mapping[Symbol, Taylor]) -> list[Taylor]:
        """Of all margins."""
        terms = Enclosed(taylor.FUNCTIONS, taylor.number, state, self.env, self._moves)
        return [terms.term(m) for m in self.plan.margins]

    def _events(self, state: Mapping[Symbol, Taylor]) -> Events | None:
        """What happens on the stretch; None where a margin's model leaves it open."""
        models = self._models(state)
        self._begin_signs()
        events = Events([], [], [])
        legs: list[Leg] = []
        self.at_end = []
        for j, g in enumerate(models):
            leg = self._margin_events(j, g, events)
            if leg is None:
                return None
            legs.append(leg)
        self.here, self.since = [leg.sign for leg in legs], [leg.sign for leg in legs]
        self.at_start, self.near = self.near, [leg.near for leg in legs]
        return events

    def _begin_signs(self) -> None:
        if self.known:
            return
        signs = [self._sign_at(j, self.low) for j in range(len(self.plan.margins))]
        self.here = [0 if s == 2 else s for s in signs]
        self.since = list(self.here)
        self.near = [False] * len(signs)
        self.known = True
        if 0 in signs and not self.begun:
            for j, g in enumerate(self._models(self.track.models(0.0, 1.0))):
                found = [c for c in g.c[1:] if abs(c) > g.e]
                if self.since[j] == 0 and found:
                    self.since[j] = 1 if found[0] > 0 else -1

    def _sign_at(self, margin: int, place: float) -> int:
        """The sign of a margin at a place, as doubles compute it; 2 where it has no value."""
        moved = {Symbol(x, "variable"): v for x, v in self.track.at(place).items()}
        value = in_doubles(self.plan.margins[margin], {**self.env, **moved})
        return _sign(value) if math.isfinite(value) else 2

    def _margin_events(self, j: int, g: Taylor, events: Events) -> Leg | None:
        """Adds what a margin does on the stretch; None where that is open."""
        if g.lacks & taylor.LACKS_VALUE or not math.isfinite(g.c[0]):
            return self._keeps(j, 0, False, events)
        c = g.c
        first_slope = c[1] - 2.0 * c[2] + 3.0 * c[3] - 4.0 * c[4]
        turned = self.near[j] and not self.since[j] * first_slope < 0
        always = taylor.sign(g)
        if always:
            return self._keeps(j, always, turned, events)
        narrow = self.width <= NARROWEST or g.lacks != 0
        fine = (math.isfinite(g.r) and g.r <= taylor.FINE * g.e) or narrow
        slope = abs(c[1]) - 2.0 * abs(c[2]) - 3.0 * abs(c[3]) - 4.0 * abs(c[4])
        if slope > 0:
            return self._monotone_events(j, g, fine, slope, turned, events)
        if not narrow and not (fine and g.size <= 2.0 * g.r):
            return None
        return self._vague_events(j, g, first_slope, turned, events)

    def _monotone_events(
        self, j: int, g: Taylor, fine: bool, slope: float, turned: bool, events: Events
    ) -> Leg | None:
        """A margin whose model is monotone; `slope` is the least of it."""
        first_value, last_value = g.at(-1.0), g.at(1.0)
        sure_first, sure_last = abs(first_value) > g.r, abs(last_value) > g.r
        if not fine and not (sure_first and sure_last):
            return None
        first = _sign(first_value) if sure_first else self.since[j]
        last = _sign(last_value) if sure_last else 0
        if first * last < 0 and not fine and not g.r * self.width <= slope * CLOSE:
            return None
        leg = self._keeps(j, first or last, turned, events)
        self.at_end[j] = not sure_last
        if first * last < 0:
            vague = g.r / slope * self.width
            self._cross(j, self._change(j, g, first), last, events, vague)
            leg = Leg(last, False)
        return self._comes_near(j, first, events) if first and not sure_last else leg

    def _vague_events(self, j: int, g: Taylor, first_slope: float, turned: bool, events: Events) -> Leg:
        """A margin that rounding does not tell from zero all along."""
        c = g.c
        came = self.since[j]
        last_slope = c[1] + 2.0 * c[2] + 3.0 * c[3] + 4.0 * c[4]
        leg = self._keeps(j, came, turned, events)
        self.at_end[j] = True
        if came * first_slope < 0 and came * last_slope <= 0:
            return self._comes_near(j, came, events)
        if came and not (came * first_slope >= 0 and came * last_slope > 0):
            self._cross(j, self._turn(g, first_slope > 0, last_slope > 0), came, events)
        return leg

    def _keeps(self, j: int, sign: int, turned: bool, events: Events) -> Leg:
        """Notes the sign over the stretch, as far as it does not change; `turned`: it was near zero."""
        events.at_start.append(self.here[j] if sign == self.since[j] and not turned else 0)
        events.after_start.append(sign)
        self.at_end.append(False)
        return Leg(sign, False)

    def _comes_near(self, j: int, sign: int, events: Events) -> Leg:
        """So near to zero at the end of the stretch that only doubles can tell whether it is."""
        end = self.low + self.width
        if self._sign_at(j, end) != 0:
            return Leg(sign, True)
        self._cross(j, end, 0, events)
        return Leg(0, False)

    def _cross(self, j: int, place: float, after: int, events: Events, vague: float = 0.0) -> None:
        """A crossing at a place, or where another is that rounding does not tell apart from it; `vague` is
        how uncertain the place is."""
        at = (place - self.low) / self.width
        for other in events.crossings:
            near = self.low + self.width * float(other.at)
            if abs(near - place) <= place * TOGETHER + vague:
                at = other.at
        insort(events.crossings, Crossing(at, j, after), key=lambda c: (c.at, c.margin))

    def _change(self, margin: int, g: Taylor, sign: int) -> float:
        """Where a margin, whose model is monotone, leaves the side on which it was: a place where doubles
        make it zero, if one is met, else the last double before."""
        low, high = ordinal(self.low), ordinal(self.low + self.width)
        near, far = low, high
        start = ordinal(self._model_zero(g, sign))
        if self.begun and self._sign_at(margin, self.low) == 0:
            return self.low
        direction = step = 0
        while far - near > 1:
            number = near + (far - near) // 2
            if direction == 0:
                number = start
            elif direction > 0 and far == high and near + step < far:
                number = near + step
            elif direction < 0 and near == low and far - step > near:
                number = far - step
            number = near + 1 if number <= near else far - 1 if number >= far else number
            found = self._sign_at(margin, from_ordinal(number))
            if found == 0:
                return from_ordinal(number)
            still = found == sign
            near, far = (number, far) if still else (near, number)
            direction = direction or (1 if still else -1)
            step = 2 * step or 1
        return from_ordinal(near if near > low else far)

    def _model_zero(self, g: Taylor, sign: int) -> float:
        near, far = -1.0, 1.0
        for _ in range(60):
            middle = near + 0.5 * (far - near)
            same = (g.at(middle) > 0) == (sign > 0)
            near, far = (middle, far) if same else (near, middle)
        return self.low + self.width * (0.5 + 0.5 * near)

    def _turn(self, g: Taylor, rises: bool, falls: bool) -> float:
        """Where a model turns round; the middle if it does not."""
        c = g.c
        near, far = -1.0, 1.0
        for _ in range(40 if rises != falls else 0):
            u = near + 0.5 * (far - near)
            same = (((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1] > 0) == rises
            near, far = (u, far) if same else (near, u)
        return self.low + self.width * (0.5 + 0.25 * (near + far))


def _plainly(formula: Formula, terms: Enclosed[Hull]) -> bool:
    """Whether a formula holds in every state; a margin that gets to zero is not plain."""
    match formula:
        case Truth(value):
            return value
        case Compare(op):
            low, high = terms.term(margin_of(formula))
            if op == "=":
                return low == 0 and high == 0
            return low > 0 or (op == "!=" and high < 0)
        case And(children):
            return all(_plainly(c, terms) for c in children)
        case Or(children):
            return any(_plainly(c, terms) for c in children)


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
