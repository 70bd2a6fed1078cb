"""How much of the set of initial states a draw stands for, where equalities bend that set.

An elimination comes in; the density of the Hausdorff measure (length, area, ...) of its states with
respect to the volume of the drawn names goes out: a constant, or a constant times the square root of
a term. So draws can be weighted such that states are uniform on the set itself, whichever names the
equalities were solved for.

With z the drawn names and those that nonlinear equalities define, affine functions C z of them, and
N the matrix of slopes (a row `1, slopes` for each nonlinear name), the density is
sqrt(det G) * sqrt(det(N G^-1 N')), where G = I + C'C (Federer, "Geometric Measure Theory", 3.2.3).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import TypeAlias

from dl2c.ir.logic import folded, minus, plus, times
from dl2c.ir.model import ONE, ZERO, Div, Number, Symbol, Term
from dl2c.ir.normal import normal_form, symbol_of
from dl2c.sampling.equalities.algebra import is_affine
from dl2c.sampling.equalities.branches import Row
from dl2c.sampling.equalities.root_of import RootOf
from dl2c.sampling.equalities.solve import Elimination

Affine: TypeAlias = dict[Symbol, Fraction]
"""Coefficients; the constant term plays no part."""

Matrix: TypeAlias = dict[tuple[Symbol, Symbol], Fraction]

Entries: TypeAlias = Mapping[Symbol, Sequence["Entry"]]
"""The slopes of a name, its own first, which is 1."""

LARGEST_DETERMINANT = 4
"""Rows that may hang together: the determinant is written out."""


class TooEntangled(Exception):
    """Too many nonlinear equalities have names in common."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One slope: it is `scale * term`, and `term` is at most `limit` in size, where there is one."""

    scale: Fraction
    term: Term
    limit: Term | None


@dataclass(frozen=True, slots=True)
class Measure:
    """The density is `scale * sqrt(squared)`; `rows`, or the columns that follow from them and from the
    coefficients of `affine` names, bound it one by one (Hadamard's inequality). The first name of a row is
    its own, and no other of it has a later row."""

    scale: float
    squared: Term
    rows: tuple[Entries, ...]
    inverse: Mapping[tuple[Symbol, Symbol], Fraction]
    affine: tuple[Affine, ...] = ()
    widths: tuple[tuple[Term, ...], ...] = ()
    """The squares of the least of each are factors of `squared`."""


def measure_of(elimination: Elimination) -> Measure:
    """The density of an elimination. Raises `TooEntangled`."""
    bent = {row.symbol for row in elimination.rows}
    affine: dict[Symbol, Affine] = {}
    for symbol, term in elimination.definitions:
        if symbol not in bent and not isinstance(term, RootOf):
            affine[symbol] = _affine(term, affine)
    determinant, inverse = _metric(list(affine.values()))
    order = [symbol for symbol, _ in elimination.definitions]
    rows = [_entries(r, affine) for r in sorted(elimination.rows, key=lambda r: order.index(r.symbol))]
    products = {
        (i, k): _inner(a, b, inverse) for i, a in enumerate(rows) for k, b in enumerate(rows) if i <= k
    }
    squared = _determinant(products, rows, inverse)
    if isinstance(squared, Number):
        return Measure(math.sqrt(determinant * squared.value), ONE, (), {})
    return Measure(math.sqrt(determinant), squared, tuple(rows), inverse, tuple(affine.values()))


def _affine(term: Term, known: Mapping[Symbol, Affine]) -> Affine:
    """The coefficients of an affine term, names that are affine themselves replaced."""
    form = normal_form(term)
    assert form is not None and is_affine(term), "names without a row are affine"
    found: Affine = {}
    for monomial, value in form.items():
        for kind, name, _ in monomial:
            symbol = symbol_of(kind, name)
            for z, share in known.get(symbol, {symbol: Fraction(1)}).items():
                found[z] = found.get(z, Fraction(0)) + value * share
    return {z: c for z, c in found.items() if c}


def _entries(row: Row, affine: Mapping[Symbol, Affine]) -> dict[Symbol, tuple[Entry, ...]]:
    """The row over names that are not affine functions; its own name has the entry 1."""
    found: dict[Symbol, tuple[Entry, ...]] = {row.symbol: (Entry(Fraction(1), ONE, None),)}
    for symbol, slope in row.slopes.items():
        if slope == ZERO:
            continue
        limit = ONE if symbol in row.gentle else row.limits.get(symbol)
        for z, share in affine.get(symbol, {symbol: Fraction(1)}).items():
            found[z] = (*found.get(z, ()), Entry(share, slope, limit))
    return found


