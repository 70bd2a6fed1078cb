"""Motions in one variable with closed forms, and when they first meet an interval."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from mpmath import mpf
from oracles.narrow_forms import Interval, high

Values = Mapping[str, float]
Roots = Callable[[Mapping[str, mpf], mpf, mpf], list[mpf]]


@dataclass(frozen=True)
class Motion:
    """x at a time, and all times before `end` at which x has a value; `draw` gives everything but c and w."""

    name: str
    equations: str
    variables: str
    at: Callable[[Mapping[str, mpf], mpf], mpf]
    roots: Roots
    draw: Callable[[Random], dict[str, float]]
    turns: Callable[[Values], list[float]] = lambda _: []
    """When x turns back, as a double."""

    def x(self, start: Values, time: Any) -> mpf:
        return self.at({name: high.mpf(value) for name, value in start.items()}, high.mpf(time))

    def meetings(self, start: Values, interval: Interval) -> list[mpf]:
        """When x is at either end of the interval, after the start and before `e`, in order."""
        exact = {name: high.mpf(value) for name, value in start.items()}
        times = [t for end in interval for t in self.roots(exact, end, exact["e"])]
        return sorted(t for t in times if 0 < t <= exact["e"])


def log_uniform(random: Random, low: float, up: float) -> float:
    """Between 10^low and 10^up."""
    return 10 ** random.uniform(low, up)


def signed(random: Random, low: float, up: float) -> float:
    return random.choice((-1, 1)) * log_uniform(random, low, up)


def straight(random: Random) -> dict[str, float]:
    end, speed = log_uniform(random, -1, 1), signed(random, -2, 2)
    return {"x": speed * end * random.uniform(-5, 5), "v": speed, "e": end}


def bent(random: Random) -> dict[str, float]:
    """The turning point lies before, within or after the flow."""
    start = straight(random)
    return start | {"a": -2 * start["v"] / start["e"] * random.uniform(-1, 2)}


def quadratic(start: Mapping[str, mpf], value: mpf, _: mpf) -> list[mpf]:
    """The roots of x + v t + a t^2/2, without cancellation."""
    a, b, c = start["a"] / 2, start["v"], start["x"] - value
    if a == 0:
        return [-c / b]
    under = b * b - 4 * a * c
    if under < 0:
        return []
    q = -(b + (1 if b >= 0 else -1) * high.sqrt(under)) / 2
    return [q / a, *([c / q] if q else [])]


def turning(random: Random) -> dict[str, float]:
    end = log_uniform(random, -1, 1)
    size = log_uniform(random, -1, 1)
    return {
        "x": size * random.uniform(-1, 1),
        "y": size * random.uniform(-1, 1),
        "k": random.uniform(0.3, 9) / end,
        "e": end,
    }


def crossings(start: Mapping[str, mpf], value: mpf, end: mpf) -> list[mpf]:
    """x cos(kt) + y sin(kt) is r cos(kt - p)."""
    x, y, k = start["x"], start["y"], start["k"]
    ratio = value / high.hypot(x, y)
    if abs(ratio) > 1:
        return []
    middle, off = high.atan2(y, x), high.acos(ratio)
    rounds = range(-2, int(k * end / (2 * high.pi)) + 3)
    return [(middle + side * off + 2 * high.pi * n) / k for n in rounds for side in (1, -1)]


def falling(random: Random) -> dict[str, float]:
    end = log_uniform(random, -1, 1)
    return {"x": signed(random, -2, 2), "k": random.choice((-1, 1)) * random.uniform(0.1, 3) / end, "e": end}


def growing(random: Random) -> dict[str, float]:
    end = log_uniform(random, -1, 1)
    return {
        "x": random.uniform(0.05, 0.95),
        "k": random.choice((-1, 1)) * random.uniform(0.1, 3) / end,
        "e": end,
    }


def hyperbola(random: Random) -> dict[str, float]:
    end = log_uniform(random, -1, 1)
    x = log_uniform(random, -1, 1)
    return {"x": x, "k": random.uniform(0.1, 3) / (end * x), "e": end}


def once(function: Callable[[mpf, Mapping[str, mpf]], mpf | None]) -> Roots:
    """The one time at which a monotone motion has a value, if any."""

    def roots(start: Mapping[str, mpf], value: mpf, _: mpf) -> list[mpf]:
        time = function(value, start)
        return [] if time is None else [time]

    return roots


def logistic(value: mpf, start: Mapping[str, mpf]) -> mpf | None:
    if not 0 < value < 1:
        return None
    return (high.log(value / (1 - value)) - high.log(start["x"] / (1 - start["x"]))) / start["k"]


LINE = Motion(
    "line", "x'=v", "v", lambda s, t: s["x"] + s["v"] * t, once(lambda c, s: (c - s["x"]) / s["v"]), straight
)
CURVE = Motion(
    "curve",
    "x'=v,v'=a",
    "v a",
    lambda s, t: s["x"] + s["v"] * t + s["a"] * t * t / 2,
    quadratic,
    bent,
    lambda s: [-s["v"] / s["a"]],
)
ROTATION = Motion(
    "rotation",
    "x'=k*y,y'=-k*x",
    "y k",
    lambda s, t: s["x"] * high.cos(s["k"] * t) + s["y"] * high.sin(s["k"] * t),
    crossings,
    turning,
    lambda s: [(math.atan2(s["y"], s["x"]) + n * math.pi) / s["k"] for n in range(-1, 6)],
)
DECAY = Motion(
    "decay",
    "x'=-k*x",
    "k",
    lambda s, t: s["x"] * high.exp(-s["k"] * t),
    once(lambda c, s: high.log(s["x"] / c) / s["k"] if s["x"] * c > 0 else None),
    falling,
)
LOGISTIC = Motion(
    "logistic",
    "x'=k*x*(1-x)",
    "k",
    lambda s, t: 1 / (1 + (1 / s["x"] - 1) * high.exp(-s["k"] * t)),
    once(logistic),
    growing,
)
HYPERBOLA = Motion(
    "hyperbola",
    "x'=-k*x^2",
    "k",
    lambda s, t: s["x"] / (1 + s["k"] * s["x"] * t),
    once(lambda c, s: (s["x"] / c - 1) / (s["k"] * s["x"]) if c > 0 else None),
    hyperbola,
)


def beside(motion: Motion, equation: str) -> Motion:
    """The same motion of x, while q moves as well, which decides how the flow is followed."""
    return Motion(
        f"{motion.name} beside {equation}",
        f"{motion.equations},{equation}",
        f"{motion.variables} q",
        motion.at,
        motion.roots,
        lambda random: motion.draw(random) | {"q": 0.5},
        motion.turns,
    )


MOTIONS: dict[str, tuple[Motion, ...]] = {
    "exact": (LINE, CURVE),
    "linear": (beside(LINE, "q'=-q"), beside(CURVE, "q'=-q"), ROTATION, DECAY),
    "cvodes": (LINE, CURVE, ROTATION, LOGISTIC, HYPERBOLA, beside(LINE, "q'=q*(1-q)")),
    "dopri5": (LINE, CURVE, ROTATION, LOGISTIC, HYPERBOLA, beside(LINE, "q'=q*(1-q)")),
}
"""What each kernel follows; the last of the solvers moves x as exactly as they can."""

INTEGRATOR = {"exact": "exact", "linear": "auto", "cvodes": "cvodes", "dopri5": "dopri5"}
