"""An auditor of admissible inputs that shares no code with dl2c.

Tests are Python functions of numbers. Given `Double`s they are evaluated as IEEE doubles are, by
exact rational arithmetic and one rounding for each operation; given NumPy arrays, on a whole grid.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np

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

Operand: TypeAlias = "Double | float | int"


def rounded(value: Fraction) -> Fraction:
    """The nearest double, ties to even."""
    return Fraction(float(value))


@dataclass(frozen=True)
class Double:
    """A double as a rational number."""

    exact: Fraction

    def __add__(self, other: Operand) -> "Double":
        return Double(rounded(self.exact + of(other).exact))

    def __sub__(self, other: Operand) -> "Double":
        return Double(rounded(self.exact - of(other).exact))

    def __mul__(self, other: Operand) -> "Double":
        return Double(rounded(self.exact * of(other).exact))

    def __truediv__(self, other: Operand) -> "Double":
        return Double(rounded(self.exact / of(other).exact))

    def __radd__(self, other: Operand) -> "Double":
        return of(other) + self

    def __rsub__(self, other: Operand) -> "Double":
        return of(other) - self

    def __rmul__(self, other: Operand) -> "Double":
        return of(other) * self

    def __rtruediv__(self, other: Operand) -> "Double":
        return of(other) / self

    def __abs__(self) -> "Double":
        return Double(abs(self.exact))

    def __neg__(self) -> "Double":
        return Double(-self.exact)

    def __le__(self, other: Operand) -> bool:
        return self.exact <= of(other).exact

    def __lt__(self, other: Operand) -> bool:
        return self.exact < of(other).exact

    def __ge__(self, other: Operand) -> bool:
        return self.exact >= of(other).exact

    def __gt__(self, other: Operand) -> bool:
        return self.exact > of(other).exact


def of(value: Operand) -> Double:
    return value if isinstance(value, Double) else Double(Fraction(value))


def grid(low: float, high: float, count: int = 401) -> Any:
    """Values between two limits, the limits among them, and half of them at multiples of 1/8."""
    steps = np.arange(np.ceil(low * 8), np.floor(high * 8) + 1) / 8
    return np.unique(np.concatenate([np.linspace(low, high, count), steps]))


def value(term: Term, at: Mapping[Symbol, Double]) -> Double | None:
    """The double that a term of the IR has as value; None where undefined."""
    match term:
        case Number(number):
            return Double(rounded(number))
        case Symbol():
            return at[term]
        case Pow(base, n):
            if n == 1:
                return value(base, at)
            half = value(Pow(base, n // 2), at)
            square = None if half is None else half * half
            odd = value(base, at) if n % 2 else of(1)
            return None if square is None or odd is None else odd * square
        case Neg(child):
            inner = value(child, at)
            return None if inner is None else -inner
        case Call(name, args):
            values = [value(a, at) for a in args]
            present = [v.exact for v in values if v is not None]
            if len(present) < len(values):
                return None
            return Double({"abs": abs, "min": min, "max": max}[name](*present))
    a, b = value(term.left, at), value(term.right, at)
    if a is None or b is None:
        return None
    try:
        return _combined(term, a, b)
    except OverflowError:
        return None


def _combined(term: Term, a: Double, b: Double) -> Double | None:
    match term:
        case Add():
            return a + b
        case Sub():
            return a - b
        case Mul():
            return a * b
        case Div():
            return None if b.exact == 0 else a / b
    raise AssertionError(term)


def holds(formula: Formula, at: Mapping[Symbol, Double], slack: Fraction = Fraction(0)) -> bool:
    """Whether a formula of the IR holds; equalities up to a relative `slack`."""
    match formula:
        case Truth(truth):
            return truth
        case And(children):
            return all(holds(c, at, slack) for c in children)
        case Or(children):
            return any(holds(c, at, slack) for c in children)
        case Compare(op, left, right):
            first, second = value(left, at), value(right, at)
            if first is None or second is None:
                return False
            a, b = first.exact, second.exact
            equal = abs(a - b) <= slack * (1 + abs(a) + abs(b))
            return {"=": equal, "!=": a != b, "<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[op]
