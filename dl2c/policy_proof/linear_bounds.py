"""Linear bounds of a network of relu or tanh on a box, in whole numbers over a power of two: those of the
checker.

Numbers are linear functions of t between -1 and 1, with a radius that holds every rounding: one unit for
each product here, and what the arithmetic of the program may add. They go forward through the layers; then
bounds of each output go backward, as in cgen/verify, but computed anew and exactly apart from these units.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir.model import Symbol
from dl2c.policy.network import Activation
from dl2c.policy_proof.fixed_point import ONE, ROUNDINGS, SCALE, UNLIMITED, Ends, down, up
from dl2c.policy_proof.hyperbolic import lines_around
from dl2c.policy_proof.question import NotCovered, Observed, Question

Row: TypeAlias = list[int]
Matrix: TypeAlias = list[Row]


@dataclass(frozen=True, slots=True)
class Form:
    """middle + slopes * t, give or take the radius."""

    middle: int
    slopes: tuple[int, ...]
    radius: int

    @property
    def size(self) -> int:
        return abs(self.middle) + sum(map(abs, self.slopes)) + self.radius


@dataclass(frozen=True, slots=True)
class _Sums:
    """Of sums z: their error, how large they and what the layer makes of them are, and how large the sum of
    the magnitudes is that are added.
    """

    error: int
    size: int
    scope: int


@dataclass(frozen=True, slots=True)
class _Line:
    """Of a function f: below * z + under is not above f(z), above * z + over is not below it."""

    below: int
    under: int
    above: int
    over: int
    of: _Sums


class NetworkBounds:
    """Of the network of a question. Weights are read once."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.rounding = ROUNDINGS[question.arithmetic]
        self.weights: list[Matrix] = [[_exact(row) for row in la.weight.tolist()] for la in question.layers]
        self.magnitudes: list[Matrix] = [[[abs(v) for v in row] for row in w] for w in self.weights]
        self.biases: Matrix = [_exact(la.bias.tolist()) for la in question.layers]
        self.columns: list[Matrix] = [[list(c) for c in zip(*w, strict=True)] for w in self.weights]

    def outputs(
        self, box: Sequence[Ends], wanted: Sequence[tuple[int, int]]
    ) -> list[tuple[Form, Form]] | None:
        """Of each output, or difference of two (-1: of one), what is below and above; the radius is in the
        middle. None where numbers may be larger than those with which the program computes for certain.
        """
        observed = [self._observed(o, k, box) for k, o in enumerate(self.question.observed)]
        forms, lines = observed, list[list[_Line]]()
        for k, layer in enumerate(self.question.layers):
            forms, made = self._layer(k, forms, layer.activation)
            lines.append(made)
        if not self._moderate(observed, lines):
            return None
        found: list[tuple[Form, Form]] = []
        for first, second in wanted:
            above = self._backward(observed, lines, first, second, 1)
            below = self._backward(observed, lines, first, second, -1)
            found.append((Form(-below.middle, tuple(-s for s in below.slopes), 0), above))
        return found

    def _moderate(self, observed: Sequence[Form], lines: Sequence[Sequence[_Line]]) -> bool:
        sizes = [f.size for f in observed] + [max(n.of.scope, n.of.size) for made in lines for n in made]
        return max(sizes, default=0) < self.rounding.largest

    def _observed(self, seen: Observed, k: int, box: Sequence[Ends]) -> Form:
        dimensions = self.question.dimensions
        if isinstance(seen.value, Symbol):
            at = dimensions.index(seen.value)
            low, high = box[at]
            middle = (low + high) >> 1
            slopes = tuple(max(high - middle, middle - low) if d == at else 0 for d in range(len(dimensions)))
            form = Form(middle, slopes, 0)
        else:
            form = Form(down(seen.value), (0,) * len(dimensions), 1)
            form = replace(form, radius=1 + self.rounding.error(form.size))
        relative = (
            Fraction(1, 2**23) if seen.rounded or self.question.arithmetic == "float32" else Fraction(0)
        )
        largest = ROUNDINGS["float32"].largest if relative else self.rounding.largest
        error = up(relative * Fraction(form.size, ONE) + (Fraction(1, 2**125) if relative else 0))
        error += UNLIMITED if form.size >= largest else 0
        form = _clipped(Form(form.middle, form.slopes, form.radius + error), seen.low, seen.high)
        for scaling in self.question.scalings:
            center, scale = Fraction(float(scaling.center[k])), Fraction(float(scaling.scale[k]))
            size = up((Fraction(form.size, ONE) + abs(center)) / scale)
            radius = up(Fraction(form.radius, ONE) / scale) + self.rounding.error(size, 8)
            middle = down((Fraction(form.middle, ONE) - center) / scale)
            slopes = tuple(down(Fraction(s, ONE) / scale) for s in form.slopes)
            form = Form(middle, slopes, radius + 1 + len(slopes))
            form = _clipped(form, -scaling.clip, scaling.clip)
        return form

    def _layer(self, k: int, given: list[Form], activation: Activation) -> tuple[list[Form], list[_Line]]:
        middles, radii, sizes = [f.middle for f in given], [f.radius for f in given], [f.size for f in given]
        slopes = list(zip(*(f.slopes for f in given), strict=True))
        terms = len(given) + 8
        forms: list[Form] = []
        lines: list[_Line] = []
        for row, magnitudes, bias in zip(self.weights[k], self.magnitudes[k], self.biases[k], strict=True):
            scope = abs(bias) + (_dot(magnitudes, sizes) >> SCALE) + 1
            error = self.rounding.error(scope, terms)
            radius = (_dot(magnitudes, radii) >> SCALE) + 2 + error + len(slopes)
            middle = bias + (_dot(row, middles) >> SCALE)
            sums = Form(middle, tuple(_dot(row, s) >> SCALE for s in slopes), radius)
            line, form = self._activated(activation, sums, _Sums(error, sums.size, scope))
            forms.append(form)
            lines.append(line)
        return forms, lines

    def _activated(self, activation: Activation, z: Form, sums: _Sums) -> tuple[_Line, Form]:
        match activation:
            case "identity":
                return _Line(ONE, 0, ONE, 0, sums), z
            case "relu":
                return _bent(z, sums)
            case "tanh":
                return _curved(z, sums, self.rounding.library)
            case _:
                raise NotCovered("certificates are checked for networks of relu and tanh")

    def _backward(
        self, observed: list[Form], lines: list[list[_Line]], first: int, second: int, sign: int
    ) -> Form:
        """What is above `sign` times an output, as a form whose radius is in the middle. Rounding each factor
        to a unit changes the bound by at most a unit times the size of what it multiplies.
        """
        row = [0] * len(lines[-1])
        row[first] += sign * ONE
        if second >= 0:
            row[second] -= sign * ONE
        sizes = [[f.size for f in observed], *([line.of.size for line in made] for made in lines)]
        constant = 0
        for k in reversed(range(len(lines))):
            factors: Row = []
            for factor, line in zip(row, lines[k], strict=True):
                slope, offset = (line.above, line.over) if factor > 0 else (line.below, line.under)
                constant += (factor * offset >> SCALE) + 1
                made = factor * slope >> SCALE
                constant += (abs(made) + 1) * line.of.error // ONE + 1
                factors.append(made)
            constant += (_dot(factors, self.biases[k]) >> SCALE) + 1
            constant += sum(sizes[k + 1]) // ONE + len(factors)
            row = [_dot(factors, column) >> SCALE for column in self.columns[k]]
            constant += sum(sizes[k]) // ONE + len(row)
        middle = constant + (_dot(row, [f.middle for f in observed]) >> SCALE) + 1
        middle += (_dot([abs(v) for v in row], [f.radius for f in observed]) >> SCALE) + 1
        slopes = [_dot(row, list(s)) >> SCALE for s in zip(*(f.slopes for f in observed), strict=True)]
        return Form(middle + len(slopes), tuple(slopes), 0)


