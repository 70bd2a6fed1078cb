"""Truth of formulas for many states at once: doubles, each with a bound of its error.

A number is a double and how far the real number may be from it; None where it is exact. A formula is
surely true, surely false, or neither, which exact numbers have to decide. The error of each operation is
bounded by what its operands' errors make of it, and half a unit in the last place of its result.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Comparison,
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

Doubles = NDArray[np.float64]
Bools = NDArray[np.bool_]

ROUNDING = 1.2e-16
"""More than half a unit in the last place, relative to the result."""
UNDERFLOW = 1e-300
LIBRARY = 16 * ROUNDING
"""More than what numpy's exp, sin and cos are off by, relative to 1 or to a larger result."""
INFLATION = 1 + 1e-9
"""What the arithmetic of the bounds itself may be off by, some thousand operations deep."""


@dataclass(frozen=True, slots=True)
class Near:
    """Numbers within `error` of `value`; None where they are these doubles."""

    value: Doubles
    error: Doubles | None = None

    @property
    def bound(self) -> Doubles:
        return np.zeros_like(self.value) if self.error is None else self.error


UNKNOWN = Near(np.array(np.nan), np.array(np.nan))
Environment = Mapping[Symbol, Near]


def near(number: Fraction | float) -> Near:
    """One number, for all states."""
    value = np.array(float(number))
    return Near(value) if Fraction(float(number)) == number else _rounded(value, np.array(0.0))


def evaluate(term: Term, env: Environment) -> Near:
    """The value of a term; NaN or an infinite error where it may be undefined."""
    match term:
        case Number(value):
            return near(value)
        case Symbol():
            return env[term]
        case Neg(child):
            a = evaluate(child, env)
            return Near(-a.value, a.error)
        case Add(left, right):
            return _added(evaluate(left, env), evaluate(right, env))
        case Sub(left, right):
            b = evaluate(right, env)
            return _added(evaluate(left, env), Near(-b.value, b.error))
        case Mul(left, right):
            return _multiplied(evaluate(left, env), evaluate(right, env))
        case Div(left, right):
            return _divided(evaluate(left, env), evaluate(right, env))
        case Pow(base, exponent):
            return reduce(_multiplied, [evaluate(base, env)] * exponent)
        case Call(function, args):
            return _called(function, [evaluate(a, env) for a in args])
        case _:
            assert_never(term)


def truths(formula: Formula, env: Environment, size: int) -> tuple[Bools, Bools]:
    """Where a formula surely holds, and where it possibly does."""
    match formula:
        case Truth(value):
            found = np.full(size, value)
            return found, found
        case Compare(op, left, right):
            surely, possibly = _compared(op, evaluate(left, env), evaluate(right, env))
            return np.broadcast_to(surely, (size,)), np.broadcast_to(possibly, (size,))
        case And(children):
            return _joined(np.logical_and, children, env, size)
        case Or(children):
            return _joined(np.logical_or, children, env, size)
        case _:
            assert_never(formula)


def in_doubles(formula: Formula, env: Environment, size: int) -> Bools:
    """What a program in doubles finds."""
    match formula:
        case Truth(value):
            return np.full(size, value)
        case Compare(op, left, right):
            found = _held(op, evaluate(left, env).value, evaluate(right, env).value)
            return np.broadcast_to(found, (size,))
        case And(children):
            return np.logical_and.reduce([in_doubles(c, env, size) for c in children])
        case Or(children):
            return np.logical_or.reduce([in_doubles(c, env, size) for c in children])
        case _:
            assert_never(formula)


def _joined(join: Any, children: Sequence[Formula], env: Environment, size: int) -> tuple[Bools, Bools]:
    parts = [truths(c, env, size) for c in children]
    return join.reduce([s for s, _ in parts]), join.reduce([p for _, p in parts])


def _held(op: Comparison, a: Doubles, b: Doubles) -> Bools:
    compare: dict[Comparison, Callable[..., Any]] = {
        "=": np.equal,
        "!=": np.not_equal,
        "<": np.less,
        "<=": np.less_equal,
        ">": np.greater,
        ">=": np.greater_equal,
    }
    return np.asarray(compare[op](a, b))


def _compared(op: Comparison, a: Near, b: Near) -> tuple[Bools, Bools]:
    if a.error is None and b.error is None:
        found = _held(op, a.value, b.value)
        return found, found
    if op in (">", ">="):
        return _compared("<" if op == ">" else "<=", b, a)
    apart = _added(a, Near(-b.value, b.error))
    value, error = apart.value, apart.bound * INFLATION
    less, more = value < -error, value > error
    match op:
        case "<":
            return less, ~(value >= error)
        case "<=":
            return value <= -error, ~more
        case "=":
            return np.zeros_like(less), ~(less | more)
        case _:
            return less | more, np.ones_like(less)


def _rounded(value: Doubles, error: Doubles) -> Near:
    return Near(value, error + np.abs(value) * ROUNDING + UNDERFLOW)


def _added(a: Near, b: Near) -> Near:
    return _rounded(a.value + b.value, a.bound + b.bound)


def _multiplied(a: Near, b: Near) -> Near:
    error = np.abs(a.value) * b.bound + np.abs(b.value) * a.bound + a.bound * b.bound
    return _rounded(a.value * b.value, error)


def _divided(a: Near, b: Near) -> Near:
    value, room = a.value / b.value, np.abs(b.value) - b.bound * INFLATION
    error = (a.bound + np.abs(value) * b.bound * INFLATION + UNDERFLOW) / room
    return _rounded(value, np.where(room > 0, error, np.nan))


def _called(function: str, args: list[Near]) -> Near:
    a = args[0]
    match function:
        case "abs":
            return Near(np.abs(a.value), a.error)
        case "min" | "max":
            b = args[1]
            value = np.where((a.value < b.value) == (function == "min"), a.value, b.value)
            exact = a.error is None and b.error is None
            return Near(value, None if exact else np.maximum(a.bound, b.bound))
        case "sqrt":
            value = np.sqrt(a.value)
            return _rounded(value, np.where(a.value > a.bound * INFLATION, a.bound / value, np.nan))
        case "exp":
            value = np.exp(a.value)
            return Near(value, value * (np.expm1(a.bound) * INFLATION + LIBRARY) + UNDERFLOW)
        case "sin" | "cos":
            value = np.sin(a.value) if function == "sin" else np.cos(a.value)
            return Near(value, a.bound + LIBRARY)
        case _:
            return Near(np.full_like(a.value, np.nan), np.full_like(a.value, np.nan))
