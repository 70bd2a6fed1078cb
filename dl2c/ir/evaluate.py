"""The value of terms and the truth of formulas, in doubles or exactly.

Numbers are `float` (each literal and each operation rounded once, in tree order, as the
compiled code does) or `Fraction` (exact; irrational functions to `PRECISION` bits). An
undefined or non-finite subterm raises `Undefined`; an atom that has one is false.
"""

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.ir.logic import holds
from dl2c.ir.model import (
    LARGEST_STATE,
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

Value: TypeAlias = float | Fraction
Environment: TypeAlias = Mapping[Symbol, Value | None]
"""Values of symbols; None where an earlier assignment was undefined."""

PRECISION = 200
"""Bits of a square root in exact evaluation."""


class Undefined(ArithmeticError):
    """A subterm has no finite value."""


def literal(value: Fraction, exact: bool) -> Value:
    """The number itself, or the nearest double."""
    return value if exact else float(value)


def evaluate(term: Term, env: Environment, exact: bool = False) -> Value:
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
        case Add(left, right):
            return finite(evaluate(left, env, exact) + evaluate(right, env, exact))
        case Sub(left, right):
            return finite(evaluate(left, env, exact) - evaluate(right, env, exact))
        case Mul(left, right):
            return finite(evaluate(left, env, exact) * evaluate(right, env, exact))
        case Div(left, right):
            dividend, divisor = evaluate(left, env, exact), evaluate(right, env, exact)
            if divisor == 0:
                raise Undefined("division by zero")
            return finite(dividend / divisor)
        case Pow(base, exponent):
            return _power(evaluate(base, env, exact), exponent)
        case Call("abs", (arg,)):
            return abs(evaluate(arg, env, exact))
        case Call("min", (left, right)):
            a, b = evaluate(left, env, exact), evaluate(right, env, exact)
            return a if a < b else b
        case Call("max", (left, right)):
            a, b = evaluate(left, env, exact), evaluate(right, env, exact)
            return a if a > b else b
        case Call("sqrt", (arg,)):
            return square_root(evaluate(arg, env, exact))
        case Call(function, args):
            return _library(function, [float(evaluate(a, env, exact)) for a in args], exact)
        case _:
            assert_never(term)


def truth(formula: Formula, env: Environment, exact: bool = False) -> bool:
    """Whether a formula holds; an atom with an undefined subterm does not (semantics 5)."""
    match formula:
        case Truth(value):
            return value
        case Compare(op, left, right):
            try:
                return holds(op, evaluate(left, env, exact), evaluate(right, env, exact))
            except Undefined:
                return False
        case And(children):
            return all(truth(c, env, exact) for c in children)
        case Or(children):
            return any(truth(c, env, exact) for c in children)
        case _:
            assert_never(formula)


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


LIBRARY: dict[str, Callable[..., float]] = {
    "exp": math.exp,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": math.asin,
    "arctan": math.atan,
    "tanh": math.tanh,
    "pow": math.pow,
}


def _library(function: str, args: list[float], exact: bool) -> Value:
    """A transcendental function through doubles; in exact evaluation the result is that double."""
    try:
        value = finite(LIBRARY[function](*args))
    except (OverflowError, ValueError, ZeroDivisionError):
        raise Undefined(function) from None
    return Fraction(value) if exact else value
