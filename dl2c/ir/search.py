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
TOGETHER = 16
"""Events that are at most so many doubles apart are one."""
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
                if stop is not None:
                    return Halt(place, True, found.sign_at)
                if leaves:
                    place = place if found.holds or not place > 0 else math.nextafter(place, 0.0)
                    return Halt(place, False, found.sign_at)
                signs = [0 if e else s for s, e in zip(found.sign_at, self.at_end, strict=True)]
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
        last: list[int] = []
        self.at_end = []
        for j, g in enumerate(models):
            sign = self._margin_events(j, g, events)
            if sign is None:
                return None
            last.append(sign)
        self.here, self.since = list(last), list(last)
        return events

    def _begin_signs(self) -> None:
        if self.known:
            return
        signs = [self._sign_at(j, self.low) for j in range(len(self.plan.margins))]
        self.here = [0 if s == 2 else s for s in signs]
        self.since = list(self.here)
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

    def _margin_events(self, j: int, g: Taylor, events: Events) -> int | None:
        """Adds what a margin does on the stretch; returns its sign at the end, None where that is open."""
        if g.lacks & taylor.LACKS_VALUE or not math.isfinite(g.c[0]):
            return self._keeps(j, 0, events, False, 0)
        came = self.since[j]
        always = taylor.sign(g)
        if always:
            return self._keeps(j, always, events, False, always)
        narrow = self.width <= NARROWEST or g.lacks != 0
        fine = (math.isfinite(g.r) and g.r <= taylor.FINE * g.e) or narrow
        c = g.c
        slope = abs(c[1]) - 2.0 * abs(c[2]) - 3.0 * abs(c[3]) - 4.0 * abs(c[4])
        first_value, last_value = g.at(-1.0), g.at(1.0)
        sure_first, sure_last = abs(first_value) > g.r, abs(last_value) > g.r
        if slope > 0 and (fine or (sure_first and sure_last)):
            first = _sign(first_value) if sure_first else came
            end = _sign(last_value) if sure_last else 0
            if first * end < 0 and not fine and not g.r * self.width <= slope * CLOSE:
                return None
            if first * end < 0:
                self._cross(j, self._change(j, g, first), end, events)
            if first and not sure_last:
                self._cross(j, self.low + self.width, 0, events)
            return self._keeps(j, first or end, events, not sure_last, end)
        if not narrow and not (fine and g.size <= 2.0 * g.r):
            return None
        if came != 0:
            self._cross(j, self._touch(g), 0, events)
        return self._keeps(j, came, events, True, 0)

    def _keeps(self, j: int, sign: int, events: Events, ends_at_zero: bool, last: int) -> int:
        events.at_start.append(self.here[j] if sign == self.since[j] else 0)
        events.after_start.append(sign)
        self.at_end.append(ends_at_zero)
        return last

    def _cross(self, j: int, place: float, after: int, events: Events) -> None:
        """A crossing at a place, or where others are that are not apart from it."""
        at = (place - self.low) / self.width
        for other in events.crossings:
            near = self.low + self.width * float(other.at)
            if abs(ordinal(near) - ordinal(place)) <= TOGETHER:
                at = other.at
        insort(events.crossings, Crossing(at, j, after), key=lambda c: (c.at, c.margin))

    def _change(self, margin: int, g: Taylor, sign: int) -> float:
        """Where a margin, whose model is monotone, leaves the side on which it was: a place where doubles
        make it zero, if one is met, else the last double before."""
        low, high = ordinal(self.low), ordinal(self.low + self.width)
        near, far = low, high
        start = ordinal(self._model_zero(g, sign))
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

    def _touch(self, g: Taylor) -> float:
        """Where a model that is nearly zero is nearest to it: at its extremum, else at an end."""
        c = g.c
        rises = c[1] - 2.0 * c[2] + 3.0 * c[3] - 4.0 * c[4] > 0
        falls = c[1] + 2.0 * c[2] + 3.0 * c[3] + 4.0 * c[4] > 0
        if rises == falls:
            at_low = abs(g.at(1.0)) > abs(g.at(-1.0)) and self.low > 0
            return self.low if at_low else self.low + self.width
        near, far = -1.0, 1.0
        for _ in range(40):
            u = near + 0.5 * (far - near)
            same = (((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1] > 0) == rises
            near, far = (u, far) if same else (near, u)
        return self.low + self.width * (0.5 + 0.5 * near)


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
