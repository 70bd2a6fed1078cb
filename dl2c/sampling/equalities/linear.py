"""Equalities solved for one name in which they are linear.

An equality and a box come in; for each name that it determines everywhere in the box, its value as a
term of the others goes out: its coefficient is proved to vanish nowhere there.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, assert_never

from dl2c.interval.arithmetic import Box, evaluate, magnitude
from dl2c.ir.logic import folded, operands, plus, size, substituted, symbols, with_operands
from dl2c.ir.model import (
    ONE,
    ZERO,
    Add,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
)
from dl2c.ir.normal import normal_form
from dl2c.sampling.equalities.algebra import derivative, fraction, has_dyadic_numbers, is_affine

MODERATE = 16.0
"""Slopes up to this are not avoided."""


@dataclass(frozen=True, slots=True)
class Solution:
    """`symbol = term` where the `conditions` hold; `slope` bounds its derivatives on the box."""

    symbol: Symbol
    term: Term
    divided: bool
    conditions: tuple[Formula, ...]
    slope: float


Rank: TypeAlias = tuple[bool, bool, bool, bool, bool, int, int, bool, int]


def rank(s: Solution, names: Sequence[Symbol], mentions: Mapping[Symbol, int]) -> Rank:
    """Smaller is better: plain numbers, affine, moderate, no division, variables before constants, seldom
    mentioned elsewhere, short, exact in doubles, declared early."""
    is_number = isinstance(s.term, Number)
    steep = s.slope > MODERATE
    affine = is_affine(s.term)
    variable = s.symbol.kind == "variable"
    mentioned, length = mentions.get(s.symbol, 0), size(s.term)
    exact = affine and has_dyadic_numbers(s.term)
    place = names.index(s.symbol)
    return not is_number, not affine, steep, s.divided, not variable, mentioned, length, not exact, place


def solutions(equality: Compare, names: Sequence[Symbol], box: Box) -> Iterator[Solution]:
    """At most one for each of the names."""
    difference = Sub(equality.left, equality.right)
    cleared = fraction(difference)
    for symbol in names:
        found = _direct(equality, symbol) or _isolated(difference, symbol, box)
        conditions: tuple[Formula, ...] = ()
        if found is None and cleared is not None and cleared[1] != ONE:
            found = _isolated(cleared[0], symbol, box)
            conditions = (Compare("!=", cleared[1], ZERO, span=equality.span),)
        if found is not None:
            yield Solution(symbol, *found, conditions, _slope(found[0], box))


def _direct(equality: Compare, symbol: Symbol) -> tuple[Term, bool] | None:
    for side, other in ((equality.left, equality.right), (equality.right, equality.left)):
        if side == symbol and symbol not in symbols(other):
            return other, False
    return None


def _isolated(difference: Term, symbol: Symbol, box: Box) -> tuple[Term, bool] | None:
    """The value that makes the difference zero, and whether it divides by more than a number."""
    parts = linear_parts(difference, symbol)
    if parts is None or not _is_nonzero(parts[0], box):
        return None
    coefficient, rest = parts
    if coefficient == ONE:
        return _difference(ZERO, rest), False
    if coefficient == folded(Neg(ONE)):
        return rest, False
    return folded(Div(_difference(ZERO, rest), coefficient)), not isinstance(coefficient, Number)


def _slope(term: Term, box: Box) -> float:
    if is_affine(term):
        return 0.0
    slopes = [evaluate(derivative(term, s), box) for s in symbols(term)]
    return max((magnitude(v).high if not v.empty else float("inf") for v in slopes), default=0.0)


def replaced(term: Term, values: Mapping[Symbol, Term]) -> Term:
    """The term over the reals with symbols replaced: parts without symbols become numbers."""
    return _folded(substituted(term, values))


def _folded(term: Term) -> Term:
    return folded(with_operands(term, tuple(map(_folded, operands(term)))))


def _is_nonzero(coefficient: Term, box: Box) -> bool:
    around = evaluate(coefficient, box)
    return around.total and not around.contains(0.0)


def is_tautology(equality: Compare) -> bool:
    """Whether both sides are the same polynomial, or the same by linear arithmetic."""
    rest = Sub(equality.left, equality.right)
    if (form := normal_form(rest)) is not None:
        return not form
    for symbol in sorted(symbols(rest), key=lambda s: s.name):
        parts = linear_parts(rest, symbol)
        if parts is None or parts[0] != ZERO:
            return False
        rest = parts[1]
    return folded(rest) == ZERO


def linear_parts(term: Term, symbol: Symbol) -> tuple[Term, Term] | None:
    """Terms (c, r) without the symbol, with term = c * symbol + r; None where it is not linear.

    Wherever c and r are defined and c is not zero, the term is defined too.
    """
    match term:
        case Symbol():
            return (ONE, ZERO) if term == symbol else (ZERO, term)
        case Number():
            return ZERO, term
        case Pow() | Call():
            return (ZERO, term) if symbol not in symbols(term) else None
        case Neg(child):
            parts = linear_parts(child, symbol)
            return (ZERO, term) if _lacks(parts, child) else _both(parts, lambda t: _difference(ZERO, t))
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            first, second = linear_parts(left, symbol), linear_parts(right, symbol)
        case _:
            assert_never(term)
    if _lacks(first, left) and _lacks(second, right):
        return ZERO, term
    match term:
        case Add():
            return _joined(plus, first, second)
        case Sub():
            return _joined(_difference, first, second)
        case Mul() if _lacks(first, left):
            return _both(second, lambda t: _product(left, t))
        case Mul() if _lacks(second, right):
            return _both(first, lambda t: _product(right, t))
        case Div() if _lacks(second, right):
            return _both(first, lambda t: t if t == ZERO else folded(Div(t, right)))
        case _:
            return None


Parts: TypeAlias = tuple[Term, Term] | None


def _lacks(parts: Parts, term: Term) -> bool:
    """Whether the symbol does not occur in a term with these parts."""
    return parts is not None and parts[1] is term


def _both(parts: Parts, change: Callable[[Term], Term]) -> Parts:
    return None if parts is None else (change(parts[0]), change(parts[1]))


def _joined(operation: Callable[[Term, Term], Term], left: Parts, right: Parts) -> Parts:
    if left is None or right is None:
        return None
    return operation(left[0], right[0]), operation(left[1], right[1])


def _difference(a: Term, b: Term) -> Term:
    """a - b, with a sign drawn inside where that saves an operation."""
    if b == ZERO:
        return a
    if a != ZERO:
        return folded(Add(a, b.child) if isinstance(b, Neg) else Sub(a, b))
    match b:
        case Neg(child):
            return child
        case Sub(left, right):
            return _difference(right, left)
        case _:
            return folded(Neg(b))


def _product(a: Term, b: Term) -> Term:
    """a * b for an `a` that also multiplies a nonzero coefficient, so that 0 may absorb it."""
    if b == ZERO:
        return ZERO
    return b if a == ONE else a if b == ONE else folded(Mul(a, b))
