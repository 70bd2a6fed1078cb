"""Rounding errors that the compiled code bounds itself, from the values it has computed.

A term comes in, with a bound of the error of each of its names; a term goes out whose value in
doubles bounds |computed - exact| of the first one, and conditions under which it does so. This is
for terms that no bound known before serves: a divisor or a radicand comes close to zero somewhere.

Error analysis (Higham, "Accuracy and Stability of Numerical Algorithms", sections 3.1 and 3.3): an
operation is off by at most half a unit in the last place of its own computed result. Sums and
products of bounds are rounded too, which `MARGIN` covers for terms of less than 2**40 operations.
Assumes round to nearest and the operation order of the tree.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

from dl2c.ir.logic import folded, plus
from dl2c.ir.model import ZERO, Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term

ROUNDOFF = Number(Fraction(1, 2**53))
MARGIN = Number(1 + Fraction(1, 2**10))
TINY = Number(Fraction(1, 10**290))
"""More than what underflow loses."""


class NoErrorBound(ArithmeticError):
    """No bound of a term's rounding error is known: it may divide by zero, or overflow."""


@dataclass(frozen=True, slots=True)
class Running:
    """`error` bounds the error of a term's computed value wherever all `conditions` hold in doubles."""

    error: Term
    conditions: tuple[Formula, ...]


def running_error(term: Term, errors: Mapping[Symbol, float]) -> Running:
    """A bound that is computed along with the term; `errors` has every name of it.

    Raises `NoErrorBound` for numbers that are not doubles.
    """
    conditions: list[Formula] = []
    error = _error(term, errors, conditions)
    return Running(Add(Mul(error, MARGIN), TINY), tuple(dict.fromkeys(conditions)))


def _error(term: Term, errors: Mapping[Symbol, float], conditions: list[Formula]) -> Term:
    def of(part: Term) -> Term:
        return _error(part, errors, conditions)

    match term:
        case Number(value):
            try:
                return Number(abs(Fraction(float(value)) - value))
            except OverflowError:
                raise NoErrorBound from None
        case Symbol():
            return Number(Fraction(errors[term]))
        case Neg(child) | Call("abs", (child,)) | Pow(child, 1):
            return of(child)
        case Call("min" | "max", (left, right)):
            return _larger(of(left), of(right))
        case Add(left, right) | Sub(left, right):
            return plus(plus(of(left), of(right)), _rounding(term))
        case Mul(left, right):
            return _product(term, left, of(left), right, of(right))
        case Pow(base, exponent) if exponent % 2:
            rest = Pow(base, exponent - 1)
            return _product(term, base, of(base), rest, of(rest))
        case Pow(base, exponent):
            half = Pow(base, exponent // 2)
            error = of(half)
            return _product(term, half, error, half, error)
        case Div(left, right):
            a, b = of(left), of(right)
            conditions.append(Compare(">", _size(right), _twice(b)))
            inherited = plus(a, _times(_size(term), b))
            return plus(_twice(folded(Div(inherited, _size(right)))), _rounding(term))
        case Call("sqrt", (arg,)):
            a = of(arg)
            conditions.append(Compare(">=" if a == ZERO else ">", arg, _twice(a)))
            return plus(ZERO if a == ZERO else Div(a, term), _rounding(term))
        case Call():
            raise AssertionError(f"the sampler refuses {term.function}")
        case _:
            assert_never(term)


def _product(term: Term, left: Term, a: Term, right: Term, b: Term) -> Term:
    crossed = plus(_times(_size(left), b), _times(_size(right), a))
    return plus(plus(crossed, _times(a, b)), _rounding(term))


def _rounding(term: Term) -> Term:
    return Mul(_size(term), ROUNDOFF)


def _size(term: Term) -> Term:
    return folded(Call("abs", (term,)))


def _larger(a: Term, b: Term) -> Term:
    return folded(Call("max", (a, b))) if a != b else a


def _times(a: Term, b: Term) -> Term:
    return ZERO if ZERO in (a, b) else folded(Mul(a, b))


def _twice(a: Term) -> Term:
    return ZERO if a == ZERO else folded(Add(a, a))
