"""Motion as polynomials of time: cgen/runtime/pieces.h operation for operation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dl2c.flows import hull, taylor
from dl2c.flows.hull import Hull
from dl2c.flows.taylor import Taylor
from dl2c.ir.model import Symbol

TRACK_ROUNDING = 2.0**-46


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
