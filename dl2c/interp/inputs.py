"""Admissible values of `x := *` under the tests that follow (semantics 3), for the interpreter.

Comes in: the admissions of a straight line (`admission.py`), the state where it begins and the
values of inputs met before. Goes out: whether every input has a value that passes, and the value
that a request or a random number leads to. In doubles a piece of admissible values extends to the
outermost ones that pass the tests as they are evaluated, whatever its root was rounded to: the same
operations in the same order as cgen/runtime/admissible.h and actions.h. Rationals are exact, but for
square roots.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

from dl2c.interp.straight import Plan
from dl2c.ir.doubles import (
    bisected,
    bracket,
    edge,
    from_ordinal,
    ordinal,
    outermost,
    rounded_down,
    rounded_up,
)
from dl2c.ir.evaluate import Undefined, Value, evaluate, truth
from dl2c.ir.model import Symbol
from dl2c.ir.polynomial import Coefficients
from dl2c.paths.admission import Solved
from dl2c.paths.zeros import zeros

NEARBY = 8
"""Where nothing around a root passes, values up to 4^(NEARBY - 1) doubles away from it are tried."""

Piece: TypeAlias = tuple[Value, Value]
"""The ends of a closed interval of values that pass."""


@dataclass(slots=True)
class Inputs:
    """The inputs of a straight line in a state. `env` holds the state, and values of inputs so far:
    those in `met` are given, others are tried.
    """

    plan: Plan
    met: frozenset[Symbol]
    env: dict[Symbol, Value | None]
    exact: bool

    def open(self) -> bool:
        """Whether every test can be passed."""
        later = {a.following for a in self.plan.admissions}
        return all(self._any(k) for k in range(len(self.plan.admissions)) if k not in later)

    def nearest(self, key: str, wanted: Value) -> Value:
        """Gives an input the admissible value nearest to the one wanted, the lowest for a NaN."""
        place = self._place(key)
        low, high = self._box(place)
        if low <= wanted <= high and self._passes(place, wanted):
            return wanted
        return self._settled(place, *nearest(self._pieces(place), wanted))

    def spread(self, key: str, part: Value) -> Value:
        """Gives an input the value so far along the admissible ones, from 0 to 1."""
        place = self._place(key)
        return self._settled(place, *spread(self._pieces(place), part))

    def _place(self, key: str) -> int:
        return next(k for k, u in enumerate(self.plan.unknowns) if u.symbol.name == key)

    def _box(self, place: int) -> Piece:
        given = self.plan.unknowns[place]
        return (given.low, given.high) if self.exact else (rounded_up(given.low), rounded_down(given.high))

    # One value ------------------------------------------------------------------

    def _passes(self, place: int, value: Value) -> bool:
        """Whether the tests hold, and the inputs that share tests still have a value."""
        admission = self.plan.admissions[place]
        self.env[self.plan.unknowns[place].symbol] = value
        for solved in admission.solved:
            self.env[solved.symbol] = Fraction(1 if self._solves(solved) else 0)
        if not truth(admission.condition, self.env, self.exact):
            return False
        return admission.following is None or self._any(admission.following)

    def _any(self, place: int) -> bool:
        """Whether some value passes; of an input that was met, its own."""
        symbol = self.plan.unknowns[place].symbol
        if symbol in self.met:
            value = self.env[symbol]
            return value is not None and self._passes(place, value)
        return bool(self._pieces(place))

    def _settled(self, place: int, piece: Piece, value: Value) -> Value:
        """The value, or where rounding makes it fail the next one towards the nearer end of its piece."""
        if self._passes(place, value) or self.exact:
            return value
        low, high = piece

        def test(tried: float) -> bool:
            return self._passes(place, tried)

        end = low if value - low < high - value else high
        failing, passing = bracket(test, ordinal(float(value)), ordinal(float(end)), True)
        assert passing is not None, "the ends of a piece pass"
        settled = from_ordinal(bisected(test, passing, failing))
        self.env[self.plan.unknowns[place].symbol] = settled
        return settled

    # Roots ----------------------------------------------------------------------

    def _coefficients(self, polynomial: Coefficients) -> list[Value] | None:
        try:
            return [evaluate(c, self.env, self.exact) for c in polynomial]
        except Undefined:
            return None

    def _solves(self, solved: Solved) -> bool:
        """Whether the input is a root as computed; every value is one where all coefficients are zero."""
        c = self._coefficients(solved.polynomial)
        value = self.env[solved.input]
        if c is None or value is None:
            return False
        if all(x == 0 for x in c):
            return True
        box = self._box(self._place(solved.input.name))
        return value in zeros(c, *box, near=False, exact=self.exact)

    # Pieces ---------------------------------------------------------------------

    def _pieces(self, place: int) -> list[Piece]:
        """All values that pass, in order."""
        if self.plan.admissions[place].is_interval and not self.exact:
            return self._interval(place)
        pins = self._pins(place)
        if pins is not None:
            return [(root, root) for root in pins if self._passes(place, root)]
        tried = self._probes(place)
        passing = [self._passes(place, at) for at, _ in tried]
        for k, (_, critical) in enumerate(tried):
            if critical and 0 < k < len(tried) - 1 and not any(passing[k - 1 : k + 2]):
                found = None if self.exact else self._nearby(place, tried, k)
                if found is not None:
                    tried[k], passing[k] = (found, True), True
        pieces: list[Piece] = []
        k = 0
        while k < len(tried):
            first = k
            while k < len(tried) and passing[k]:
                k += 1
            if k > first:
                low = tried[0][0] if first == 0 else self._end(place, tried[first], tried[first - 1])
                high = tried[-1][0] if k == len(tried) else self._end(place, tried[k - 1], tried[k])
                pieces.append((low, high))
            k += 1
        return pieces

    def _pins(self, place: int) -> list[Value] | None:
        """The only values that an equality leaves, in order; None where there is none, or it is void."""
        pin = self.plan.admissions[place].pin
        c = None if pin is None else self._coefficients(pin)
        if c is None or all(x == 0 for x in c):
            return None
        low, high = self._box(place)
        found = zeros(c, low, high, near=len(c) <= 3, exact=self.exact)
        return sorted({r for r in found if low <= r <= high})

    def _interval(self, place: int) -> list[Piece]:
        """Between limits that are linear in the input."""
        box = low, high = self._box(place)
        for limit in self.plan.admissions[place].limits:
            c = self._coefficients((limit.offset, limit.slope))
            if c is None or c[1] == 0:
                continue
            root = -c[0] / c[1]
            if c[1] > 0 and root > low:
                low = root
            if c[1] < 0 and root < high:
                high = root

        def test(tried: float) -> bool:
            return self._passes(place, tried)

        least, most = float(box[0]), float(box[1])
        first, last = min(float(low), most), max(float(high), least)
        middle = first + (last - first) / 2
        bottom = outermost(test, first, middle, most, least)
        if bottom is None:
            return []
        top = outermost(test, max(last, bottom), middle, bottom, most)
        assert top is not None, "the bottom passes"
        return [(bottom, top)]

    def _probes(self, place: int) -> list[tuple[Value, bool]]:
        """Values to try, in order: the ends of the Box and the roots inside, which are critical, and one
        value between each two of them.
        """
        low, high = self._box(place)
        found = {low, high}
        admission = self.plan.admissions[place]
        for polynomial in (*admission.criticals, *((m.offset, m.slope) for m in admission.limits)):
            c = self._coefficients(polynomial)
            found.update(r for r in zeros(c or [], low, high, near=True, exact=self.exact) if low < r < high)
        critical = sorted(found)
        tried: list[tuple[Value, bool]] = [(critical[0], True)]
        for a, b in pairwise(critical):
            middle = a + (b - a) / 2
            tried += [(middle, False)] if a < middle < b else []
            tried.append((b, True))
        return tried

    def _nearby(self, place: int, tried: Sequence[tuple[Value, bool]], k: int) -> float | None:
        """A value next to a root that passes, where none of its neighbours among those tried does."""
        below, here, above = (ordinal(float(at)) for at, _ in tried[k - 1 : k + 2])
        for step in (4**n for n in range(NEARBY)):
            for number in (here - step, here + step):
                if below < number < above and self._passes(place, from_ordinal(number)):
                    return from_ordinal(number)
        return None

    def _end(self, place: int, inside: tuple[Value, bool], outside: tuple[Value, bool]) -> Value:
        """The outermost passing value between a passing and a failing one, near the critical of the two."""
        if self.exact:
            return self._exact_end(place, inside, outside)

        def test(tried: float) -> bool:
            return self._passes(place, tried)

        passing, failing = ordinal(float(inside[0])), ordinal(float(outside[0]))
        if inside[1]:
            return from_ordinal(edge(test, passing, failing))
        last, there = bracket(test, failing, passing, True)
        assert there is not None
        return from_ordinal(bisected(test, there, last))

    def _exact_end(self, place: int, inside: tuple[Value, bool], outside: tuple[Value, bool]) -> Value:
        """A root that passes, or a value near one that does not."""
        if inside[1]:
            return inside[0]
        distance = (inside[0] - outside[0]) / 2**60
        while not self._passes(place, outside[0] + distance):
            distance *= 2
        return outside[0] + distance


def nearest(pieces: Sequence[Piece], wanted: Value) -> tuple[Piece, Value]:
    """The value nearest to the one wanted, and its piece; the lower one of two, the lowest for a NaN."""
    last = pieces[0]
    if not wanted >= last[0]:
        return last, last[0]
    for piece in pieces:
        low, high = piece
        if wanted < low:
            return (last, last[1]) if wanted - last[1] <= low - wanted else (piece, low)
        if wanted <= high:
            return piece, wanted
        last = piece
    return last, last[1]


def spread(pieces: Sequence[Piece], part: Value) -> tuple[Piece, Value]:
    """The value so far along all pieces, from 0 to 1, and its piece. Single values have no length, and
    are equally likely where there is nothing else.
    """
    total = sum((high - low for low, high in pieces), start=part * 0)
    if not total > 0:
        piece = pieces[min(int(part * len(pieces)), len(pieces) - 1)]
        return piece, piece[0]
    along, last = total * part, pieces[0]
    for piece in pieces:
        low, high = piece
        if not high > low:
            continue
        last = piece
        if along <= high - low:
            return piece, min(low + along, high)
        along -= high - low
    return last, last[1]
