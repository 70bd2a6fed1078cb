"""The signs of polynomials of one variable on an interval, exactly: at every root and between."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

from flint import fmpq, fmpq_poly

Root: TypeAlias = tuple[fmpq, fmpq, fmpq_poly]
"""An interval with one root of a squarefree polynomial, as `isolated` gives them, and the polynomial."""


def sign_vectors(
    margins: Sequence[fmpq_poly], until: Fraction, in_time: Callable[[], object] = lambda: None
) -> Iterator[list[int]]:
    """The signs that polynomials take together on [0, until]: at its ends, at every root and between.

    `in_time` is called now and then; what it raises ends the search.
    """
    end = fmpq(until.numerator, until.denominator)
    yield [_sign(p(fmpq(0))) for p in margins]
    yield [_sign(p(end)) for p in margins]
    roots: list[Root] = []
    for part in _coprime(margins):
        in_time()
        roots += ((low, high, part) for low, high in isolated(part, fmpq(0), end))
    roots = _apart(roots, in_time)
    for low, high, part in roots:
        in_time()
        yield [_sign_at_root(p, part, low, high) for p in margins]
    edges = [fmpq(0), *(x for low, high, _ in roots for x in (low, high)), end]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        middle = (low + high) / 2
        yield [_sign(p(middle)) for p in margins]


def _coprime(margins: Sequence[fmpq_poly]) -> Iterator[fmpq_poly]:
    """Squarefree polynomials without roots in common, that have all roots of the margins."""
    product = fmpq_poly([1])
    for p in margins:
        if p.degree() > 0:
            single = _squarefree(p)
            part = single / single.gcd(product)
            product = product * part
            if part.degree() > 0:
                yield part


def _apart(roots: list[Root], in_time: Callable[[], object]) -> list[Root]:
    """The roots in order, in intervals without a point in common."""
    roots = sorted(roots, key=_place)
    k = 1
    while k < len(roots):
        (a, b, _), (c, d, _) = roots[k - 1], roots[k]
        if b < c:
            k += 1
            continue
        in_time()
        wide = k - 1 if b - a > d - c else k
        low, high, part = roots[wide]
        roots[wide] = (*_halved(part, low, high), part)
        roots[k - 1 : k + 1] = sorted(roots[k - 1 : k + 1], key=_place)
        k = max(1, k - 1)
    return roots


def _place(root: Root) -> tuple[fmpq, fmpq]:
    return root[0], root[1]


def _sign(value: fmpq) -> int:
    return (value > 0) - (value < 0)


def _squarefree(p: fmpq_poly) -> fmpq_poly:
    return p if p.degree() < 1 else p / p.gcd(p.derivative())


def _sturm(p: fmpq_poly) -> list[fmpq_poly]:
    chain = [p, p.derivative()]
    while chain[-1].degree() > 0:
        chain.append(-(chain[-2] % chain[-1]))
    return [c for c in chain if c.degree() >= 0]


def _changes(chain: Sequence[fmpq_poly], at: fmpq) -> int:
    signs = [s for p in chain if (s := _sign(p(at)))]
    return sum(a != b for a, b in pairwise(signs))


def isolated(p: fmpq_poly, low: fmpq, high: fmpq) -> Iterator[tuple[fmpq, fmpq]]:
    """Disjoint intervals in (low, high), each with one root of a squarefree polynomial, in order.

    An interval has its root inside, or is the root itself; no end of a wider one is a root.
    """
    if p.degree() < 1 or not low < high:
        return
    chain = _sturm(p)

    def search(a: fmpq, b: fmpq) -> Iterator[tuple[fmpq, fmpq]]:
        """Roots in the open interval."""
        count = _changes(chain, a) - _changes(chain, b) - (p(b) == 0)
        if not count:
            return
        middle = (a + b) / 2
        if count == 1 and p(a) != 0 and p(b) != 0:
            yield a, b
            return
        yield from search(a, middle)
        if p(middle) == 0:
            yield middle, middle
        yield from search(middle, b)

    last = low
    for found in search(low, high):
        interval = found
        while interval[0] < interval[1] and (interval[0] <= last or interval[1] >= high):
            interval = _halved(p, *interval)
        last = interval[1]
        yield interval


def _halved(p: fmpq_poly, low: fmpq, high: fmpq) -> tuple[fmpq, fmpq]:
    """The half that has the root."""
    middle = (low + high) / 2
    if p(middle) == 0:
        return middle, middle
    return (low, middle) if _sign(p(low)) != _sign(p(middle)) else (middle, high)


def _sign_at_root(q: fmpq_poly, p: fmpq_poly, low: fmpq, high: fmpq) -> int:
    """The sign of q at the root of p in an interval."""
    if low == high:
        return _sign(q(low))
    if q.degree() < 0:
        return 0
    shared = p.gcd(q)
    if shared.degree() > 0:
        chain = _sturm(_squarefree(shared))
        if _changes(chain, low) != _changes(chain, high):
            return 0
    chain = _sturm(_squarefree(q)) if q.degree() > 0 else []
    while chain and (_changes(chain, low) != _changes(chain, high) or q(low) == 0):
        low, high = _halved(p, low, high)
        if low == high:
            return _sign(q(low))
    return _sign(q((low + high) / 2))
