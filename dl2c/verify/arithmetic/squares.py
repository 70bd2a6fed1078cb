"""Linear facts that sums of squares imply: solvers of nonlinear arithmetic find these late.

What is zero or less is zero in every summand; what is at most r^2, with r >= 0, is at most r in every base.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from dl2c.ir.logic import conjuncts, folded, substituted, with_sides
from dl2c.ir.model import ZERO, Add, Compare, Formula, Mul, Neg, Number, Pow, Symbol, Term


@dataclass(frozen=True, slots=True)
class Summand:
    """`factor * base ^ exponent`, with a positive factor and an even exponent."""

    factor: Fraction
    base: Term
    exponent: int


def implied(formulas: Iterable[Formula]) -> list[Compare]:
    """Comparisons that follow from those formulas that compare sums of squares, each once."""
    atoms = [a for f in formulas for a in conjuncts(f) if isinstance(a, Compare)]
    not_negative = {s for a in atoms for s in _not_negative(a)}
    found: dict[Compare, None] = {}
    for atom in atoms:
        for small, large in _ordered(atom):
            found.update(dict.fromkeys(_limits(summands(small), large, not_negative)))
    return list(found)


def with_known(facts: Iterable[Formula], goal: Formula) -> tuple[list[Formula], Formula]:
    """Facts, each once, and a goal, where symbols that facts say to be a number are that number."""
    given = list(dict.fromkeys(facts))
    values = {
        f.left: f.right
        for f in given
        if isinstance(f, Compare)
        and f.op == "="
        and isinstance(f.left, Symbol)
        and isinstance(f.right, Number)
    }
    if not values:
        return given, goal
    kept = [Compare("=", s, value) for s, value in values.items()]
    rest = [with_sides(f, lambda t: substituted(t, values)) for f in given]
    return [*kept, *rest], with_sides(goal, lambda t: substituted(t, values))


def _not_negative(atom: Compare) -> Iterator[Term]:
    if atom.op in (">", ">=") and isinstance(atom.right, Number) and atom.right.value >= 0:
        yield atom.left
    if atom.op in ("<", "<=") and isinstance(atom.left, Number) and atom.left.value >= 0:
        yield atom.right


def _ordered(atom: Compare) -> Iterator[tuple[Term, Term]]:
    """The sides, the first of which is at most the second."""
    if atom.op in ("<", "<=", "="):
        yield atom.left, atom.right
    if atom.op in (">", ">=", "="):
        yield atom.right, atom.left


def _limits(squares: Sequence[Summand], limit: Term, not_negative: set[Term]) -> Iterator[Compare]:
    if limit == ZERO:
        yield from (Compare("=", s.base, ZERO) for s in squares)
        return
    radius = _root(limit)
    if radius is not None and (isinstance(radius, Number) or radius in not_negative):
        for s in squares:
            if s.exponent == 2 and s.factor >= 1:
                yield Compare("<=", s.base, radius)
                yield Compare(">=", s.base, folded(Neg(radius)))


def _root(term: Term) -> Term | None:
    """A term whose square is this one; of a number the positive one, if it is rational."""
    match term:
        case Number(value) if value > 0:
            root = Fraction(isqrt(value.numerator), isqrt(value.denominator))
            return Number(root) if root**2 == value else None
        case Pow(base, 2):
            return base
        case Mul(left, right) if left == right:
            return left
        case _:
            return None


def summands(term: Term) -> list[Summand]:
    """What a term adds up, if that is even powers alone; else nothing."""
    match term:
        case Add(left, right):
            first, second = summands(left), summands(right)
            return [*first, *second] if first and second else []
        case Mul(Number(factor), square) | Mul(square, Number(factor)) if factor > 0:
            return [Summand(factor * s.factor, s.base, s.exponent) for s in summands(square)]
        case Mul(left, right) if left == right:
            return [Summand(Fraction(1), left, 2)]
        case Pow(base, exponent) if exponent > 0 and exponent % 2 == 0:
            return [Summand(Fraction(1), base, exponent)]
        case _:
            return []
