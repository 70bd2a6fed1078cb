"""Terms and formulas on arrays of doubles, element by element.

Every operation rounds once, in the order of the tree, as the compiled code does. An
undefined or infinite value is NaN, and an atom with one is false. Transcendental
functions do not occur: the sampler refuses them first.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.sampling.equalities.root_of import Definition, RootOf

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Columns: TypeAlias = Mapping[str, Floats]
"""The values of each name, all of one shape."""


HALVINGS = 64
"""Of an interval with a zero: fewer than doubles may need next to 0, and enough to estimate with."""

CHUNK = 4096
"""Points evaluated together: the values of all terms are kept until they are done."""

Known: TypeAlias = dict[int, Floats]
"""The values of terms by identity: what the terms of a formula share is evaluated once."""


def holds(formula: Formula, columns: Columns, count: int) -> Bools:
    """Which of the `count` points satisfy the formula; shape (count,)."""
    found: list[Bools] = []
    with np.errstate(all="ignore"):
        for start in range(0, count, CHUNK):
            stop = min(start + CHUNK, count)
            part = {name: column[start:stop] for name, column in columns.items()}
            found.append(_holds(formula, part, stop - start, {}))
    return np.concatenate(found) if found else np.empty(0, np.bool_)


def values(term: Term, columns: Columns, count: int) -> Floats:
    """The values of a term; shape (count,)."""
    with np.errstate(all="ignore"):
        return np.broadcast_to(_value(term, columns, {}), (count,))


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


def _holds(formula: Formula, columns: Columns, count: int, known: Known) -> Bools:
    match formula:
        case Truth(value):
            return np.full(count, value)
        case Compare():
            return np.broadcast_to(_compared(formula, columns, known), (count,))
        case And(children):
            return np.logical_and.reduce([_holds(c, columns, count, known) for c in children])
        case Or(children):
            return np.logical_or.reduce([_holds(c, columns, count, known) for c in children])
        case _:
            assert_never(formula)


def _compared(atom: Compare, columns: Columns, known: Known) -> Bools:
    a, b = _value(atom.left, columns, known), _value(atom.right, columns, known)
    match atom.op:
        case "=":
            return a == b
        case "!=":
            return (a < b) | (a > b)
        case "<":
            return a < b
        case "<=":
            return a <= b
        case ">":
            return a > b
        case ">=":
            return a >= b
        case _:
            assert_never(atom.op)


def _value(term: Term, columns: Columns, known: Known) -> Floats:
    found = known.get(id(term))
    if found is None:
        found = known[id(term)] = _computed(term, columns, known)
    return found


def _computed(term: Term, columns: Columns, known: Known) -> Floats:
    match term:
        case Number(value):
            return np.asarray(float(value))
        case Symbol(name):
            return columns[name]
        case Neg(child):
            return -_value(child, columns, known)
        case Add(left, right):
            return _finite(_value(left, columns, known) + _value(right, columns, known))
        case Sub(left, right):
            return _finite(_value(left, columns, known) - _value(right, columns, known))
        case Mul(left, right):
            return _finite(_value(left, columns, known) * _value(right, columns, known))
        case Div(left, right):
            return _finite(_value(left, columns, known) / _value(right, columns, known))
        case Pow(base, exponent):
            return _power(_value(base, columns, known), exponent)
        case Call("abs", (arg,)):
            return np.abs(_value(arg, columns, known))
        case Call("sqrt", (arg,)):
            return np.sqrt(_value(arg, columns, known))
        case Call("min", (left, right)):
            a, b = _value(left, columns, known), _value(right, columns, known)
            return np.where(np.isnan(a), a, np.where(a < b, a, b))
        case Call("max", (left, right)):
            a, b = _value(left, columns, known), _value(right, columns, known)
            return np.where(np.isnan(a), a, np.where(a > b, a, b))
        case Call():
            raise AssertionError(f"the sampler refuses {term.function}")
        case _:
            assert_never(term)


def _power(base: Floats, exponent: int) -> Floats:
    if exponent == 1:
        return base
    if exponent % 2:
        return _finite(base * _power(base, exponent - 1))
    half = _power(base, exponent // 2)
    return _finite(half * half)


def _finite(a: Floats) -> Floats:
    return np.where(np.isfinite(a), a, np.nan)
