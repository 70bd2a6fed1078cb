"""Solve equalities of the precondition: a name that an equality determines is not drawn.

Top-level conjuncts and a box that holds every initial state come in; definitions for
as many names as there are independent equalities go out, with the conjuncts that are
left. A name can be eliminated where the equality is linear in it and its coefficient
is proved to vanish nowhere in the box.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, assert_never

from dl2c.interval.arithmetic import Box, evaluate
from dl2c.ir.logic import atoms, folded, mapped, operands, substituted, symbols
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


@dataclass(frozen=True, slots=True)
class Elimination:
    """`definitions` in the order of evaluation; `rest` holds no equality."""

    definitions: tuple[tuple[Symbol, Term], ...]
    rest: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class Unsolved:
    """An equality that determines no name."""

    atom: Compare


def eliminate(conjuncts: Sequence[Formula], names: Sequence[Symbol], box: Box) -> Elimination | Unsolved:
    """Solve every equality for one of `names`, the most direct definitions first."""
    pending = [c for c in conjuncts if isinstance(c, Compare) and c.op == "="]
    rest = tuple(c for c in conjuncts if c not in pending)
    solved: list[tuple[Symbol, Term]] = []
    while pending := [e for e in pending if not _is_tautology(e)]:
        found = [(_rank(d, names), k, d) for k, e in enumerate(pending) for d in _solutions(e, names, box)]
        if not found:
            return Unsolved(pending[0])
        _, k, best = min(found, key=lambda f: f[:2])
        del pending[k]
        solved.append((best.symbol, best.term))
        value = {best.symbol: best.term}
        pending = [
            Compare("=", substituted(e.left, value), substituted(e.right, value), span=e.span)
            for e in pending
        ]
    result = _with_numbers(reversed(solved), rest)
    inner = next((a for c in result.rest for a in atoms(c) if a.op == "="), None)
    return result if inner is None else Unsolved(inner)


def _with_numbers(definitions: Iterable[tuple[Symbol, Term]], rest: Iterable[Formula]) -> Elimination:
    """Names that turned out to be plain numbers replaced wherever they occur."""
    numbers: dict[Symbol, Term] = {}
    simple: list[tuple[Symbol, Term]] = []
    for symbol, term in definitions:
        value = replaced(term, numbers)
        simple.append((symbol, value))
        if isinstance(value, Number):
            numbers[symbol] = value
    return Elimination(tuple(simple), tuple(mapped(c, lambda t: replaced(t, numbers)) for c in rest))


def replaced(term: Term, values: Mapping[Symbol, Term]) -> Term:
    """The term over the reals with symbols replaced: parts without symbols become numbers."""
    return _folded(substituted(term, values))


def _folded(term: Term) -> Term:
    match term:
        case Number() | Symbol():
            return term
        case Neg(child):
            return folded(Neg(_folded(child)))
        case Pow(base, exponent):
            return folded(Pow(_folded(base), exponent))
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            return folded(type(term)(_folded(left), _folded(right)))
        case Call(function, args):
            return folded(Call(function, tuple(_folded(a) for a in args)))
        case _:
            assert_never(term)


@dataclass(frozen=True, slots=True)
class _Solution:
    symbol: Symbol
    term: Term
    divided: bool


def _rank(solution: _Solution, names: Sequence[Symbol]) -> tuple[bool, bool, bool, int, int]:
    """Smaller is better: plain numbers, no division, variables before constants, short, declared early."""
    s = solution
    is_number = isinstance(s.term, Number)
    return not is_number, s.divided, s.symbol.kind != "variable", _size(s.term), names.index(s.symbol)


def _solutions(equality: Compare, names: Sequence[Symbol], box: Box) -> Iterator[_Solution]:
    for symbol in names:
        for side, other in ((equality.left, equality.right), (equality.right, equality.left)):
            if side == symbol and symbol not in symbols(other):
                yield _Solution(symbol, other, divided=False)
                break
        else:
            parts = _linear(Sub(equality.left, equality.right), symbol)
            if parts is not None and _is_nonzero(parts[0], box):
                yield _solved(symbol, *parts)


def _solved(symbol: Symbol, coefficient: Term, rest: Term) -> _Solution:
    """The solution of coefficient * symbol + rest = 0."""
    if coefficient == ONE:
        return _Solution(symbol, _difference(ZERO, rest), divided=False)
    if coefficient == folded(Neg(ONE)):
        return _Solution(symbol, rest, divided=False)
    quotient = folded(Div(_difference(ZERO, rest), coefficient))
    return _Solution(symbol, quotient, divided=not isinstance(coefficient, Number))


def _is_nonzero(coefficient: Term, box: Box) -> bool:
    around = evaluate(coefficient, box)
    return around.total and not around.contains(0.0)


def _is_tautology(equality: Compare) -> bool:
    """Whether both sides are the same by linear arithmetic."""
    rest = Sub(equality.left, equality.right)
    for symbol in sorted(symbols(rest), key=lambda s: s.name):
        parts = _linear(rest, symbol)
        if parts is None or parts[0] != ZERO:
            return False
        rest = parts[1]
    return folded(rest) == ZERO


def _size(term: Term) -> int:
    return 1 + sum(_size(t) for t in operands(term))


def _linear(term: Term, symbol: Symbol) -> tuple[Term, Term] | None:
    """Terms (c, r) without the symbol, with term = c * symbol + r; None where it is not linear.

    Wherever c and r are defined and c is not zero, the term is defined too.
    """
    if symbol not in symbols(term):
        return ZERO, term
    match term:
        case Symbol():
            return ONE, ZERO
        case Neg(child):
            return _both(_linear(child, symbol), lambda t: _difference(ZERO, t))
        case Add(left, right):
            return _joined(_sum, _linear(left, symbol), _linear(right, symbol))
        case Sub(left, right):
            return _joined(_difference, _linear(left, symbol), _linear(right, symbol))
        case Mul(factor, other) if symbol not in symbols(factor):
            return _both(_linear(other, symbol), lambda t: _product(factor, t))
        case Mul(other, factor) if symbol not in symbols(factor):
            return _both(_linear(other, symbol), lambda t: _product(factor, t))
        case Div(dividend, divisor) if symbol not in symbols(divisor):
            return _both(_linear(dividend, symbol), lambda t: t if t == ZERO else folded(Div(t, divisor)))
        case Mul() | Div() | Pow() | Call():
            return None
        case Number():
            raise AssertionError("a number has no symbols")
        case _:
            assert_never(term)


Parts: TypeAlias = tuple[Term, Term] | None


def _both(parts: Parts, change: Callable[[Term], Term]) -> Parts:
    return None if parts is None else (change(parts[0]), change(parts[1]))


def _joined(operation: Callable[[Term, Term], Term], left: Parts, right: Parts) -> Parts:
    if left is None or right is None:
        return None
    return operation(left[0], right[0]), operation(left[1], right[1])


def _sum(a: Term, b: Term) -> Term:
    return b if a == ZERO else a if b == ZERO else folded(Add(a, b))


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