def _exact(numbers: Sequence[float]) -> Row:
    """Weights as whole numbers. Raises `NotCovered` for those that need more digits."""
    made = [Fraction(v) * ONE for v in numbers]
    if any(v.denominator != 1 for v in made):
        raise NotCovered("a weight of its network has too many digits to be checked")
    return [v.numerator for v in made]


def _dot(a: Sequence[int], b: Sequence[int]) -> int:
    return sum(map(int.__mul__, a, b))


def _clipped(form: Form, low: float, high: float) -> Form:
    """A clipped number differs by no more than it is outside."""
    least, most = _ends(form)
    below = up(Fraction(low)) - least if low > float("-inf") else 0
    above = most - down(Fraction(high)) if high < float("inf") else 0
    return Form(form.middle, form.slopes, form.radius + max(0, below, above))


def _bent(z: Form, sums: _Sums) -> tuple[_Line, Form]:
    """max(0, z): itself, 0, or between z scaled by a chord and that with an offset."""
    low, high = _ends(z)
    if low >= 0:
        return _Line(ONE, 0, ONE, 0, sums), z
    if high <= 0:
        return _Line(0, 0, 0, 0, sums), Form(0, (0,) * len(z.slopes), 0)
    chord = (high << SCALE) // (high - low)
    offset = max((chord * -low >> SCALE) + 1, ((ONE - chord) * high >> SCALE) + 1)
    return _Line(ONE if high > -low else 0, 0, chord, offset, sums), _sloped(z, chord, 0, offset)


def _curved(z: Form, sums: _Sums, error: int) -> tuple[_Line, Form]:
    """tanh(z), computed with an error: between two lines of the same slope. |tanh(z)| is at most |z|."""
    slope, under, over = lines_around(*_ends(z))
    under, over = under - error, over + error
    made = _Sums(sums.error, sums.size + error, sums.scope)
    return _Line(slope, under, slope, over, made), _sloped(z, slope, under, over)


def _ends(form: Form) -> Ends:
    reach = form.size - abs(form.middle)
    return form.middle - reach, form.middle + reach


def _sloped(z: Form, slope: int, under: int, over: int) -> Form:
    """What is between slope * z + under and slope * z + over, for a slope between 0 and 1. The middle, the
    radius, each slope, and both halves are rounded by a unit at most.
    """
    middle = (slope * z.middle >> SCALE) + (under + over >> 1)
    slopes = tuple(slope * s >> SCALE for s in z.slopes)
    radius = (slope * z.radius >> SCALE) + (over - under >> 1) + 4 + len(slopes)
    return Form(middle, slopes, radius)
