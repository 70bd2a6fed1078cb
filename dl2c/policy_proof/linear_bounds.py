"""Linear bounds of a network of relu on a box, in whole numbers over a power of two: those of the checker.

Numbers are linear functions of t between -1 and 1, with a radius that holds every rounding: one unit for
each product here, and what the arithmetic of the program may add. They go forward through the layers; then
bounds of each output go backward, as in cgen/verify, but computed anew and exactly apart from these units.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir.model import Symbol
from dl2c.policy_proof.fixed_point import ONE, SCALE, Ends, down, up
from dl2c.policy_proof.question import NotCovered, Observed, Question

UNITS = {"real": Fraction(0), "double": Fraction(1, 2**53), "float32": Fraction(1, 2**24)}
SMALLEST = {"real": Fraction(0), "double": Fraction(1, 2**1022), "float32": Fraction(1, 2**126)}
"""Of the arithmetic: the relative error of an operation, and the smallest normal number."""

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
class _Line:
    """slope * z + offset above max(0, z), and slope * z below it. Sums z are up to `size` in magnitude, and
    their error is `error`.
    """

    below: int
    above: int
    offset: int
    error: int
    size: int


class NetworkBounds:
    """Of the network of a question. Weights are read once."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.unit, self.smallest = UNITS[question.arithmetic], SMALLEST[question.arithmetic]
        self.weights: list[Matrix] = [[_exact(row) for row in la.weight.tolist()] for la in question.layers]
        self.biases: Matrix = [_exact(la.bias.tolist()) for la in question.layers]
        self.columns: list[Matrix] = [[list(c) for c in zip(*w, strict=True)] for w in self.weights]

    def outputs(self, box: Sequence[Ends], wanted: Sequence[tuple[int, int]]) -> list[tuple[Form, Form]]:
        """Of each output, or difference of two (-1: of one), what is below and above; the radius is in the
        middle.
        """
        observed = [self._observed(o, k, box) for k, o in enumerate(self.question.observed)]
        forms, lines = observed, list[list[_Line]]()
        for k, layer in enumerate(self.question.layers):
            forms, made = self._layer(k, forms, layer.activation == "relu")
            lines.append(made)
        found: list[tuple[Form, Form]] = []
        for first, second in wanted:
            above = self._backward(observed, lines, first, second, 1)
            below = self._backward(observed, lines, first, second, -1)
            found.append((Form(-below.middle, tuple(-s for s in below.slopes), 0), above))
        return found

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
        relative = (
            Fraction(1, 2**23) if seen.rounded or self.question.arithmetic == "float32" else Fraction(0)
        )
        error = up(relative * Fraction(form.size, ONE) + (Fraction(1, 2**125) if relative else 0))
        form = _clipped(Form(form.middle, form.slopes, form.radius + error), seen.low, seen.high)
        for scaling in self.question.scalings:
            center, scale = Fraction(float(scaling.center[k])), Fraction(float(scaling.scale[k]))
            size = (Fraction(form.size, ONE) + abs(center)) / scale
            radius = up(Fraction(form.radius, ONE) / scale + 16 * (self.unit * size + self.smallest))
            middle = down((Fraction(form.middle, ONE) - center) / scale)
            slopes = tuple(down(Fraction(s, ONE) / scale) for s in form.slopes)
            form = Form(middle, slopes, radius + 1 + len(slopes))
            form = _clipped(form, -scaling.clip, scaling.clip)
        return form

    def _layer(self, k: int, given: list[Form], bent: bool) -> tuple[list[Form], list[_Line]]:
        middles, radii, sizes = [f.middle for f in given], [f.radius for f in given], [f.size for f in given]
        slopes = list(zip(*(f.slopes for f in given), strict=True))
        terms = len(given) + 8
        forms: list[Form] = []
        lines: list[_Line] = []
        for row, bias in zip(self.weights[k], self.biases[k], strict=True):
            scope = abs(bias) + (_dot([abs(w) for w in row], sizes) >> SCALE) + 1
            error = up(2 * terms * (self.unit * Fraction(scope, ONE) + self.smallest))
            radius = (_dot([abs(w) for w in row], radii) >> SCALE) + 2 + error + len(slopes)
            middle = bias + (_dot(row, middles) >> SCALE)
            sums = Form(middle, tuple(_dot(row, s) >> SCALE for s in slopes), radius)
            line, form = _bent(sums, error) if bent else (_Line(ONE, ONE, 0, error, sums.size), sums)
            forms.append(form)
            lines.append(line)
        return forms, lines

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
        constant, sizes = 0, [[f.size for f in observed], *([line.size for line in made] for made in lines)]
        for k in reversed(range(len(lines))):
            factors: Row = []
            for factor, line in zip(row, lines[k], strict=True):
                slope = line.above if factor > 0 else line.below
                constant += (factor * line.offset >> SCALE) + 1 if factor > 0 else 0
                made = factor * slope >> SCALE
                constant += (abs(made) + 1) * line.error // ONE + 1
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
    ends = form.middle - (form.size - abs(form.middle)), form.middle + (form.size - abs(form.middle))
    below = up(Fraction(low)) - ends[0] if low > float("-inf") else 0
    above = ends[1] - down(Fraction(high)) if high < float("inf") else 0
    return Form(form.middle, form.slopes, form.radius + max(0, below, above))


def _bent(sums: Form, error: int) -> tuple[_Line, Form]:
    """max(0, z): itself, 0, or between z scaled by a chord and that with an offset."""
    reach = sums.size - abs(sums.middle)
    low, high = sums.middle - reach, sums.middle + reach
    if low >= 0:
        return _Line(ONE, ONE, 0, error, sums.size), sums
    if high <= 0:
        return _Line(0, 0, 0, error, sums.size), Form(0, (0,) * len(sums.slopes), 0)
    chord = (high << SCALE) // (high - low)
    offset = max((chord * -low >> SCALE) + 1, ((ONE - chord) * high >> SCALE) + 1)
    middle = (chord * sums.middle >> SCALE) + (offset >> 1)
    slopes = tuple(chord * s >> SCALE for s in sums.slopes)
    radius = (chord * sums.radius >> SCALE) + (offset >> 1) + 4 + len(slopes)
    line = _Line(ONE if high > -low else 0, chord, offset, error, sums.size)
    return line, Form(middle, slopes, radius)
