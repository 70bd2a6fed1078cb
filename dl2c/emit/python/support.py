# pyright: basic
"""What environments in plain Python have in common: `pure` copies what a model needs of it.

Never imported. What is declared first is written for each model.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise, zip_longest
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

State = Any
SAFETY: Any = None
OBLIGATIONS: Any = None
TOLERANCE = 1e-9
METHOD = "DOP853"
RTOL = 1e-10
ATOL = 1e-12

# Arithmetic


def divide(a, b):
    """a / b; NaN, which fails every comparison, where b is zero."""
    return a / b if b else a * math.nan


def least(a, b):
    """The smaller one; NaN where either is."""
    return a if a < b else b if b <= a else math.nan


def greatest(a, b):
    """The larger one; NaN where either is."""
    return a if a > b else b if b >= a else math.nan


def sqrt(x):
    """NaN where there is no root."""
    return math.sqrt(x) if x >= 0 else math.nan


def exp(x):
    """NaN where it overflows."""
    return math.exp(x) if x < 709 else math.nan


def value_of(function, *args):
    """NaN where it has no value, or too large a one."""
    try:
        return function(*args)
    except (ValueError, OverflowError):
        return math.nan


def defined(value):
    """The value, or 0 where there is none."""
    return value if abs(value) <= 1e100 else 0.0


def slack(*terms):
    """What a comparison of sums of these terms may be off by."""
    return defined(TOLERANCE * (1 + sum(map(abs, terms))))


def less(a, b, slack):
    """a < b, but for rounding."""
    return a < b + slack


def at_most(a, b, slack):
    """a <= b, but for rounding."""
    return a <= b + slack


def equal(a, b, slack):
    """a = b, but for rounding."""
    return abs(a - b) <= slack


def real_roots(c: Sequence[float]) -> list[float]:
    """Where c[0] + c[1]*u + c[2]*u**2 + ... is zero; the real parts of complex roots too."""
    c = [float(x) for x in c]
    while c and c[-1] == 0:
        c.pop()
    if len(c) < 2 or not all(map(math.isfinite, c)):
        return []
    if len(c) == 2:
        return [-c[0] / c[1]]
    if len(c) > 3:
        return np.polynomial.polynomial.polyroots(c).real.tolist()
    inner = c[1] * c[1] - 4 * c[2] * c[0]
    if inner <= 0:
        return [-c[1] / (2 * c[2])]
    far = -(c[1] + math.copysign(math.sqrt(inner), c[1])) / 2
    return [far / c[2], c[0] / far]


# Continuous actions


def nearest(
    wanted: float,
    low: float,
    high: float,
    passes: Callable[[float], bool],
    criticals: Sequence[Sequence[float]],
) -> float | None:
    """The value that passes and is nearest to the one wanted; None where none does.

    Whether values pass may change at roots of the polynomials `criticals` only.
    """
    roots = [r for c in criticals for r in real_roots(c) if low < r < high]
    ends = sorted({low, high, *roots})
    ulps = [k * math.ulp(1.0) for n in range(8) for k in (4**n, -(4**n))]
    tried = [wanted, *ends, *((a + b) / 2 for a, b in pairwise(ends))]
    tried += [end + ulp * max(abs(end), 1e-300) for end in ends for ulp in ulps]
    inside = sorted(
        (u for u in tried if low <= u <= high), key=lambda u: abs(u - wanted)
    )
    return next((u for u in inside if passes(u)), None)


# Motion


class Failed(Exception):
    """A motion cannot be followed: its solver gave up."""


class Motion(NamedTuple):
    """Motion from one state: how long clocks let it last, the state at a time, and times between
    neighbours of which no condition changes twice. `clocks` have so much time left, and end there.
    """

    until: float
    at: Callable[[float], State]
    times: list[float]
    clocks: dict[str, tuple[float, float]]


class Flow(NamedTuple):
    """A differential equation: its motion, its domain, and the bounds of variables in the domain.

    Where motion ends at a bound, the variable is set to it: (name, whether it is kept, its value).
    """

    motion: Callable[[State], Motion]
    domain: Callable[[State], bool]
    bounds: tuple[tuple[str, Callable[[State], bool], Callable[[State], float]], ...]


class Polynomial:
    """A polynomial of time: c[0] + c[1] * tau + c[2] * tau**2 + ..."""

    def __init__(self, *c: float) -> None:
        self.c = c

    def __add__(self, other: Any) -> "Polynomial":
        pairs = zip_longest(self.c, coefficients(other), fillvalue=0.0)
        return Polynomial(*(a + b for a, b in pairs))

    def __neg__(self) -> "Polynomial":
        return Polynomial(*(-a for a in self.c))

    def __sub__(self, other: Any) -> "Polynomial":
        return self + -other

    def __rsub__(self, other: Any) -> "Polynomial":
        return -self + other

    def __mul__(self, other: Any) -> "Polynomial":
        product = [0.0] * (len(self.c) + len(coefficients(other)) - 1)
        for i, a in enumerate(self.c):
            for j, b in enumerate(coefficients(other)):
                product[i + j] += a * b
        return Polynomial(*product)

    def __truediv__(self, other: float) -> "Polynomial":
        return Polynomial(*(a / other for a in self.c))

    def __pow__(self, exponent: int) -> "Polynomial":
        return self if exponent == 1 else self * self ** (exponent - 1)

    __radd__, __rmul__ = __add__, __mul__


def coefficients(part: Any) -> tuple[float, ...]:
    """Those of a polynomial, or of a number."""
    return part.c if isinstance(part, Polynomial) else (part,)


def event_times(margins: Sequence[Any], until: float) -> list[float]:
    """Times between neighbours of which no margin, a polynomial of time, changes its sign."""
    found = {0.0, until}
    for margin in margins:
        c = coefficients(margin)
        slope = [k * a for k, a in enumerate(c)][1:]
        roots = real_roots(c) + real_roots(slope)
        found.update(t for t in roots if 0 < t < until)
    return with_middles(sorted(found))


def with_middles(times: list[float]) -> list[float]:
    """The times, and the middle between each two of them."""
    return [t for a, b in pairwise(times) for t in (a, (a + b) / 2)] + times[-1:]


def sampled_times(
    at: Callable[[float], State], margins: Callable[[State], list[float]], nodes: Any
) -> list[float]:
    """The nodes, and between them where a margin is largest or smallest, by parabolas through three."""
    values = np.array([margins(at(t)) for t in nodes], dtype=float)
    found = {float(t) for t in nodes}
    (a, b, c), (u, v, w) = (
        [x[k : len(x) - 2 + k] for k in range(3)] for x in (nodes, values)
    )
    for left, right, p, q, r in zip(b - a, c - b, u, v, w, strict=True):
        turning = (q - p) * (r - q) <= 0
        for k in np.flatnonzero(turning & (p != q)):
            first, second = (q[k] - p[k]) / left, (r[k] - q[k]) / right
            found.add(float(left * first / (first - second) + (left - right) / 2))
    return sorted(t for t in found if 0 <= t <= nodes[-1])


def integrated(
    s: State,
    names: Sequence[str],
    rates: Callable[[State], list[float]],
    margins: Callable[[State], list[float]],
    until: float,
    clocks: dict[str, tuple[float, float]],
) -> Motion:
    """Motion by SciPy's solver. Raises `Failed`."""
    if until <= 0:
        return Motion(until, lambda tau: s, [0.0], clocks)

    def reached(y: Any) -> State:
        return replace(s, **dict(zip(names, y.tolist(), strict=True)))

    done = solve_ivp(
        lambda tau, y: rates(reached(y)),
        (0.0, until),
        [getattr(s, name) for name in names],
        METHOD,
        rtol=RTOL,
        atol=ATOL,
        dense_output=True,
    )
    if not done.success or not np.isfinite(done.y).all():
        raise Failed

    @cache
    def at(tau: float) -> State:
        if 0 < tau < until:
            return reached(done.sol(tau))
        return reached(done.y[:, -1]) if tau else s

    nodes = np.unique([np.linspace(a, b, 9) for a, b in pairwise(done.t)])
    return Motion(until, at, sampled_times(at, margins, nodes), clocks)


