"""The bounds of a network's outputs on boxes, as cgen/verify/forms.h and network.h compute them, in numpy.

All boxes are looked at together, with one product of matrices for each layer and part of its forms. This is
the row that `dl2c bench --verify` compares with.
"""

from dataclasses import dataclass

import numpy as np

from dl2c.native.boxes import Doubles, Tables
from dl2c.policy_proof.tables import ACTIVATIONS

ROUNDOFF = 2.0**-53
LEAST = float(np.finfo(float).tiny)


@dataclass(frozen=True, slots=True)
class Forms:
    """Numbers of one layer on n boxes: `part` (n, 1 + dimensions, width) is the value at the middle and the
    slopes; `radius` and `size` (n, width) are how far off it may be, and bounds of the magnitude.
    """

    part: Doubles
    radius: Doubles
    size: Doubles


@dataclass(frozen=True, slots=True)
class Lines:
    """Of one layer, (n, width) each: sizes and errors of its sums, and the lines around its activation."""

    scope: Doubles
    error: Doubles
    extent: Doubles
    slope: tuple[Doubles, Doubles]
    offset: tuple[Doubles, Doubles]
    after: float


@dataclass(frozen=True, slots=True)
class NumpyBounds:
    """Bounds for the network of one question."""

    tables: Tables

    def ranges(self, boxes: Doubles) -> Doubles:
        """The outputs on boxes (n, dimensions, 2), scaled as requests: (n, outputs, 2), low and high."""
        middle = boxes[:, :, 0] + 0.5 * (boxes[:, :, 1] - boxes[:, :, 0])
        half = np.maximum(boxes[:, :, 1] - middle, middle - boxes[:, :, 0])
        seen = self._observed(middle, half)
        forms, lines = seen, list[Lines]()
        for kind, weight, bias in self.tables.layers:
            forms, around = self._layer(forms, kind, weight, bias)
            lines.append(around)
        found = [self._output(seen, lines, *output) for output in self.tables.outputs]
        return np.stack(found, axis=1)

    def _observed(self, middle: Doubles, half: Doubles) -> Forms:
        n, dimensions = middle.shape
        count = len(self.tables.observations)
        part = np.zeros((n, 1 + dimensions, count))
        radius, size = np.empty((n, count)), np.empty((n, count))
        for k, (dimension, value, relative, absolute, scales) in enumerate(self.tables.observations):
            part[:, 0, k] = value if dimension < 0 else middle[:, dimension]
            exact = np.abs(part[:, 0, k])
            if dimension >= 0:
                part[:, 1 + dimension, k] = half[:, dimension]
                exact = exact + half[:, dimension]
            radius[:, k] = exact * relative + absolute
            size[:, k] = exact + radius[:, k]
            for scale in scales:
                self._scaled(part[:, :, k], radius[:, k], size[:, k], scale)
        return Forms(part, radius, size)

    def _scaled(self, part: Doubles, radius: Doubles, size: Doubles, scale: tuple[float, ...]) -> None:
        """slope * x + offset, clipped; changes its arguments."""
        slope, offset, extra, least, most = scale
        unit, tiny, _, _ = self.tables.arithmetic
        scope = abs(slope) * size + extra
        radius[:] = abs(slope) * radius + 16.0 * (ROUNDOFF + unit) * scope + 16.0 * (tiny + LEAST)
        part *= slope
        part[:, 0] += offset
        reach = radius + np.abs(part[:, 1:]).sum(axis=1)
        low, high = part[:, 0] - reach, part[:, 0] + reach
        excess = np.maximum(0.0, np.maximum(least - low, high - most))
        start, end = np.clip(low, least, most), np.clip(high, least, most)
        beyond = excess > reach
        part[:, 0] = np.where(beyond, start + 0.5 * (end - start), part[:, 0])
        part[:, 1:][beyond] = 0.0
        rounding = (np.abs(start) + np.abs(end)) * 2.0**-50 + LEAST
        radius[:] = np.where(beyond, (end - start) + rounding, radius + excess)
        size[:] = np.abs(part).sum(axis=1) + radius

    def _layer(self, given: Forms, kind: int, weight: Doubles, bias: Doubles) -> tuple[Forms, Lines]:
        unit, tiny, _, library = self.tables.arithmetic
        terms = weight.shape[1] + 8.0
        dimensions = given.part.shape[1] - 1
        part = given.part @ weight.T
        part[:, 0] += bias
        scope = given.size @ np.abs(weight).T + np.abs(bias)
        error = 2.0 * terms * (unit * scope + tiny)
        radius = given.radius @ np.abs(weight).T + error
        radius += 2.0 * terms * (ROUNDOFF * scope + LEAST * (dimensions + 2.0))

        reach = radius + np.abs(part[:, 1:]).sum(axis=1) + np.abs(part[:, 0]) * 2.0**-50 + LEAST
        low, high = part[:, 0] - reach, part[:, 0] + reach
        extent = np.abs(part[:, 0]) + reach
        slopes, offsets = _around(kind, low, high)
        after = library if kind == ACTIVATIONS["tanh"] else 0.0
        slope, above = slopes[1], offsets[1]
        below = offsets[0] if kind == ACTIVATIONS["tanh"] else np.zeros_like(above)
        rounding = (slope * extent + np.abs(above) + np.abs(below)) * 2.0**-49 + LEAST
        part *= slope[:, None]
        part[:, 0] += 0.5 * (above + below)
        radius = slope * radius + 0.5 * np.maximum(0.0, above - below) + rounding + after
        size = np.abs(part).sum(axis=1) + radius
        return Forms(part, radius, size), Lines(scope, error, extent, slopes, offsets, after)

    def _output(
        self, seen: Forms, lines: list[Lines], index: int, other: int, scale: tuple[float, ...]
    ) -> Doubles:
        """The range of one output on each box: (n, 2)."""
        above, below = (self._bounded(seen, lines, index, other, sign) for sign in (1.0, -1.0))
        unit, tiny, _, _ = self.tables.arithmetic
        slope, offset, size = scale[:3]
        low, high = -below, above
        most = np.maximum(np.abs(low), np.abs(high))
        reach = 16.0 * (ROUNDOFF + unit) * (abs(slope) * most + size) + 16.0 * (tiny + LEAST)
        first, last = (high, low) if slope < 0.0 else (low, high)
        return np.stack([slope * first + offset - reach, slope * last + offset + reach], axis=1)

    def _bounded(self, seen: Forms, lines: list[Lines], index: int, other: int, sign: float) -> Doubles:
        """An upper bound on each box of `sign` times an output, by going back through the layers."""
        n, width = lines[-1].scope.shape
        row = np.zeros((n, width))
        row[:, index] = sign
        if other >= 0:
            row[:, other] = -sign
        constant, error = np.zeros(n), np.zeros(n)
        for (_, weight, bias), around in zip(reversed(self.tables.layers), reversed(lines), strict=True):
            own = 4.0 * (sum(weight.shape) + 8.0) * ROUNDOFF
            size, rises = np.abs(row), row > 0.0
            slope = np.where(rises, around.slope[1], around.slope[0])
            offset = np.where(rises, around.offset[1], around.offset[0])
            steep = size * slope
            constant += (row * offset).sum(axis=1) + (row * slope) @ bias
            rounding = size * np.abs(offset) + steep * (around.scope + around.extent)
            error += (size * around.after + steep * around.error + own * rounding + LEAST).sum(axis=1)
            error += own * np.abs(constant)
            row = (row * slope) @ weight
        own = 4.0 * (row.shape[1] + 8.0) * ROUNDOFF
        constant += (row * seen.part[:, 0]).sum(axis=1)
        slopes = np.einsum("ni,ndi->nd", row, seen.part[:, 1:])
        error += (np.abs(row) * (seen.radius + own * seen.size) + LEAST).sum(axis=1)
        return constant + error + own * np.abs(constant) + np.abs(slopes).sum(axis=1)


