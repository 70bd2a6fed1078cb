"""The search along a track for where a flow ends, stretch by stretch.

The same operations in the same order as cgen/runtime/search.h, for motions that are polynomials of time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dl2c.flows import hull
from dl2c.flows.enclosed import Enclosed
from dl2c.flows.events import Events, exit_of, watched
from dl2c.flows.hull import Hull
from dl2c.flows.stretch import Stretch
from dl2c.ir.evaluate import Undefined
from dl2c.ir.logic import true_where
from dl2c.ir.margins import margin_of
from dl2c.ir.model import Compare, Formula, Symbol

LOOKS = 1 << 14
"""Stretches of a track; where more are needed, its events count as not found."""


class TooManyLooks(Undefined):
    """The search for events takes too long."""


@dataclass(frozen=True, slots=True)
class Halt:
    """Where a motion ends: at `place` on its track, from 0 to 1, `cut` by a violation or else by its domain;
    `signs` are those of the margins there.
    """

    place: float
    cut: bool
    signs: Sequence[int]


@dataclass(slots=True)
class Search:
    """The search for the end of a motion along the track of `stretch`. `waiting` are the watches still open;
    `failed` and `met` collect what became of the others.
    """

    stretch: Stretch
    waiting: Sequence[int]
    failed: list[int] = field(default_factory=list[int])
    met: list[int] = field(default_factory=list[int])

    def along(self, bounded: bool) -> Halt | Sequence[int]:
        """Where the motion ends; the signs at the end of the track if it does not. With `bounded` the domain
        may end it too, not only a violation. Raises `TooManyLooks`.
        """
        stretch, plan = self.stretch, self.stretch.plan
        plain: Sequence[int] = [1] * len(plan.margins)
        if not plan.margins or self._calm(stretch.track.hulls(), bounded):
            return plain
        signs = plain
        stretch.clear = 0.0
        looks, vague = 0, False
        while stretch.low < 1:
            looks += 1
            if looks > LOOKS:
                raise TooManyLooks
            half = 0.5 * stretch.width
            models = stretch.track.models(stretch.low + half, half)
            calm = stretch.width < 1 and self._calm({s: m.hull for s, m in models.items()}, bounded)
            events = None if calm else stretch.events(models)
            if not calm and events is None:
                stretch.width *= 0.5
                continue
            begins_vague = vague
            if not begins_vague:
                stretch.clear = stretch.low
            vague = not calm and any(stretch.at_end)
            found = plain if events is None else self._ending(events, bounded)
            if isinstance(found, Halt):
                if not begins_vague and not vague:
                    stretch.clear = found.place
                return found
            signs = found
            stretch.next()
        return signs

    def _ending(self, events: Events, bounded: bool) -> Halt | Sequence[int]:
        """Where these events end the motion on a stretch; the signs at its end if they do not."""
        stretch, plan = self.stretch, self.stretch.plan
        found = exit_of(plan.domain, plan.margins, events)
        leaves = bounded and found.found
        limit = found.at if leaves else 1.0
        stop, failed, met = watched(plan, self.waiting, events, limit)
        self.failed += failed
        self.met += met
        self.waiting = [w for w in self.waiting if w not in (*failed, *met)]
        place = stretch.low + stretch.width * float(limit if stop is None else stop)
        signs: Sequence[int] = found.sign_at
        if limit >= 1 or not limit > 0:
            zero = stretch.at_end if limit >= 1 else stretch.at_start
            signs = [0 if z else s for s, z in zip(signs, zero, strict=True)]
        if stop is not None:
            return Halt(place, True, signs)
        if leaves:
            place = place if found.holds or not place > 0 else math.nextafter(place, 0.0)
            return Halt(place, False, signs)
        return signs

    def _calm(self, state: Mapping[Symbol, Hull], bounded: bool) -> bool:
        """Whether waiting watches, and with `bounded` the domain, surely hold in all states within hulls."""
        env, moves = self.stretch.env, self.stretch.moves
        terms = Enclosed(hull.FUNCTIONS, lambda a: hull.hull_of(a, a), state, env, moves)
        domain, *stays = self.stretch.plan.written
        calm = (not bounded or _plainly(domain, terms)) and all(
            _plainly(stays[w], terms) for w in self.waiting
        )
        if calm:
            self.stretch.known = False
            self.stretch.begun = True
        return calm


def _plainly(formula: Formula, terms: Enclosed[Hull]) -> bool:
    """Whether a formula surely holds in all enclosed states, inequalities with margins that are not 0."""

    def plainly(atom: Compare) -> bool:
        low, high = terms.term(margin_of(atom))
        if atom.op == "=":
            return low == 0 and high == 0
        return low > 0 or (atom.op == "!=" and high < 0)

    return true_where(formula, plainly)