def _metric(rows: Sequence[Affine]) -> tuple[Fraction, Matrix]:
    """det(I + C'C) and the entries of its inverse that differ from the identity's."""
    zero = Fraction(0)
    names = list(dict.fromkeys(z for row in rows for z in row))
    n = len(names)

    def entry(a: Symbol, b: Symbol) -> Fraction:
        return sum((r.get(a, zero) * r.get(b, zero) for r in rows), Fraction(int(a == b)))

    matrix = [[*(entry(a, b) for b in names), *(Fraction(int(a == b)) for b in names)] for a in names]
    determinant = Fraction(1)
    for k in range(n):
        pivot = matrix[k][k]
        determinant *= pivot
        matrix[k] = [v / pivot for v in matrix[k]]
        for i in range(n):
            if i != k and (factor := matrix[i][k]):
                matrix[i] = [v - factor * w for v, w in zip(matrix[i], matrix[k], strict=True)]
    inverse = {(a, b): matrix[i][n + k] for i, a in enumerate(names) for k, b in enumerate(names)}
    return determinant, inverse


def at(inverse: Mapping[tuple[Symbol, Symbol], Fraction], a: Symbol, b: Symbol) -> Fraction:
    """An entry of a matrix of which those are left out that the identity has."""
    return inverse.get((a, b), Fraction(int(a == b)))


def _inner(
    left: Mapping[Symbol, Sequence[Entry]], right: Mapping[Symbol, Sequence[Entry]], inverse: Matrix
) -> Term:
    """left G^-1 right' as a term."""
    result: Term = ZERO
    for a, first in left.items():
        for b, second in right.items():
            if share := at(inverse, a, b):
                part = times(_sum(first), _sum(second))
                result = plus(result, times(Number(share), part))
    return result


def _sum(entries: Sequence[Entry]) -> Term:
    result: Term = ZERO
    for entry in entries:
        result = plus(result, times(Number(entry.scale), entry.term))
    return result


def _determinant(
    products: Mapping[tuple[int, int], Term],
    rows: Sequence[Mapping[Symbol, Sequence[Entry]]],
    inverse: Matrix,
) -> Term:
    """Of a symmetric matrix: the product of those of its independent blocks."""
    left = set(range(len(rows)))
    term: Term = ONE
    while left:
        block = sorted(_block(min(left), left, products))
        left -= set(block)
        small = len(block) <= LARGEST_DETERMINANT
        own = _expanded(block, block, products) if small else _by_columns([rows[k] for k in block], inverse)
        term = times(term, own)
    return term


def _by_columns(rows: Sequence[Entries], inverse: Matrix) -> Term:
    """det(N N'), where few columns are shared by rows: with D what is left of N N' without these columns U,
    a diagonal matrix, it is det(D) * det(I + U' D^-1 U). Raises `TooEntangled`."""
    columns = [z for row in rows for z in row]
    shared = [z for z in dict.fromkeys(columns) if columns.count(z) > 1]
    if len(shared) > LARGEST_DETERMINANT or any(next(iter(row)) in shared for row in rows):
        raise TooEntangled
    if any(a in columns for a, _ in inverse):
        raise TooEntangled
    diagonal = [reduce(plus, (_square(row[z]) for z in row if z not in shared)) for row in rows]

    def entry(a: Symbol, b: Symbol) -> Term:
        parts: Iterator[Term] = (
            folded(Div(times(_sum(row[a]), _sum(row[b])), d))
            for row, d in zip(rows, diagonal, strict=True)
            if a in row and b in row
        )
        return reduce(plus, parts, ONE if a == b else ZERO)

    size = range(len(shared))
    small = {(i, k): entry(shared[i], shared[k]) for i in size for k in size if i <= k}
    return times(reduce(times, diagonal), _expanded(list(size), list(size), small))


def _square(entries: Sequence[Entry]) -> Term:
    return times(_sum(entries), _sum(entries))


def _block(start: int, left: set[int], products: Mapping[tuple[int, int], Term]) -> set[int]:
    block, grown = {start}, True
    while grown:
        more = {k for k in left - block if any(products[min(i, k), max(i, k)] != ZERO for i in block)}
        block, grown = block | more, bool(more)
    return block


def _expanded(rows: Sequence[int], columns: Sequence[int], products: Mapping[tuple[int, int], Term]) -> Term:
    """By the first row (Laplace)."""
    if not rows:
        return ONE
    first = rows[0]
    term: Term = ZERO
    for k, column in enumerate(columns):
        entry = products[min(first, column), max(first, column)]
        rest = [c for c in columns if c != column]
        part = times(entry, _expanded(rows[1:], rest, products))
        term = minus(term, part) if k % 2 else plus(term, part)
    return term
