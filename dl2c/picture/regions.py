"""Which part of a plane of two variables the model's conditions allow."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.arrays import truths
from dl2c.ir.logic import conjunction
from dl2c.ir.model import Formula, Model, Symbol
from dl2c.picture.track import Track, symbols_at

POINTS = 240
"""Of a grid, along each axis."""


@dataclass(frozen=True, slots=True)
class Region:
    """Where on a grid (y, x) states are safe, and where they are in the domain of some flow."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    safe: NDArray[np.bool_]
    inside: NDArray[np.bool_]


def region(
    model: Model, track: Track, names: tuple[str, str], xs: tuple[float, float], ys: tuple[float, float]
) -> Region:
    """The plane of two variables, everything else as at the end of the track."""
    x, y = np.linspace(*xs, POINTS), np.linspace(*ys, POINTS)
    grid = np.meshgrid(x, y)
    columns = {**symbols_at(model, track.states[-1])}
    columns |= {Symbol(name, "variable"): g for name, g in zip(names, grid, strict=True)}
    safe = conjunction(p.formula for p in model.predicates if p.category == "safety")

    def where(formula: Formula) -> NDArray[np.bool_]:
        return np.broadcast_to(truths(formula, columns), grid[0].shape)

    inside = np.zeros(grid[0].shape, np.bool_)
    for flow in model.flows:
        inside = inside | where(flow.watched)
    return Region(x, y, where(safe), inside if model.flows else ~inside)
