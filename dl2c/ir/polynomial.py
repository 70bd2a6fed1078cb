"""Terms as polynomials in one quantity: time along a flow, or an agent's input.

`polynomial` composes a term with the given curves and keeps coefficients as terms, so
that interpreter and compiled code evaluate them in one order. Structurally zero and one
factors are dropped; nothing else is simplified.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias, assert_never

from dl2c.ir.logic import folded, minus, plus, times
from dl2c.ir.model import ZERO, Add, Binary, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term

MAX_DEGREE = 32
"""Coefficients of higher powers are too long to be of use."""

Coefficients: TypeAlias = tuple[Term, ...]
"""c0, c1, ... of c0 + c1*tau + ...; never empty."""


def polynomial(term: Term, curves: Mapping[Symbol, Coefficients]) -> Coefficients | None:
    """Coefficients of the term along `curves`; None where it is not a polynomial or too high a one."""
    match term:
        case Symbol() if term in curves:
            return curves[term]
        case Number() | Symbol():
            return (term,)
        case Neg(child):
            inner = polynomial(child, curves)
            return None if inner is None else tuple(folded(Neg(c)) for c in inner)
        case Binary():
            a, b = polynomial(term.left, curves), polynomial(term.right, curves)
            return None if a is None or b is None else _combined(term, a, b)
        case Pow(base, exponent):
            a = polynomial(base, curves)
            if a is None or (len(a) - 1) * exponent > MAX_DEGREE:
                return None
            return (folded(Pow(a[0], exponent)),) if len(a) == 1 else _power(a, exponent)
        case Call(function, args):
            parts = [polynomial(a, curves) for a in args]
            if any(p is None or len(p) > 1 for p in parts):
                return None
            return (folded(Call(function, tuple(p[0] for p in parts if p is not None))),)
        case _:
            assert_never(term)


def _combined(term: Add | Sub | Mul | Div, a: Coefficients, b: Coefficients) -> Coefficients | None:
    """The sum, difference, product or quotient of two polynomials."""
    match term:
        case Add():
            return trimmed([plus(x, y) for x, y in _paired(a, b)])
        case Sub():
            return trimmed([minus(x, y) for x, y in _paired(a, b)])
        case Mul():
            return None if len(a) + len(b) - 2 > MAX_DEGREE else _product(a, b)
        case Div():
            return None if len(b) != 1 else tuple(_quotient(c, b[0]) for c in a)


def _quotient(a: Term, b: Term) -> Term:
    return ZERO if a == ZERO and isinstance(b, Number) and b != ZERO else folded(Div(a, b))


def _product(a: Coefficients, b: Coefficients) -> Coefficients:
    out: list[Term] = [ZERO] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] = plus(out[i + j], times(x, y))
    return trimmed(out)


def _power(a: Coefficients, exponent: int) -> Coefficients:
    """By the order that `ir.Pow` defines."""
    if exponent == 1:
        return a
    if exponent % 2:
        return _product(a, _power(a, exponent - 1))
    half = _power(a, exponent // 2)
    return _product(half, half)


def _paired(a: Coefficients, b: Coefficients) -> list[tuple[Term, Term]]:
    n = max(len(a), len(b))
    return [(a[k] if k < len(a) else ZERO, b[k] if k < len(b) else ZERO) for k in range(n)]


def trimmed(coefficients: Sequence[Term]) -> Coefficients:
    """Without structurally zero coefficients at the end."""
    n = len(coefficients)
    while n > 1 and coefficients[n - 1] == ZERO:
        n -= 1
    return tuple(coefficients[:n])