def first_failure(
    holds: Callable[[float], bool], times: Sequence[float]
) -> tuple[float, float] | None:
    """The last time before a condition first fails, and the one after; None where it never does."""
    before = times[0]
    if not holds(before):
        return before, before
    for after in times[1:]:
        if not holds(after):
            low, high, middle = before, after, (before + after) / 2
            while low < middle < high and high - low > times[-1] * 2**-54:
                low, high = (middle, high) if holds(middle) else (low, middle)
                middle = (low + high) / 2
            return low, high
        before = after
    return None


def follow(flow: Flow, s: State) -> tuple[State, float, set[str], set[str]]:
    """Where a flow leads, how long it takes, and the predicates that failed or were met on the way."""
    motion = flow.motion(s)
    if not motion.until > 0:
        return s, 0.0, *watched(lambda tau: s, [0.0])[1:]
    tau, end = motion.until, motion.at(motion.until)
    for clock, (left, bound) in motion.clocks.items():
        if left == motion.until:
            end = replace(end, **{clock: bound})

    def at(time: float) -> State:
        return end if time == motion.until else motion.at(time)

    left_at = first_failure(lambda time: flow.domain(at(time)), motion.times)
    if left_at is not None:
        tau, beyond = left_at[0], at(left_at[1])
        met = [(name, value) for name, kept, value in flow.bounds if not kept(beyond)]
        end = replace(motion.at(tau), **{name: value(s) for name, value in met})
    if tau == 0:
        end = s

    def on_the_way(time: float) -> State:
        return end if time == tau else motion.at(time)

    cut, failed, met = watched(on_the_way, [*(t for t in motion.times if t < tau), tau])
    return (end if cut == tau else motion.at(cut)), cut, failed, met


def watched(
    at: Callable[[float], State], times: list[float]
) -> tuple[float, set[str], set[str]]:
    """When motion is cut short, and the predicates that failed or were met until then."""
    start = at(times[0])
    failures = {
        name: first_failure(lambda time, holds=holds: holds(at(time), start), times)
        for name, (holds, _) in SAFETY.items()
    }
    stops = [found for name, found in failures.items() if found and SAFETY[name][1]]
    cut, last = min(stops, default=(times[-1], times[-1]))
    failed = {name for name, found in failures.items() if found and found[1] <= last}
    met = set()
    for name, (due, holds) in OBLIGATIONS.items():

        def waits(time: float, due: Any = due, holds: Any = holds) -> bool:
            return not due(at(time)) and not holds(at(time), start)

        found = first_failure(waits, times)
        if found and found[1] <= last:
            (met if holds(at(found[1]), start) else failed).add(name)
    return cut, failed, met
