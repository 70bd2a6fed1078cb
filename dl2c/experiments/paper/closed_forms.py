"""What mathematics says of the paper's tests: when Test 2 ends, and how fast Test 3 can be.

Derivations are in docs/paper.md. All arguments are arrays of one length or numbers; times in seconds, lengths
in metres.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Values: TypeAlias = NDArray[np.float64]


def violation_time(d: Values, v: Values, A: Values, b: Values) -> Values:
    """How long one can accelerate with `A` from speed `v`, at a distance `d` from an obstacle, before the
    stopping distance with braking `b` reaches the distance that is left.

    The positive root t of (v + A*t)^2/(2*b) = d - v*t - A*t^2/2.
    """
    return (np.sqrt((b * v**2 + 2 * A * b * d) / (A + b)) - v) / A


@dataclass(frozen=True, slots=True)
class Course:
    """Initial states and constants of the waypoint model, at rest; `d` is the distance to the area."""

    d: Values
    ep: Values
    A: Values
    b: Values
    Vmax: Values


@dataclass(frozen=True, slots=True)
class Drive:
    """So many steps of acceleration, then of coasting, then braking from `speed`: `time` in all."""

    accelerating: Values
    coasting: Values
    speed: Values
    time: Values


def guarded_drive(course: Course) -> Drive:
    """The only drive that the guards admit if every decision holds for `ep`.

    Outside the area it accelerates while `v + A*ep <= Vmax`, else it coasts; inside it brakes. The third
    condition of the guards, the distance to stop behind the area's begin, always holds (see docs/paper.md).
    """
    c = course
    gain = c.A * c.ep
    fastest = np.floor(c.Vmax / gain)
    early = np.floor(np.sqrt(2 * c.d / c.A) / c.ep) + 1
    accelerating = np.minimum(fastest, early)
    speed = accelerating * gain
    left = c.d - c.A * (accelerating * c.ep) ** 2 / 2
    coasting = np.where(left >= 0, np.floor(left / (speed * c.ep)) + 1, 0)
    time = (accelerating + coasting) * c.ep + speed / c.b
    return Drive(accelerating, coasting, speed, time)


def fastest_time(course: Course) -> Values:
    """The infimum of the times of all runs of the model, whose decisions may hold for less than `ep`.

    They can coast with any speed above `Vmax - A*ep`, up to `Vmax`, and brake as soon as they are inside:
    v/A + (d - v^2/(2*A))/v + v/b, which is convex in v, at its least among these speeds. A course that is too
    short for them is one acceleration.
    """
    c = course
    reached = np.sqrt(2 * c.A * c.d)
    best = np.sqrt(c.d / (1 / (2 * c.A) + 1 / c.b))
    speed = np.minimum(np.clip(best, c.Vmax - c.A * c.ep, c.Vmax), reached)
    return speed / (2 * c.A) + c.d / speed + speed / c.b
