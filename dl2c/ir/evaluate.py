"""The value of terms and the truth of formulas, in doubles or exactly.

Numbers are `float` (each literal and each operation rounded once, in tree order, as the
compiled code does) or `Fraction` (exact; irrational functions to `PRECISION` bits). An
undefined or non-finite subterm raises `Undefined`; an atom that has one is false.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import ARITHMETIC, COMPARISONS, true_where
from dl2c.ir.model import LARGEST_STATE, Binary, Call, Compare, Div, Formula, Neg, Number, Pow, Symbol, Term

Value: TypeAlias = float | Fraction
Valuation: TypeAlias = Mapping[Symbol, Value | None]
"""Values of symbols; None where an earlier assignment was undefined."""

PRECISION = 200
"""Bits of a square root in exact evaluation."""


class Undefined(ArithmeticError):
    """A subterm has no finite value."""


def literal(value: Fraction, exact: bool) -> Value:
    """The number itself, or the nearest double."""
    return value if exact else float(value)


def evaluate(term: Term, env: Valuation, exact: bool = False) -> Value:
    """The value of a term. Raises `Undefined`."""
    match term:
        case Number(value):
            return literal(value, exact)
        case Symbol():
            value = env[term]
            if value is None:
                raise Undefined(term.name)
            return value
        case Neg(child):
            return -evaluate(child, env, exact)
        case Div(left, right):
            dividend, divisor = evaluate(left, env, exact), evaluate(right, env, exact)
            if divisor == 0:
                raise Undefined("division by zero")
            return finite(dividend / divisor)
        case Binary():
            operation = ARITHMETIC[type(term)]
            return finite(operation(evaluate(term.left, env, exact), evaluate(term.right, env, exact)))
        case Pow(base, exponent):
            return _power(evaluate(base, env, exact), exponent)
        case Call("sqrt", (arg,)):
            return square_root(evaluate(arg, env, exact))
        case Call(function, args):
            values = [evaluate(a, env, exact) for a in args]
            row = FUNCTIONS[function]
            return row.value(*values) if row.exact else _library(function, values, exact)
        case _:
            assert_never(term)


def value_of(term: Term, env: Valuation, exact: bool = False) -> Value | None:
    """The value of a term; None where it has none."""
    try:
        return evaluate(term, env, exact)
    except Undefined:
        return None


def truth(formula: Formula, env: Valuation, exact: bool = False) -> bool:
    """Whether a formula holds; an atom with an undefined subterm does not (semantics 5)."""

    def holds(atom: Compare) -> bool:
        try:
            return COMPARISONS[atom.op](evaluate(atom.left, env, exact), evaluate(atom.right, env, exact))
        except Undefined:
            return False

    return true_where(formula, holds)


def finite(value: Value) -> Value:
    """The value, unless it overflowed."""
    if isinstance(value, float) and not math.isfinite(value):
        raise Undefined("overflow")
    return value


def in_range(value: Value | None) -> bool:
    """Whether a state may hold the value; beyond the range it counts as infinite (semantics 4)."""
    return value is not None and -LARGEST_STATE <= value <= LARGEST_STATE


def square_root(value: Value) -> Value:
    """The root, correctly rounded; of a rational, exact to `PRECISION` bits, rounded down."""
    if value < 0:
        raise Undefined("square root of a negative number")
    if isinstance(value, float):
        return math.sqrt(value)
    scale = max(0, PRECISION - value.numerator.bit_length() + value.denominator.bit_length())
    shifted = (value.numerator << (2 * scale)) // value.denominator
    return Fraction(math.isqrt(shifted), 1 << scale)


def _power(base: Value, exponent: int) -> Value:
    if exponent == 1:
        return base
    if exponent % 2:
        return finite(base * _power(base, exponent - 1))
    half = _power(base, exponent // 2)
    return finite(half * half)


def _library(function: str, args: list[Value], exact: bool) -> Value:
    """A transcendental function through doubles; in exact evaluation the result is that double."""
    try:
        value = finite(FUNCTIONS[function].value(*map(float, args)))
    except (OverflowError, ValueError, ZeroDivisionError):
        raise Undefined(function) from None
    return Fraction(value) if exact else value
