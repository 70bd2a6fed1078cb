"""Candidates for what stays true along a differential equation. They are guesses, proved like any other."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import combinations, combinations_with_replacement

from flint import fmpq_mat

from dl2c.ir.logic import number, plus, substituted, symbols, times
from dl2c.ir.model import ONE, ZERO, Add, Compare, Formula, Mul, Neg, Pow, Sub, Symbol, Term
from dl2c.ir.polynomial import Coefficients, polynomial
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring, TooLarge
from dl2c.verify.field import Field

MAX_MONOMIALS = 300
"""Of a conserved form."""

MAX_DEGREE = 3

MAX_SYMBOLS = 8
"""Of which sums and differences are guesses."""


def invented(
    field: Field, start: Mapping[Symbol, Term], clock: Symbol, curves: Mapping[Symbol, Coefficients]
) -> list[Formula]:
    """Signs of the factors of rates, conserved forms, how far something may come, and that it only grows or
    falls: a symbol, the sum or the difference of two. `curves` are the motions that are polynomials of time.
    """
    start = {s: t for s, t in start.items() if s != clock}
    if not field.smooth:
        return list(_monotone(start))
    try:
        ring = field.ring()
        flow = field.flow(ring)
        still = {s: rate for s, rate in flow.items() if s != clock}
        found = [*_signs(field, ring, still), *_conserved(field, ring, flow, start)]
        left = {s: p for s, p in still.items() if s not in curves and s in start}
        found += _reached(ring, left, start, clock, {**curves, clock: (ZERO, ONE)})
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


def _reached(
    ring: Ring,
    flow: Mapping[Symbol, Polynomial],
    start: Mapping[Symbol, Term],
    clock: Symbol,
    curves: Mapping[Symbol, Coefficients],
) -> Iterator[Formula]:
    """Bounds of motions that are not solved. Where x' = v*d and d is a symbol, as of a direction, x comes no
    further than the integral of v, if |d| <= 1. Where x' = v + m, x stays on one side of what v alone gives,
    if m has a sign. In both, v is a polynomial of time.
    """
    unsolved = {s for s in flow if s not in curves}
    for x, rate in flow.items():
        first = start[x]
        others = [p for p in _factors(rate) if _among(ring, p, unsolved)]
        if len(others) == 1 and others[0] in ring.generators.values():
            speed = ring.term(divmod(rate, others[0])[0])
            if (way := _integral(speed, clock, curves)) is not None:
                yield Compare("<=", Sub(x, first), way)
                yield Compare(">=", Sub(x, first), Neg(way))
        part = _without(ring, rate, unsolved)
        if not part.is_zero() and (way := _integral(ring.term(part), clock, curves)) is not None:
            yield Compare("<=", x, Add(first, way))
            yield Compare(">=", x, Add(first, way))


def _factors(p: Polynomial) -> list[Polynomial]:
    """The irreducible factors, each as often as it occurs."""
    return [factor for factor, count in p.factor()[1] for _ in range(count)] if not p.is_zero() else []


def _among(ring: Ring, p: Polynomial, chosen: Collection[Symbol]) -> bool:
    """Whether a polynomial has one of these symbols."""
    return any(d for s, d in zip(ring.symbols, p.degrees(), strict=True) if s in chosen)


def _without(ring: Ring, p: Polynomial, chosen: Collection[Symbol]) -> Polynomial:
    """The monomials without these symbols."""
    places = [k for k, s in enumerate(ring.symbols) if s in chosen]
    return ring.context.from_dict({e: c for e, c in p.to_dict().items() if not any(e[k] for k in places)})


def _integral(speed: Term, clock: Symbol, curves: Mapping[Symbol, Coefficients]) -> Term | None:
    """The way in the time since the start; None where the speed is no polynomial of time."""
    coefficients = polynomial(speed, curves)
    if coefficients is None:
        return None
    result: Term = ZERO
    for k, c in enumerate(coefficients, 1):
        power = Pow(clock, k) if k > 1 else clock
        result = plus(result, times(Mul(number(Fraction(1, k)), c) if k > 1 else c, power))
    return result


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
