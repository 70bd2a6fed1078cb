"""Truth of formulas along polynomial motion of degree two, decided with fractions.

Numbers that a computation in doubles would round are `rough`: where a comparison of them is closer than
`CLOSE`, what doubles say is not known, and `Undecided` is raised.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from oracles.small_programs import Atom, Both, Either, Formula, Negation, Term

CLOSE = Fraction(1, 10**11)
FLAT = Fraction(1, 1000)
PRECISION = 2**200
ZERO = Fraction(0)


class Undecided(Exception):
    """Rounding, or what the text leaves open, decides."""


@dataclass(frozen=True)
class Poly:
    """c0 + c1 t + c2 t^2 + ..."""

    coefficients: tuple[Fraction, ...]
    rough: bool = False

    def __add__(self, other: "Poly") -> "Poly":
        size = max(len(self.coefficients), len(other.coefficients))
        pairs = ((self.coefficient(k), other.coefficient(k)) for k in range(size))
        return Poly(tuple(a + b for a, b in pairs), self.rough or other.rough)

    def __mul__(self, other: "Poly") -> "Poly":
        product = [ZERO] * (len(self.coefficients) + len(other.coefficients))
        for j, a in enumerate(self.coefficients):
            for k, b in enumerate(other.coefficients):
                product[j + k] += a * b
        return Poly(tuple(product), self.rough or other.rough)

    def times(self, factor: Fraction) -> "Poly":
        return Poly(tuple(factor * c for c in self.coefficients), self.rough)

    def coefficient(self, power: int) -> Fraction:
        return self.coefficients[power] if power < len(self.coefficients) else ZERO

    def at(self, time: Fraction) -> Fraction:
        return sum((c * time**k for k, c in enumerate(self.coefficients)), ZERO)

    def slope(self, time: Fraction) -> Fraction:
        return sum((k * c * time ** (k - 1) for k, c in enumerate(self.coefficients) if k), ZERO)

    def degree(self) -> int:
        return max((k for k, c in enumerate(self.coefficients) if c), default=0)


def constant(value: Fraction, rough: bool = False) -> Poly:
    return Poly((value,), rough)


Motion = Mapping[str, Poly]


def along(term: Term, motion: Motion) -> Poly:
    total = constant(ZERO)
    for coefficient, name, power in term.parts:
        product = constant(coefficient)
        for _ in range(power if name else 0):
            product *= motion[name]
        total += product
    return total


@dataclass(frozen=True)
class Leaf:
    """Holds where the polynomial is positive, or zero unless `strict`."""

    poly: Poly
    strict: bool


@dataclass(frozen=True)
class Tree:
    conjunction: bool
    parts: tuple["Truth", ...]


Truth = Leaf | Tree


def truth(formula: Formula, motion: Motion, tolerance: Fraction = ZERO, positive: bool = True) -> Truth:
    """In negation normal form, each atom relaxed by what its terms are at time 0."""
    match formula:
        case Both(parts) | Either(parts):
            inner = tuple(truth(part, motion, tolerance, positive) for part in parts)
            return Tree(isinstance(formula, Both) == positive, inner)
        case Negation(of):
            return truth(of, motion, tolerance, not positive)
        case Atom(left, op, right):
            return atom(left, op if positive else OPPOSITE[op], right, motion, tolerance)


OPPOSITE = {"<=": ">", "<": ">=", ">=": "<", ">": "<=", "=": "!=", "!=": "="}


def atom(left: Term, op: str, right: Term, motion: Motion, tolerance: Fraction) -> Truth:
    sizes = [abs(along(Term((part,)), motion).at(ZERO)) for part in (*left.parts, *right.parts)]
    slack = constant(tolerance * (1 + sum(sizes)) if op != "!=" else ZERO)
    difference = along(right, motion) + along(left, motion).times(Fraction(-1))
    below = Leaf(difference + slack, op in ("<", "!="))
    above = Leaf(difference.times(Fraction(-1)) + slack, op in (">", "!="))
    match op:
        case "<=" | "<":
            return below
        case ">=" | ">":
            return above
        case "=":
            return Tree(True, (below, above))
        case _:
            return Tree(False, (below, above))


def negated(part: Truth) -> Truth:
    if isinstance(part, Leaf):
        return Leaf(part.poly.times(Fraction(-1)), not part.strict)
    return Tree(not part.conjunction, tuple(map(negated, part.parts)))


@dataclass(frozen=True)
class Instant:
    """`sharp`: doubles know it without rounding."""

    time: Fraction
    sharp: bool
    of: tuple[Poly, ...] = ()
    """The polynomials that are zero then."""


def dyadic(value: Fraction) -> bool:
    """Whether few enough bits of a double hold it that sums and products need no rounding."""
    bottom = value.denominator
    return bottom & (bottom - 1) == 0 and bottom <= 2**12 and abs(value) < 2**12


def root_of(value: Fraction) -> tuple[Fraction, bool]:
    """The square root, and whether it is exact."""
    top, bottom = isqrt(value.numerator), isqrt(value.denominator)
    if top * top == value.numerator and bottom * bottom == value.denominator:
        return Fraction(top, bottom), True
    return Fraction(isqrt(value.numerator * PRECISION**2 // value.denominator), PRECISION), False


def instants(poly: Poly) -> list[Instant]:
    """The roots, in no order."""
    c, b, a = (poly.coefficient(k) for k in range(3))
    match poly.degree():
        case 0:
            return []
        case 1:
            return [Instant(-c / b, not poly.rough and dyadic(-c / b), (poly,))]
        case 2:
            under = b * b - 4 * a * c
            if abs(under / (4 * a)) < CLOSE and (poly.rough or under):
                raise Undecided("motion that hardly touches a bound")
            if under < 0:
                return []
            root, exact = root_of(under)
            times = {(-b - root) / (2 * a), (-b + root) / (2 * a)}
            return [Instant(t, exact and not poly.rough and dyadic(t), (poly,)) for t in times]
        case _:
            raise Undecided("a degree above two")


def leaves(part: Truth) -> list[Leaf]:
    return [part] if isinstance(part, Leaf) else [leaf for p in part.parts for leaf in leaves(p)]


def sign(poly: Poly, instant: Instant) -> int:
    if any(similar(poly, zero) for zero in instant.of):
        return 0
    value = poly.at(instant.time)
    if abs(value) < CLOSE and poly.degree() + poly.rough > 0 and (poly.rough or not instant.sharp):
        raise Undecided("a comparison within rounding")
    return (value > 0) - (value < 0)


def similar(one: Poly, other: Poly) -> bool:
    """Whether both have the same roots because one is a multiple of the other."""
    j, k = one.degree(), other.degree()
    if j != k or j == 0:
        return False
    size = max(len(one.coefficients), len(other.coefficients))
    scaled = other.times(one.coefficient(j) / other.coefficient(k))
    return all(one.coefficient(m) == scaled.coefficient(m) for m in range(size))


def holds(part: Truth, instant: Instant) -> bool:
    if isinstance(part, Leaf):
        found = sign(part.poly, instant)
        return found > 0 or (found == 0 and not part.strict)
    results = [holds(p, instant) for p in part.parts]
    return all(results) if part.conjunction else any(results)


@dataclass(frozen=True)
class Failure:
    """The first instant at which a formula is false, or, not `attained`, the last before it is."""

    instant: Instant
    attained: bool


def first_failure(part: Truth, end: Instant) -> Failure | None:
    """Among the instants from 0 to `end`, both included."""
    found = [i for leaf in leaves(part) for i in instants(leaf.poly) if 0 < i.time < end.time]
    ordered = merged(found)
    previous = Instant(ZERO, True)
    for instant in (*ordered, end):
        if not holds(part, previous):
            return Failure(checked(previous), True)
        if instant.time == previous.time:
            break
        between = Instant((previous.time + instant.time) / 2, True)
        if not holds(part, between):
            return Failure(checked(previous), False)
        previous = instant
    return None if holds(part, end) else Failure(end, True)


def checked(instant: Instant) -> Instant:
    """Where motion is nearly parallel to a bound, tolerances move the instant."""
    if not instant.sharp and any(abs(poly.slope(instant.time)) < FLAT for poly in instant.of):
        raise Undecided("motion nearly parallel to a bound")
    return instant


def merged(found: list[Instant]) -> list[Instant]:
    """In order, equal ones as one; too near each other, they cannot be told apart."""
    ordered: list[Instant] = []
    for instant in sorted(found, key=lambda i: i.time):
        if ordered and instant.time == ordered[-1].time:
            last = ordered[-1]
            ordered[-1] = Instant(last.time, last.sharp and instant.sharp, last.of + instant.of)
        elif ordered and instant.time - ordered[-1].time < CLOSE:
            raise Undecided("instants within rounding")
        else:
            ordered.append(instant)
    return ordered
