"""Drawn values, many at a time: which satisfy a formula, and what is computed from them."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.arrays import Evaluation
from dl2c.ir.model import Formula, Term
from dl2c.sampling.equalities.root_of import Definition, RootOf

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Columns: TypeAlias = Mapping[str, Floats]
"""The values of each name, all of one shape."""


HALVINGS = 64
"""Of an interval with a zero: fewer than doubles may need next to 0, and enough to estimate with."""

CHUNK = 4096
"""Points evaluated together: the values of all terms are kept until they are done."""


def holds(formula: Formula, columns: Columns, count: int) -> Bools:
    """Which of the `count` points satisfy the formula; shape (count,)."""
    found = np.empty(count, np.bool_)
    for start in range(0, count, CHUNK):
        part = slice(start, min(start + CHUNK, count))
        found[part] = _evaluation(columns, part).truth(formula)
    return found


def values(term: Term, columns: Columns, count: int) -> Floats:
    """The values of a term; shape (count,)."""
    return np.broadcast_to(_evaluation(columns, slice(None)).value(term), (count,))


def _evaluation(columns: Columns, part: slice) -> Evaluation:
    return Evaluation(lambda symbol: columns[symbol.name][part])


def uniform(low: Floats | float, high: Floats | float, count: int, rng: np.random.Generator) -> Floats:
    """`count` draws between the limits, by the law of `SamplingPlan`."""
    return np.minimum(low + rng.random(count) * (np.asarray(high) - low), high)


def completed(
    columns: Columns, definitions: Sequence[tuple[str, Definition]], count: int
) -> dict[str, Floats]:
    """The columns with defined names added, in order."""
    result = dict(columns)
    for name, term in definitions:
        is_root = isinstance(term, RootOf)
        result[name] = crossed(term, result, count) if is_root else values(term, result, count)
    return result


def crossed(root: RootOf, columns: Columns, count: int) -> Floats:
    """Where the polynomial changes its sign; NaN where it does so less often. Shape (count,)."""
    rows = [np.stack([values(c, columns, count) for c in root.coefficients])]
    while len(rows[-1]) > 2:
        rows.append(rows[-1][1:] * np.arange(1, len(rows[-1]))[:, None])
    places = np.array([[root.low], [root.high]]) * np.ones(count)
    changes = np.zeros((1, count), np.bool_)
    with np.errstate(all="ignore"):
        while rows:
            places, changes = _between(rows.pop(), places)
    found = np.cumsum(changes, axis=0) == root.number + 1
    first = places[1:-1][np.argmax(found, axis=0), np.arange(count)]
    return np.where(found.any(axis=0), first, np.nan)


def _between(row: Floats, places: Floats) -> tuple[Floats, Bools]:
    """The places where a polynomial changes its sign between neighbours of those of its derivative, with
    both ends: shape (one more, count). Where it does not, the next one stands, marked False."""
    low, high = places[:-1].copy(), places[1:].copy()
    before, after = _horner(row, low), _horner(row, high)
    changes = (before < 0) != (after < 0)
    for _ in range(HALVINGS):
        middle = low + (high - low) / 2
        same = (_horner(row, middle) < 0) == (before < 0)
        low, high = np.where(changes & same, middle, low), np.where(changes & ~same, middle, high)
    return np.concatenate([places[:1], high, places[-1:]]), changes


def _horner(row: Floats, at: Floats) -> Floats:
    value = np.broadcast_to(row[-1], at.shape)
    for coefficient in row[-2::-1]:
        value = value * at + coefficient
    return value
