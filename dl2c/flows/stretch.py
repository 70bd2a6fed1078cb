"""What the margins of a flow do on a stretch of a track: every change of sign is bracketed.

The same operations in the same order as cgen/runtime/stretch.h, which says what is certain.
"""

import math
from bisect import insort
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from dl2c.flows import hull, taylor
from dl2c.flows.enclosed import Enclosed, in_doubles
from dl2c.flows.events import Crossing, Events
from dl2c.flows.kernel import FlowPlan, constant_along
from dl2c.flows.pieces import Track
from dl2c.flows.taylor import Taylor
from dl2c.ir.doubles import from_ordinal, ordinal
from dl2c.ir.evaluate import Valuation
from dl2c.ir.model import Symbol, Term

NARROWEST = 2.0**-50
"""Stretches are not halved below this part of a track."""
CLOSE = 2.0**-44
"""A change of sign is bracketed well enough within this part of a track."""
TOGETHER = 2.0**-49
"""Events count as one if they are no further from each other than this, relative to their place."""


@dataclass(frozen=True, slots=True)
class Leg:
    """What is known of a margin at the end of a stretch. `near`: it comes so near to zero that its sign is
    the one before."""

    sign: int
    near: bool


@dataclass(slots=True)
class Stretch:
    """A part of a track, from `low` on, and what is known where it begins: the signs of margins `here` and
    just `since`, and whether they were nearly zero just before. `clear` is where rounding last told all
    margins from zero."""

    plan: FlowPlan
    env: Valuation
    track: Track
    low: float = 0.0
    width: float = 1.0
    clear: float = 1.0
    begun: bool = False
    known: bool = False
    here: list[int] = field(default_factory=list[int])
    since: list[int] = field(default_factory=list[int])
    near: list[bool] = field(default_factory=list[bool])
    at_start: list[bool] = field(default_factory=list[bool])
    at_end: list[bool] = field(default_factory=list[bool])

    def next(self) -> None:
        """Goes on to the next stretch of the track, as long as the halvings so far allow."""
        self.begun = True
        self.low += self.width
        if math.fmod(self.low, 2.0 * self.width) == 0:
            self.width *= 2.0

    def moves(self, term: Term) -> bool:
        return not constant_along(term, self.plan.flow)

    def _models(self, state: Mapping[Symbol, Taylor]) -> list[Taylor]:
        """Of all margins."""
        terms = Enclosed(taylor.FUNCTIONS, taylor.number, state, self.env, self.moves)
        return [terms.term(m) for m in self.plan.margins]

    def events(self, state: Mapping[Symbol, Taylor]) -> Events | None:
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
            self._turns_near(j, self._turn(g, first_slope > 0, last_slope > 0), came, events)
        return leg

    def _keeps(self, j: int, sign: int, turned: bool, events: Events) -> Leg:
        """Notes the sign over the stretch, as far as it does not change; `turned`: it was near zero."""
        events.at_start.append(self.here[j] if sign == self.since[j] and not turned else 0)
        events.after_start.append(sign)
        self.at_end.append(False)
        return Leg(sign, False)

    def _sure_sign(self, margin: int, place: float) -> int:
        """The sign of a margin at a place, 0 if rounding may change it: that of the margin, or that of the
        state, by the margin's slopes."""
        there = self.track.models(place, 0.0)
        exact = {x: taylor.number(t.c[0]) for x, t in there.items()}
        low, high = self._models(exact)[margin].hull
        off = 0.0
        for x, t in there.items():
            if t.e == 0 or not (low > off or high < -off):
                continue
            moved = replace(
                exact[x],
                c=(t.c[0], t.e, 0.0, 0.0, 0.0),
                hull=hull.hull_of(t.c[0] - 2.0 * t.e, t.c[0] + 2.0 * t.e),
            )
            g = self._models({**exact, x: moved})[margin]
            off += g.spread if math.isfinite(g.r) else math.inf
        return (low > off) - (high < -off)

    def _surely_passed(self, margin: int, place: float, sign: int) -> bool:
        """Whether a margin that had a sign surely has the other one at a place."""
        return self._sign_at(margin, place) == -sign and self._sure_sign(margin, place) == -sign

    def _last_of(self, margin: int, start: float, end: float, sign: int) -> float:
        """The last double between two places before a margin, as doubles compute it, loses a sign; or where
        it is zero."""
        near, far = ordinal(start), ordinal(end)
        while far - near > 1:
            number = near + (far - near) // 2
            found = self._sign_at(margin, from_ordinal(number))
            if found == 0:
                return from_ordinal(number)
            near, far = (number, far) if found == sign else (near, number)
        return from_ordinal(near)

    def _comes_near(self, j: int, sign: int, events: Events) -> Leg:
        """So near to zero at the end of the stretch that only its value there can tell whether it is."""
        end = self.low + self.width
        zero = self._sign_at(j, end) == 0
        if not zero and not self._surely_passed(j, end, sign):
            return Leg(sign, True)
        after = 0 if zero else -sign
        self.at_end[j] = zero
        self._cross(j, end if zero else self._last_of(j, self.low, end, sign), after, events)
        return Leg(after, False)

    def _turns_near(self, j: int, turn: float, sign: int, events: Events) -> None:
        """It turns round so near to zero that only its value there can tell whether it passes it."""
        if not self._surely_passed(j, turn, sign):
            self._cross(j, turn, sign, events)
            return
        end = self.low + self.width
        self._cross(j, self._last_of(j, self.low, turn, sign), -sign, events)
        self._cross(j, self._last_of(j, turn, end, -sign), sign, events)

    def _cross(self, j: int, place: float, after: int, events: Events, vague: float = 0.0) -> None:
        """A crossing at a place, or at that of another one which rounding does not distinguish; `vague` is
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
        """About where the model, which is monotone, is zero: by Newton's method between two signs."""
        c = g.c
        near, far, u = -1.0, 1.0, 0.0
        for _ in range(60):
            value = g.at(u)
            slope = ((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1]
            same = (value > 0) == (sign > 0)
            near, far = (u, far) if same else (near, u)
            following = u - value / slope if slope != 0 else math.nan
            if abs(following - u) <= TOGETHER:
                break
            u = following if near < following < far else near + 0.5 * (far - near)
        return self.low + self.width * (0.5 + 0.5 * u)

    def _turn(self, g: Taylor, rises: bool, falls: bool) -> float:
        """Where a model turns round; the middle if it does not."""
        c = g.c
        near, far = -1.0, 1.0
        for _ in range(40 if rises != falls else 0):
            u = near + 0.5 * (far - near)
            same = (((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1] > 0) == rises
            near, far = (u, far) if same else (near, u)
        return self.low + self.width * (0.5 + 0.25 * (near + far))


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
