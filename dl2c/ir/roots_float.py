"""Zeros of one Bernstein curve in doubles: cgen/runtime/roots.h operation for operation.

That file says how it works and what is certain.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from dl2c.ir.doubles import from_ordinal, ordinal

AT_ONCE = 2.0**-1074
"""Where a margin changes its sign that has the other sign from the start."""

START_NOISE = 2.0**-20
"""Coefficients that contradict the start may be so large, relative to the largest."""

PARTS = 64
APPROACH = 24


@dataclass(frozen=True, slots=True)
class Part:
    """Coefficients on [low, high], each with a bound of its error."""

    low: float
    high: float
    b: list[float]
    e: list[float]


@dataclass(slots=True)
class Search:
    """A search from left to right. While `open`, [start, end] is one zero whose other side is not known."""

    sign: int
    open: bool = False
    start: float = 0.0
    end: float = 0.0
    found: list[tuple[float, int]] = field(default_factory=list[tuple[float, int]])

    def report(self, at: float, after: int) -> None:
        self.found.append((at, after))
        self.sign = after

    def close(self, after: int) -> None:
        """The other side of the open zero has this sign."""
        middle = self.start + 0.5 * (self.end - self.start)
        self.open = False
        self.report(middle if middle > self.start else self.end, after)


@dataclass(slots=True)
class Bracket:
    """Ordinals of doubles in a part with one zero: the first sign at `near`, the other one at `far`.

    `weights` are coefficients times binomials, without the curve's zeros at the ends.
    """

    low: float
    width: float
    weights: list[float]
    near: int
    far: int

    def value(self, s: float) -> float:
        """At s in the part, a continuous function with the signs of the curve there."""
        t = (s - self.low) / self.width
        if t <= 0.5:
            ratio, row = t / (1.0 - t), self.weights[::-1]
        else:
            ratio, row = (1.0 - t) / t, self.weights
        value = row[0]
        for w in row[1:]:
            value = value * ratio + w
        return value

    def probe(self, s: float) -> float:
        """The value at a place inside, which becomes the end on that side; both ends for a zero."""
        value = self.value(s)
        before = (value > 0.0) == (self.weights[0] > 0.0)
        if value == 0.0 or before:
            self.near = ordinal(s)
        if value == 0.0 or not before:
            self.far = ordinal(s)
        return value


def float_zeros(curve: Sequence[float], start: int) -> list[tuple[float, int]]:
    """Zeros in (0,1] in order, each with the sign just after it."""
    if any(start * b < 0.0 for b in curve):
        return _search(curve, Search(start))
    if start != 0 and curve[-1] == 0.0 and (after := sign_after_end(curve)) != 0:
        return [(1.0, after)]
    return []


def sign_after_end(curve: Sequence[float]) -> int:
    """The sign just after a zero at exactly 1: that before it, turned once for every zero coefficient."""
    turn = 1
    for b in reversed(curve):
        if b != 0.0:
            return turn if b > 0.0 else -turn
        turn = -turn
    return 0


def _search(curve: Sequence[float], search: Search) -> list[tuple[float, int]]:
    parts = [_prepared(curve, search.sign)]
    while parts:
        part = parts.pop()
        variations, first = _variations(part)
        middle = part.low + 0.5 * (part.high - part.low)
        divisible = part.low < middle < part.high and len(parts) + 1 < PARTS
        if first != 0 and variations > 1 and divisible:
            left, right = _split(part, middle)
            parts += [right, left]
        else:
            _settle(search, part, variations, first)
    if search.open:
        if curve[-1] == 0.0:
            search.report(1.0, sign_after_end(curve))
        else:
            search.close(1 if curve[-1] > 0.0 else -1)
    return search.found


def _prepared(curve: Sequence[float], start: int) -> Part:
    """The first part: the curve scaled by a power of two, without what contradicts the start."""
    _, exponent = math.frexp(max(abs(b) for b in curve))
    scaled: list[float] = []
    leading = True
    for coefficient in curve:
        b = math.ldexp(coefficient, -exponent)
        leading = leading and start * b <= 0.0 and abs(b) <= START_NOISE
        scaled.append(0.0 if leading else b)
    return Part(0.0, 1.0, scaled, [0.0] * len(scaled))


def _variations(part: Part) -> tuple[int, int]:
    """How many zeros are inside at most, 2 for more than one, and the first sign there, 0 for none."""
    variations = vague = first = last = 0
    for b, e in zip(part.b, part.e, strict=True):
        sign = (b > e) - (b < -e)
        if sign == 0:
            vague += e > 0.0
            continue
        if last == 0:
            first = sign
        else:
            variations += (sign != last) + 2 * (vague > (sign != last))
        last = sign
        vague = 0
    return min(variations, 2), first


def _split(part: Part, middle: float) -> tuple[Part, Part]:
    """The left and the right half."""
    b, e = list(part.b), list(part.e)
    left = Part(part.low, middle, [], [])
    for k in range(len(b) - 1, -1, -1):
        left.b.append(b[0])
        left.e.append(e[0])
        for i in range(k):
            total = b[i] + b[i + 1]
            second = total - b[i]
            lost = (b[i] - (total - second)) + (b[i + 1] - second)
            e[i] = (e[i] + e[i + 1] + abs(lost)) * (0.5 + 2.0**-51)
            b[i] = 0.5 * total
    return left, Part(middle, part.high, b, e)


def _settle(search: Search, part: Part, variations: int, first: int) -> None:
    """What a part that is not halved any more says, the parts before it being known."""
    if first == 0 or variations > 1:
        if not search.open:
            search.start = part.low
        search.open = True
        search.end = part.high
        return
    if search.open:
        search.close(first)
    elif first != search.sign:
        search.report(AT_ONCE, first)
    at = _refined(part) if variations == 1 else 0.0
    if 0.0 < at < part.high:
        search.report(at, -first)
    search.open = at == part.high or abs(part.b[-1]) <= part.e[-1]
    search.start = search.end = part.high


def _refined(part: Part) -> float:
    """The only zero inside: the last double before it, or the next one where that is the low end."""
    lowest = ordinal(part.low)
    bracket = Bracket(part.low, part.high - part.low, _weights(part), lowest, ordinal(part.high))
    start = ordinal(_approach(bracket))
    upward = start == bracket.near
    step = 1
    while step < bracket.far - bracket.near:
        number = bracket.near + step if upward else bracket.far - step
        bracket.probe(from_ordinal(number))
        if upward != (bracket.near == number):
            break
        step *= 2
    while bracket.far - bracket.near > 1:
        bracket.probe(from_ordinal(bracket.near + (bracket.far - bracket.near) // 2))
    return from_ordinal(bracket.near if bracket.near > lowest else bracket.far)


def _weights(part: Part) -> list[float]:
    """Coefficients times binomials, without those at both ends that may be zero."""
    degree = len(part.b) - 1
    certain = [k for k in range(degree + 1) if abs(part.b[k]) > part.e[k]]
    return [part.b[k] * float(math.comb(degree, k)) for k in range(certain[0], certain[-1] + 1)]


def _approach(bracket: Bracket) -> float:
    """Secant steps as long as they halve the value, else the midpoint. Returns the last place."""
    last, here = from_ordinal(bracket.near), from_ordinal(bracket.far)
    last_value, value = bracket.value(last), bracket.value(here)
    secant = True
    for _ in range(APPROACH):
        if bracket.far - bracket.near <= 1:
            break
        near, far = from_ordinal(bracket.near), from_ordinal(bracket.far)
        following = near + 0.5 * (far - near)
        if secant and value != last_value:
            step = value * ((here - last) / (value - last_value))
            if abs(step) <= 2.0**-52 * here:
                break
            if near < here - step < far:
                following = here - step
        if not near < following < far:
            break
        last, last_value = here, value
        here = following
        value = bracket.probe(here)
        secant = abs(value) <= 0.5 * abs(last_value)
    return here
