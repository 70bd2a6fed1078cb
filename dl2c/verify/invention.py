"""Candidates for what stays true along a differential equation. They are guesses, proved like any other."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, combinations_with_replacement

from flint import fmpq_mat

from dl2c.ir.logic import substituted, symbols
from dl2c.ir.model import ZERO, Add, Compare, Formula, Sub, Symbol, Term
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring, TooLarge
from dl2c.verify.field import Field

MAX_MONOMIALS = 300
"""Of a conserved form."""

MAX_DEGREE = 3

MAX_SYMBOLS = 8
"""Of which sums and differences are guesses."""


def invented(field: Field, start: Mapping[Symbol, Term], clock: Symbol) -> list[Formula]:
    """Signs of the factors of rates, conserved forms, and that something only grows or falls: a symbol, the
    sum or the difference of two.
    """
    start = {s: t for s, t in start.items() if s != clock}
    if not field.smooth:
        return list(_monotone(start))
    try:
        ring = field.ring()
        flow = field.flow(ring)
        still = {s: rate for s, rate in flow.items() if s != clock}
        found = [*_signs(field, ring, still), *_conserved(field, ring, flow, start)]
        found += [*_monotone(start), *_monotone_pairs(start)]
    except (NotPolynomial, TooLarge):
        return list(_monotone(start))
    return list(dict.fromkeys(found))


def _monotone(start: Mapping[Symbol, Term]) -> Iterator[Formula]:
    for symbol, first in start.items():
        yield Compare(">=", symbol, first)
        yield Compare("<=", symbol, first)


def _monotone_pairs(start: Mapping[Symbol, Term]) -> Iterator[Formula]:
    if len(start) > MAX_SYMBOLS:
        return
    for (x, first), (y, second) in combinations(start.items(), 2):
        for both in (Add, Sub):
            for op in (">=", "<="):
                yield Compare(op, both(x, y), both(first, second))


def _signs(field: Field, ring: Ring, flow: Mapping[Symbol, Polynomial]) -> Iterator[Formula]:
    """The signs of symbols that divide their own rates, and of all factors of rates."""
    factors: dict[Term, None] = {}
    for symbol, rate in flow.items():
        factors.setdefault(symbol)
        if not rate.is_zero():
            for factor, _ in rate.factor()[1]:
                factors.setdefault(field.spelled(ring.term(factor)))
    for term in factors:
        if symbols(term) & field.rates.keys():
            for op in ("=", ">", "<", ">=", "<="):
                yield Compare(op, term, ZERO)


def _conserved(
    field: Field, ring: Ring, flow: Mapping[Symbol, Polynomial], start: Mapping[Symbol, Term]
) -> Iterator[Formula]:
    """Polynomials with derivative zero, by linear algebra on coefficients."""
    for degree in range(1, MAX_DEGREE + 1):
        monomials = _monomials(ring, degree)
        if len(monomials) > MAX_MONOMIALS:
            return
        found = [p for p in _kernel(ring, monomials, flow) if _moves(ring, p, flow)]
        for p in found:
            term = field.spelled(ring.term(ring.primitive(p)))
            yield Compare("=", term, substituted(term, start))
        if found and degree > 1:
            return


def _monomials(ring: Ring, degree: int) -> list[Polynomial]:
    generators = list(ring.generators.values())
    one = ring.number(1)
    found: list[Polynomial] = []
    for d in range(1, degree + 1):
        for chosen in combinations_with_replacement(generators, d):
            product = one
            for g in chosen:
                product = product * g
            found.append(product)
            if len(found) > MAX_MONOMIALS:
                return found
    return found


def _kernel(
    ring: Ring, monomials: Sequence[Polynomial], flow: Mapping[Symbol, Polynomial]
) -> Iterator[Polynomial]:
    """A basis of the combinations of monomials whose derivative is zero."""
    derivatives = [ring.derivative(m, dict(flow)).to_dict() for m in monomials]
    rows = {e: k for k, e in enumerate(dict.fromkeys(e for d in derivatives for e in d))}
    if not rows:
        yield from monomials
        return
    matrix = fmpq_mat(len(rows), len(monomials))
    for column, d in enumerate(derivatives):
        for exponents, value in d.items():
            matrix[rows[exponents], column] = value
    reduced, rank = matrix.rref()
    pivots: list[int] = []
    for row in range(rank):
        pivots.append(next(c for c in range(len(monomials)) if reduced[row, c] != 0))
    for free in sorted(set(range(len(monomials))) - set(pivots)):
        combination = monomials[free]
        for row, pivot in enumerate(pivots):
            if reduced[row, free] != 0:
                combination = combination - monomials[pivot] * ring.context.constant(reduced[row, free])
        yield combination


def _moves(ring: Ring, p: Polynomial, flow: Mapping[Symbol, Polynomial]) -> bool:
    """Whether a polynomial is more than a number and constants."""
    degrees = dict(zip(ring.symbols, p.degrees(), strict=True))
    return any(degrees[s] for s in flow)
