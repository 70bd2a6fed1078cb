"""Whether numbers exist that satisfy conditions, by exact reasoning about one unknown at a time.

An equality that is linear in an unknown, with a rational coefficient, gives its value. What is left is
split into conditions of one unknown each: between neighbouring roots of the polynomials in them, of degree
2 at most, no condition changes its truth, so that roots and a number from each gap are all there is to
try. Roots are numbers a + b*sqrt(d), which compute and compare exactly. Where that does not suffice the
answer is None.
"""

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cmp_to_key
from itertools import pairwise, product
from math import isqrt
from typing import Union

from oracles.exact_numbers import conjoined, truth

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

Polynomial = list[Fraction]
"""c0, c1, ..."""
Ratio = tuple[Polynomial, Polynomial]


class TooHard(Exception):
    """No polynomials of one unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Surd:
    """a + b*sqrt(d)."""

    a: Fraction
    b: Fraction
    d: Fraction
    __hash__ = None  # type: ignore[assignment]  # numbers that are equal have several forms

    def _with(self, other: Union["Surd", Fraction, int]) -> "Surd":
        return other if isinstance(other, Surd) else Surd(Fraction(other), Fraction(0), self.d)

    def __add__(self, other: Union["Surd", Fraction, int]) -> "Surd":
        o = self._with(other)
        return Surd(self.a + o.a, self.b + o.b, self.d)

    def __neg__(self) -> "Surd":
        return Surd(-self.a, -self.b, self.d)

    def __sub__(self, other: Union["Surd", Fraction, int]) -> "Surd":
        return self + -self._with(other)

    def __rsub__(self, other: Fraction | int) -> "Surd":
        return -self + other

    def __mul__(self, other: Union["Surd", Fraction, int]) -> "Surd":
        o = self._with(other)
        return Surd(self.a * o.a + self.b * o.b * self.d, self.a * o.b + self.b * o.a, self.d)

    __radd__ = __add__
    __rmul__ = __mul__

    def __truediv__(self, other: Union["Surd", Fraction, int]) -> "Surd":
        o = self._with(other)
        norm = o.a * o.a - o.b * o.b * self.d
        if norm == 0:  # o = 2a, as sqrt(d) is the rational a/b
            return Surd(self.a / (2 * o.a), self.b / (2 * o.a), self.d)
        return self * Surd(o.a / norm, -o.b / norm, self.d)

    def __rtruediv__(self, other: Fraction | int) -> "Surd":
        return self._with(other) / self

    def sign(self) -> int:
        a, b = _sign(self.a), _sign(self.b) * _sign(self.d)
        if a == b or not a or not b:
            return a or b
        return a * _sign(self.a**2 - self.b**2 * self.d)

    def __abs__(self) -> "Surd":
        return -self if self.sign() < 0 else self

    def __eq__(self, other: object) -> bool:
        assert isinstance(other, Surd | Fraction | int)
        return (self - other).sign() == 0

    def __lt__(self, other: Union["Surd", Fraction, int]) -> bool:
        return (self - other).sign() < 0

    def __le__(self, other: Union["Surd", Fraction, int]) -> bool:
        return (self - other).sign() <= 0

    def __gt__(self, other: Union["Surd", Fraction, int]) -> bool:
        return (self - other).sign() > 0

    def __ge__(self, other: Union["Surd", Fraction, int]) -> bool:
        return (self - other).sign() >= 0

    def around(self, bits: int) -> Fraction:
        """A rational number near it."""
        scale = 1 << (2 * bits)
        root = isqrt(self.d.numerator * scale // self.d.denominator)
        return self.a + self.b * Fraction(root, 1 << bits)


def _sign(x: Fraction | int) -> int:
    return (x > 0) - (x < 0)


def order(x: Surd, y: Surd) -> int:
    """The sign of x - y, whose roots may differ."""
    if x.d == y.d:
        return (x - y).sign()
    rest = Surd(x.a - y.a, x.b, x.d)
    left, right = rest.sign(), _sign(y.b) * _sign(y.d)
    if left != right or not left:
        return _sign(left - right)
    return left * (rest * rest - y.b * y.b * y.d).sign()


def satisfiable(conditions: Sequence[Formula]) -> bool | None:
    """Whether values of the symbols in the conditions satisfy all; None where that is too hard."""
    parts = [p for c in conditions for p in (c.children if isinstance(c, And) else (c,))]
    known = conjoined(truth(p, {}) for p in parts if not unknowns(p))
    rest = [p for p in parts if unknowns(p)]
    if known is False or not rest:
        return known
    for part in rest:
        if isinstance(part, Compare) and part.op == "=" and (found := _solved(part)) is not None:
            return satisfiable([_replaced(p, found) for p in parts])
    return conjoined((known, *(_each(group) for group in _groups(rest))))


def unknowns(node: Formula | Term) -> frozenset[Symbol]:
    match node:
        case Symbol():
            return frozenset((node,))
        case Number() | Truth():
            return frozenset()
        case Neg(a) | Pow(a, _):
            return unknowns(a)
        case Call(_, parts) | And(parts) | Or(parts):
            return frozenset[Symbol]().union(*(unknowns(p) for p in parts))
        case Add(a, b) | Sub(a, b) | Mul(a, b) | Div(a, b) | Compare(_, a, b):
            return unknowns(a) | unknowns(b)


def _groups(conditions: list[Formula]) -> Iterator[list[Formula]]:
    """Conditions that share unknowns, directly or through others."""
    left = list(conditions)
    while left:
        group, names = [left.pop()], frozenset[Symbol]()
        while names != (names := frozenset[Symbol]().union(*(unknowns(c) for c in group))):
            group += [c for c in left if unknowns(c) & names]
            left = [c for c in left if not unknowns(c) & names]
        yield group


def _solved(equation: Compare) -> dict[Symbol, Term] | None:
    """The value of an unknown that the equality is linear in."""
    for x in unknowns(equation):
        try:
            slope, rest = _linear(Sub(equation.left, equation.right), x)
        except TooHard:
            continue
        if slope != 0:
            return {x: folded(Mul(Number(-1 / slope), rest), {})}
    return None


def _linear(term: Term, x: Symbol) -> tuple[Fraction, Term]:
    """`slope`, `rest`: the term is slope*x + rest."""
    if x not in unknowns(term):
        return Fraction(0), term
    match term:
        case Symbol():
            return Fraction(1), Number(Fraction(0))
        case Neg(a):
            slope, rest = _linear(a, x)
            return -slope, Neg(rest)
        case Add(a, b) | Sub(a, b):
            (s, p), (t, q) = _linear(a, x), _linear(b, x)
            return (s + t, Add(p, q)) if isinstance(term, Add) else (s - t, Sub(p, q))
        case Mul(Number(c), a) | Mul(a, Number(c)):
            slope, rest = _linear(a, x)
            return slope * c, Mul(Number(c), rest)
        case Div(a, Number(c)) if c != 0:
            slope, rest = _linear(a, x)
            return slope / c, Div(rest, Number(c))
        case _:
            raise TooHard


def _replaced(formula: Formula, found: dict[Symbol, Term]) -> Formula:
    match formula:
        case Compare(op, a, b):
            return Compare(op, folded(a, found), folded(b, found))
        case And(children):
            return And(tuple(_replaced(c, found) for c in children))
        case Or(children):
            return Or(tuple(_replaced(c, found) for c in children))
        case _:
            return formula


OPERATIONS: dict[type[Term], Callable[[Fraction, Fraction], Fraction]] = {
    Add: operator.add,
    Sub: operator.sub,
    Mul: operator.mul,
    Div: lambda a, b: a / b,
}


def folded(term: Term, found: dict[Symbol, Term]) -> Term:
    """The term with terms for symbols, and numbers for sums and products of numbers."""
    match term:
        case Symbol():
            return found.get(term, term)
        case Neg(a):
            a = folded(a, found)
            return Number(-a.value) if isinstance(a, Number) else Neg(a)
        case Add(a, b) | Sub(a, b) | Mul(a, b) | Div(a, b):
            a, b = folded(a, found), folded(b, found)
            match a, b:
                case Number(p), Number(q) if q != 0 or not isinstance(term, Div):
                    return Number(OPERATIONS[type(term)](p, q))
                case _:
                    return type(term)(a, b)
        case Pow(a, n):
            a = folded(a, found)
            return Number(a.value**n) if isinstance(a, Number) else Pow(a, n)
        case Call(function, args):
            return Call(function, tuple(folded(a, found) for a in args))
        case _:
            return term


def _each(conditions: list[Formula]) -> bool | None:
    """Whether a value of the one unknown satisfies them."""
    (x, *more) = frozenset[Symbol]().union(*(unknowns(c) for c in conditions))
    if more:
        return None
    critical: list[Polynomial] = []
    try:
        for condition in conditions:
            critical += _criticals(condition)
    except TooHard:
        return None
    roots = sorted((r for c in critical if len(c) < 4 for r in _roots(c)), key=cmp_to_key(order))
    found = [conjoined(truth(c, {x: point}) for c in conditions) for point in _points(roots)]
    if any(found):
        return True
    return None if None in found or any(len(c) > 3 for c in critical) else False


def _points(roots: list[Surd]) -> Iterator[Surd | Fraction]:
    """The roots, and a number beyond them and between any two that differ."""
    if not roots:
        yield Fraction(0)
        return
    yield from roots
    yield roots[0].around(4) - 2 * (1 + abs(roots[0].b))
    yield roots[-1].around(4) + 2 * (1 + abs(roots[-1].b))
    for x, y in pairwise(roots):
        bits = 8
        while order(x, y) < 0:
            middle = (x.around(bits) + y.around(bits)) / 2
            if x < middle < y:
                yield middle
                break
            bits *= 2


def _roots(c: Polynomial) -> list[Surd]:
    match c:
        case [c0, c1]:
            return [Surd(-c0 / c1, Fraction(0), Fraction(0))]
        case [c0, c1, c2]:
            d = c1 * c1 - 4 * c2 * c0
            a, b = -c1 / (2 * c2), 1 / (2 * abs(c2))
            return [Surd(a, -b, d), Surd(a, b, d)] if d >= 0 else []
        case _:
            return []


def _criticals(formula: Formula) -> Iterator[Polynomial]:
    """Polynomials at whose roots alone a formula may change its truth."""
    match formula:
        case Compare(_, a, b):
            for p, q in product(_ratios(a), _ratios(b)):
                yield _difference(p, q)
            for side in (a, b):
                yield from _kinks(side)
        case And(children) | Or(children):
            for child in children:
                yield from _criticals(child)
        case _:
            pass


def _kinks(term: Term) -> Iterator[Polynomial]:
    """Polynomials at whose roots a term may be undefined or change its form."""
    match term:
        case Add(a, b) | Sub(a, b) | Mul(a, b) | Div(a, b):
            yield from _kinks(a)
            yield from _kinks(b)
            if isinstance(term, Div):
                yield from (n for n, _ in _ratios(b))
        case Neg(a) | Pow(a, _):
            yield from _kinks(a)
        case Call(_, args):
            for a in args:
                yield from _kinks(a)
            forms = [_ratios(a) for a in args]
            yield from (n for n, _ in forms[0]) if len(forms) == 1 else ()
            yield from (_difference(p, q) for p, q in product(*forms)) if len(forms) == 2 else ()
        case _:
            pass


def _difference(p: Ratio, q: Ratio) -> Polynomial:
    return _plus(_times(p[0], q[1]), _times([Fraction(-1)], _times(q[0], p[1])))


def _ratios(term: Term) -> list[Ratio]:
    """What a term may be equal to: a polynomial over another, for each form that it may have."""
    one = [Fraction(1)]
    match term:
        case Number(value):
            return [(_trimmed([value]), one)]
        case Symbol():
            return [([Fraction(0), Fraction(1)], one)]
        case Neg(a):
            return [(_times([Fraction(-1)], n), d) for n, d in _ratios(a)]
        case Add(a, b):
            pairs = product(_ratios(a), _ratios(b))
            return [(_plus(_times(p[0], q[1]), _times(q[0], p[1])), _times(p[1], q[1])) for p, q in pairs]
        case Sub(a, b):
            return [(_difference(p, q), _times(p[1], q[1])) for p, q in product(_ratios(a), _ratios(b))]
        case Mul(a, b):
            return [(_times(n, m), _times(d, e)) for (n, d), (m, e) in product(_ratios(a), _ratios(b))]
        case Div(a, b):
            return [(_times(n, e), _times(d, m)) for (n, d), (m, e) in product(_ratios(a), _ratios(b))]
        case Pow(a, n):
            return _ratios(a) if n == 1 else _ratios(Mul(a, Pow(a, n - 1)))
        case Call("abs", (a,)):
            return [*_ratios(a), *_ratios(Neg(a))]
        case Call("min" | "max", (a, b)):
            return [*_ratios(a), *_ratios(b)]
        case _:
            raise TooHard


def _plus(p: Polynomial, q: Polynomial) -> Polynomial:
    n = max(len(p), len(q))
    zero = [Fraction(0)] * n
    return _trimmed([a + b for a, b in zip((p + zero)[:n], (q + zero)[:n], strict=True)])


def _times(p: Polynomial, q: Polynomial) -> Polynomial:
    found = [Fraction(0)] * max(0, len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            found[i + j] += a * b
    return _trimmed(found)


def _trimmed(c: Polynomial) -> Polynomial:
    n = len(c)
    while n and c[n - 1] == 0:
        n -= 1
    return c[:n]
