"""Intervals of whole numbers over a power of two, rounded outwards: the arithmetic of the checker.

A number x stands for x / 2^SCALE. Shares no code with the enclosures of the search.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt
from typing import Literal, TypeAlias

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
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.policy_proof.question import Arithmetic

SCALE = 96
ONE = 1 << SCALE

UNLIMITED = 1 << 4000
"""An upper end that is this, or a lower end that is its negative, is no limit. Other ends are smaller."""

Ends: TypeAlias = tuple[int, int]
"""Low and high."""

Verdict: TypeAlias = Literal["true", "false", "open"]


@dataclass(frozen=True, slots=True)
class Rounding:
    """An arithmetic of the program: the relative error of an operation is 2^-`bits`, none where `bits` is 0,
    the error of tanh is `library`. Below `largest` nothing overflows. Results that underflow are off by
    2^-126 at most.
    """

    bits: int
    library: int
    largest: int

    def error(self, size: int, count: int = 1) -> int:
        """At least twice the error of `count` < 2^28 operations on numbers up to a size. One unit is for the
        rest of the quotient, one for what underflows.
        """
        return (2 * count * size >> self.bits) + 2 if self.bits else 0


ROUNDINGS: dict[Arithmetic, Rounding] = {
    "real": Rounding(0, 0, UNLIMITED),
    "double": Rounding(53, ONE >> 50, int(1e300) << SCALE),
    "float32": Rounding(24, ONE >> 21, int(1e37) << SCALE),
}
"""Those that `tables.ARITHMETIC` states."""


def down(value: Fraction) -> int:
    """The number below."""
    return (value.numerator << SCALE) // value.denominator


def up(value: Fraction) -> int:
    """The number above."""
    return -((-value.numerator << SCALE) // value.denominator)


def product(a: Ends, b: Ends) -> Ends:
    corners = [_times(x, y) for x in a for y in b]
    return min(corners) >> SCALE, -(-max(corners) >> SCALE)


def _times(x: int, y: int) -> int:
    if x and y and max(abs(x), abs(y)) >= UNLIMITED:
        return UNLIMITED << SCALE if (x > 0) == (y > 0) else -UNLIMITED << SCALE
    return x * y


def total(a: Ends, b: Ends) -> Ends:
    """The sum."""
    low = -UNLIMITED if -UNLIMITED in (a[0], b[0]) else a[0] + b[0]
    return low, UNLIMITED if UNLIMITED in (a[1], b[1]) else a[1] + b[1]


def quotient(a: Ends, b: Ends, nonzero: bool = False) -> Ends | None:
    """a / b; None where b may be 0. Where it is not, though its span begins or ends there, quotients are
    unlimited on one side.
    """
    if b[0] < 0 and b[1] == 0:
        return quotient((-a[1], -a[0]), (0, -b[0]), nonzero)
    if nonzero and b[0] == 0 < b[1]:
        low = _over(a[0], b[1]) if a[0] >= 0 else -UNLIMITED
        return low, -_over(-a[1], b[1]) if a[1] <= 0 else UNLIMITED
    if b[0] <= 0 <= b[1]:
        return None
    pairs = [(x, y) for x in a for y in b]
    return min(_over(x, y) for x, y in pairs), max(-_over(-x, y) for x, y in pairs)


def _over(x: int, y: int) -> int:
    """x / y, rounded down; 0 where y is unlimited, since the other ends say how large quotients may be."""
    if abs(y) >= UNLIMITED:
        return 0
    if abs(x) >= UNLIMITED:
        return UNLIMITED if (x > 0) == (y > 0) else -UNLIMITED
    return (x << SCALE) // y


def enclosed(term: Term, box: Mapping[Symbol, Ends], nonzero: frozenset[Symbol]) -> Ends | None:
    """An enclosure of a term's values; None where it may have none, or where none is known. Symbols in
    `nonzero` are not 0.
    """
    found = _enclosed(term, box, nonzero)
    if found is None or found[0] >= UNLIMITED or found[1] <= -UNLIMITED:
        return None
    return max(found[0], -UNLIMITED), min(found[1], UNLIMITED)


def _enclosed(term: Term, box: Mapping[Symbol, Ends], nonzero: frozenset[Symbol]) -> Ends | None:
    match term:
        case Number(value):
            return down(value), up(value)
        case Symbol():
            return box[term]
        case Call("sqrt" | "abs", (inner,)):
            a = enclosed(inner, box, nonzero)
            return None if a is None else _root(a) if term.function == "sqrt" else _magnitude(a)
        case Neg(inner) | Pow(inner, _):
            a = enclosed(inner, box, nonzero)
            if a is None:
                return None
            return (-a[1], -a[0]) if isinstance(term, Neg) else _power(a, term.exponent)
        case Add() | Sub() | Mul() | Div() | Call("min" | "max"):
            left, right = term.args if isinstance(term, Call) else (term.left, term.right)
            a, b = enclosed(left, box, nonzero), enclosed(right, box, nonzero)
            if a is None or b is None:
                return None
            return quotient(a, b, right in nonzero) if isinstance(term, Div) else _joined(term, a, b)
        case _:
            return None


def _joined(term: Term, a: Ends, b: Ends) -> Ends:
    match term:
        case Add():
            return total(a, b)
        case Sub():
            return total(a, (-b[1], -b[0]))
        case Mul(left, right):
            return _power(a, 2) if left == right else product(a, b)
        case Call("min"):
            return min(a[0], b[0]), min(a[1], b[1])
        case _:
            return max(a[0], b[0]), max(a[1], b[1])


def programmed(term: Term, box: Mapping[Symbol, Ends], rounding: Rounding) -> tuple[Ends, int] | None:
    """The values of a term, and how far from its value a program may be that rounds every symbol, number and
    result, and multiplies powers as `ir.evaluate` does. None where a value may be missing or overflow, or
    where that is not known.
    """
    match term:
        case Number() | Symbol():
            ends = enclosed(term, box, frozenset())
            return None if ends is None else _rounded(ends, 0, rounding)
        case Neg(inner) | Call("abs", (inner,)):
            found = programmed(inner, box, rounding)
            if found is None:
                return None
            (low, high), error = found
            return (-high, -low) if isinstance(term, Neg) else _magnitude((low, high)), error
        case Pow(base, 1):
            return programmed(base, box, rounding)
        case Pow(base, n) if n > 1:
            rest = Pow(base, n - 1 if n % 2 else n // 2)
            return programmed(Mul(base if n % 2 else rest, rest), box, rounding)
        case Add() | Sub() | Mul() | Div() | Call("min" | "max"):
            left, right = term.args if isinstance(term, Call) else (term.left, term.right)
            first, second = programmed(left, box, rounding), programmed(right, box, rounding)
            return None if first is None or second is None else _operated(term, first, second, rounding)
        case _:
            return None


def _operated(
    term: Term, left: tuple[Ends, int], right: tuple[Ends, int], rounding: Rounding
) -> tuple[Ends, int] | None:
    """`programmed` for a term of two. Errors of x * y are |x| dy + |y| dx + dx dy, those of x / y are
    (dx + |x / y| dy) / (|y| - dy).
    """
    (a, da), (b, db) = left, right
    match term:
        case Div():
            ends, least = quotient(a, b), max(b[0], -b[1]) - db
            if ends is None or least <= 0:
                return None
            return _rounded(ends, ((da << SCALE) + _size(ends) * db) // least + 1, rounding)
        case Mul():
            error = (_size(a) * db + _size(b) * da + da * db >> SCALE) + 1
            return _rounded(_joined(term, a, b), error, rounding)
        case Add() | Sub():
            return _rounded(_joined(term, a, b), da + db, rounding)
        case _:
            return _joined(term, a, b), max(da, db)


def _rounded(ends: Ends, error: int, rounding: Rounding) -> tuple[Ends, int] | None:
    most = _size(ends) + error
    return None if most >= rounding.largest else (ends, error + rounding.error(most) if rounding.bits else 0)


def _size(ends: Ends) -> int:
    return max(abs(ends[0]), abs(ends[1]))


def _magnitude(a: Ends) -> Ends:
    return max(0, a[0], -a[1]), max(-a[0], a[1])


def _power(a: Ends, exponent: int) -> Ends:
    base = _magnitude(a) if exponent % 2 == 0 else a
    made = base
    for _ in range(exponent - 1):
        made = product(made, base)
    return made


def _root(a: Ends) -> Ends | None:
    if a[0] < 0:
        return None
    return isqrt(a[0] << SCALE), UNLIMITED if a[1] >= UNLIMITED else isqrt(a[1] << SCALE) + 1


def judged(formula: Formula, box: Mapping[Symbol, Ends], nonzero: frozenset[Symbol] = frozenset()) -> Verdict:
    """Whether a formula holds on a whole box, nowhere on it, or neither is known."""
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare(op, left, right):
            a, b = enclosed(left, box, nonzero), enclosed(right, box, nonzero)
            return "open" if a is None or b is None else _compared(op, a, b)
        case _:
            parts = {judged(c, box, nonzero) for c in formula.children}
            ends: tuple[Verdict, Verdict] = (
                ("false", "true") if isinstance(formula, And) else ("true", "false")
            )
            return ends[0] if ends[0] in parts else "open" if "open" in parts else ends[1]


def _compared(op: str, a: Ends, b: Ends) -> Verdict:
    if op in (">", ">="):
        return _compared("<" if op == ">" else "<=", b, a)
    if op == "<":
        return "true" if a[1] < b[0] else "false" if a[0] >= b[1] else "open"
    if op == "<=":
        return "true" if a[1] <= b[0] else "false" if a[0] > b[1] else "open"
    unequal: Verdict = (
        "true" if a[1] < b[0] or b[1] < a[0] else "false" if a[0] == a[1] == b[0] == b[1] else "open"
    )
    if op == "!=":
        return unequal
    return "open" if unequal == "open" else "false" if unequal == "true" else "true"