def _around(
    kind: int, low: Doubles, high: Doubles
) -> tuple[tuple[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Slopes and offsets of the lines below and above an activation between `low` and `high`."""
    zero = np.zeros_like(low)
    if kind == ACTIVATIONS["relu"]:
        bent = (low < 0.0) & (high > 0.0)
        chord = np.where(low >= 0.0, 1.0, 0.0)
        np.divide(high, high - low, out=chord, where=bent)
        lower = np.where(bent, np.where(high > -low, 1.0, 0.0), chord)
        over = np.maximum(-chord * low, (1.0 - chord) * high)
        upper = np.where(bent, over * (1.0 + 2.0**-49) + high * 2.0**-50 + LEAST, 0.0)
        return (lower, chord), (zero, upper)
    if kind == ACTIVATIONS["tanh"]:
        first, last = np.tanh(low), np.tanh(high)
        flattest = np.maximum(np.abs(first), np.abs(last))
        slope = np.maximum(0.0, (1.0 - flattest**2) - 2.0**-45) * (1.0 - 2.0**-45)
        below = first - slope * low - (1.0 + slope * np.abs(low)) * 2.0**-49
        above = last - slope * high + (1.0 + slope * np.abs(high)) * 2.0**-49
        return (slope, slope), (below, above)
    one = np.ones_like(low)
    return (one, one), (zero, zero)
