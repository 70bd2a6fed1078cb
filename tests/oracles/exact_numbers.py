"""Truth of formulas over the reals: rational numbers, and intervals for what is irrational.

Numbers are `Fraction`, anything else that computes exactly and compares (roots of polynomials, see
`one_unknown`), or intervals of mpmath around values of sqrt, exp, sin, cos, tan and tanh, whose precision
is raised until they decide. An atom with an undefined subterm is false.
"""

from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from math import isqrt
from typing import Any, assert_never

from mpmath.ctx_iv import MPIntervalContext

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

Value = Any
"""A number that is exact, or an interval."""

DIGITS = (30, 100, 400)
"""Of intervals, as long as they decide nothing."""

iv: Any = MPIntervalContext()
Interval: Any = iv.mpf(0).__class__


class Undefined(ArithmeticError):
    """A subterm has no value."""


class Unclear(ArithmeticError):
    """An interval does not say whether a subterm has a value, or which."""


def evaluate(term: Term, env: Mapping[Symbol, Value]) -> Value:
    """The value of a term. Raises `Undefined`, `Unclear`."""
    match term:
        case Number(value):
            return value
        case Symbol():
            if (found := env[term]) is None:
                raise Undefined(term.name)
            return found
        case Neg(child):
            return -evaluate(child, env)
        case Add(left, right):
            return _binary(lambda a, b: a + b, left, right, env)
        case Sub(left, right):
            return _binary(lambda a, b: a - b, left, right, env)
        case Mul(left, right):
            return _binary(lambda a, b: a * b, left, right, env)
        case Div(left, right):
            return _binary(quotient, left, right, env)
        case Pow(base, exponent):
            return power(evaluate(base, env), exponent)
        case Call(function, args):
            return called(function, [evaluate(a, env) for a in args])
        case _:
            assert_never(term)


def _binary(compute: Callable[[Value, Value], Value], a: Term, b: Term, env: Mapping[Symbol, Value]) -> Value:
    return compute(*alike(evaluate(a, env), evaluate(b, env)))


def alike(a: Value, b: Value) -> tuple[Value, Value]:
    """Both as intervals where one is."""
    if isinstance(a, Interval) or isinstance(b, Interval):
        return interval(a), interval(b)
    return a, b


def interval(a: Value) -> Value:
    return a if isinstance(a, Interval) else iv.mpf(a.numerator) / iv.mpf(a.denominator)


def quotient(a: Value, b: Value) -> Value:
    if isinstance(b, Interval):
        if 0 in b:
            raise Unclear
    elif b == 0:
        raise Undefined("division by zero")
    return a / b


def power(base: Value, exponent: int) -> Value:
    if isinstance(base, Fraction | Interval):
        return base**exponent
    found = base
    for _ in range(exponent - 1):
        found = found * base
    return found


def called(function: str, args: list[Value]) -> Value:
    """A builtin function of exact numbers or intervals."""
    a = args[0]
    match function:
        case "abs":
            return abs(a)
        case "min" | "max":
            a, b = alike(*args)
            if isinstance(a, Interval):
                low, high = (min, min) if function == "min" else (max, max)
                return iv.mpf([low(a.a, b.a), high(a.b, b.b)])
            return min(a, b) if function == "min" else max(a, b)
        case "sqrt":
            return _root(a)
        case "exp" | "sin" | "cos" | "tan" | "tanh" if isinstance(a, Fraction | Interval):
            return _transcendental(function, a)
        case _:
            raise Unclear(function)


def _root(a: Value) -> Value:
    if isinstance(a, Fraction):
        if a < 0:
            raise Undefined("square root of a negative number")
        up, down = isqrt(a.numerator), isqrt(a.denominator)
        if up * up == a.numerator and down * down == a.denominator:
            return Fraction(up, down)
        return iv.sqrt(interval(a))
    if not isinstance(a, Interval) or (a.a < 0 <= a.b):
        raise Unclear("sqrt")
    if a.b < 0:
        raise Undefined("square root of a negative number")
    return iv.sqrt(a)


def _transcendental(function: str, a: Value) -> Value:
    if a == 0:
        return Fraction(function in ("exp", "cos"))
    a = interval(a)
    match function:
        case "exp":
            return iv.exp(a)
        case "sin":
            return iv.sin(a)
        case "cos":
            return iv.cos(a)
        case "tan":
            return quotient(iv.sin(a), iv.cos(a))
        case _:
            square = iv.exp(2 * a)
            return (square - 1) / (square + 1)


def truth(formula: Formula, env: Mapping[Symbol, Value]) -> bool | None:
    """Whether a formula holds; None where intervals do not say."""
    match formula:
        case Truth(value):
            return value
        case Compare(op, left, right):
            try:
                return holds(op, *alike(evaluate(left, env), evaluate(right, env)))
            except Undefined:
                return False
            except Unclear:
                return None
        case And(children):
            return conjoined(truth(c, env) for c in children)
        case Or(children):
            found = conjoined(negated(truth(c, env)) for c in children)
            return negated(found)
        case _:
            assert_never(formula)


def conjoined(parts: Iterable[bool | None]) -> bool | None:
    """Whether all hold; stops at the first that does not."""
    found: bool | None = True
    for part in parts:
        if part is False:
            return False
        found = None if part is None else found
    return found


def negated(truth: bool | None) -> bool | None:
    return None if truth is None else not truth


def holds(op: Comparison, a: Value, b: Value) -> bool | None:
    """Whether two numbers, or two intervals, compare so."""
    match op:
        case "=" | "!=":
            same = _overlapping(a, b) if isinstance(a, Interval) else bool(a == b)
            return same if op == "=" else negated(same)
        case "<":
            return None if (found := a < b) is None else bool(found)
        case "<=":
            return None if (found := a <= b) is None else bool(found)
        case ">":
            return holds("<", b, a)
        case ">=":
            return holds("<=", b, a)
        case _:
            assert_never(op)


def _overlapping(a: Value, b: Value) -> bool | None:
    """False where two intervals are apart; else they do not say whether they stand for one number."""
    return False if a.b < b.a or b.b < a.a else None


def decided(question: Callable[[], bool | None]) -> bool | None:
    """The answer to a question, with intervals as narrow as it takes."""
    for digits in DIGITS:
        iv.dps = digits
        if (found := question()) is not None:
            return found
    return None
