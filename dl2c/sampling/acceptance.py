"""A test in doubles that proves a formula over the reals.

A formula over drawn doubles comes in, with the range of every name; a formula goes out
that the compiled code evaluates in doubles. Each of its atoms compares with a slack that
bounds the rounding errors of both sides, so that wherever it is true in doubles, the
original formula holds for the exact real values.

Error analysis (Higham, "Accuracy and Stability of Numerical Algorithms", ch. 3): every
operation contributes half a unit in the last place of the largest possible result.
Assumes round to nearest, numbers rounded once, the operation order of the tree.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.interval.arithmetic import Box, Interval, enclosure, evaluate, magnitude, truth
from dl2c.interval.contract import contract
from dl2c.interval.rounding import add_down, add_up, div_up, mul_up, sqrt_down, sqrt_up
from dl2c.ir.logic import conjunction, disjunction, operands
from dl2c.ir.model import (
    FALSE,
    ONE,
    ZERO,
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

Errors: TypeAlias = Mapping[Symbol, float]

UNIT_ROUNDOFF = 2.0**-53
SMALLEST = 2.0**-1074
LARGEST = 1e300
"""Magnitudes beyond this count as overflow."""


class Unbounded(Exception):
    """No bound exists for the rounding error of an atom or of a defined name: a divisor may
    come close to zero, or a value overflows."""

    def __init__(self, subject: Compare | Symbol) -> None:
        super().__init__(subject)
        self.subject = subject


class _NoErrorBound(ArithmeticError):
    """A term may divide by zero, or overflow."""


@dataclass(frozen=True, slots=True)
class Acceptance:
    """`formula` is the test; `errors` bounds |computed - exact| of every name, 0 for drawn ones."""

    formula: Formula
    errors: Mapping[Symbol, float]


def acceptance(
    formula: Formula,
    definitions: Sequence[tuple[Symbol, Term]],
    bounds: Mapping[Symbol, Formula],
    box: Box,
) -> Acceptance:
    """A test for `formula`, the definedness of the definitions and the bounds of what they define.

    `box` limits the drawn names. Raises `Unbounded`.
    """
    ranges, errors = dict(box), dict.fromkeys(box, 0.0)
    tests: list[Formula] = []
    for symbol, term in definitions:
        try:
            errors[symbol] = error_bound(term, ranges, errors)
        except _NoErrorBound:
            raise Unbounded(symbol) from None
        tests += _defined(term, ranges, errors)
        ranges[symbol] = evaluate(term, ranges)
        tests.append(_proved(bounds[symbol], ranges, errors))
        if (limited := contract(bounds[symbol], ranges)) is None:
            return Acceptance(FALSE, errors)
        ranges = limited
    return Acceptance(conjunction([*tests, _proved(formula, ranges, errors)]), errors)


def _proved(formula: Formula, box: Box, errors: Errors) -> Formula:
    """True in doubles only where the formula is true; what is true on the whole box is left out."""
    match formula:
        case Truth():
            return formula
        case Compare():
            verdict = truth(formula, box)
            return _proved_atom(formula, box, errors) if verdict == "unknown" else Truth(verdict == "true")
        case And(children):
            return conjunction(_proved(c, box, errors) for c in children)
        case Or(children):
            return disjunction(_proved(c, box, errors) for c in children)
        case _:
            assert_never(formula)


def _proved_atom(atom: Compare, box: Box, errors: Errors) -> Formula:
    atom = _descending(atom)
    conditions = [f for side in (atom.left, atom.right) for f in _defined(side, box, errors)]
    try:
        return conjunction([*conditions, _separated(atom, box, errors)])
    except _NoErrorBound:
        pass
    try:
        return conjunction([*conditions, *(_separated(a, box, errors) for a in _without_division(atom))])
    except _NoErrorBound:
        raise Unbounded(atom) from None


def _descending(atom: Compare) -> Compare:
    """`>` for `<` and `>=` for `<=`."""
    match atom.op:
        case "<" | "<=":
            return Compare(">" if atom.op == "<" else ">=", atom.right, atom.left, span=atom.span)
        case _:
            return atom


def _separated(atom: Compare, box: Box, errors: Errors) -> Compare:
    """The sides differ by more than their errors. Rounding the difference itself is monotone."""
    slack = add_up(error_bound(atom.left, box, errors), error_bound(atom.right, box, errors))
    if slack == 0:
        return atom
    difference = atom.left if atom.right == ZERO else Sub(atom.left, atom.right)
    distance = Call("abs", (difference,)) if atom.op == "!=" else difference
    assert atom.op != "=", "equalities are solved before"
    return Compare(">", distance, Number(Fraction(slack)), span=atom.span)


def _defined(term: Term, box: Box, errors: Errors) -> Iterator[Formula]:
    """Tests that every square root in the term is taken of a nonnegative number."""
    for operand in operands(term):
        yield from _defined(operand, box, errors)
    match term:
        case Call("sqrt", (arg,)):
            yield _proved(Compare(">=", arg, ZERO), box, errors)
        case _:
            pass


def _without_division(atom: Compare) -> tuple[Compare, ...]:
    """The atom multiplied by the square of its divisors, none of which may be zero."""
    quotient = _fraction(Sub(atom.left, atom.right))
    if quotient is None or quotient[1] == ONE:
        raise _NoErrorBound
    numerator, divisor = quotient
    apart = Compare("!=", divisor, ZERO, span=atom.span)
    scaled = Compare(atom.op, Mul(numerator, divisor), ZERO, span=atom.span)
    return (apart, scaled) if atom.op == ">=" else (scaled,)


def _fraction(term: Term) -> tuple[Term, Term] | None:
    """(n, d) without divisions outside of function calls: where d is not zero, and only there,
    the term is defined and is n / d. None where a function stands above a division."""
    match term:
        case Neg(child):
            parts = _fraction(child)
            return None if parts is None else (Neg(parts[0]), parts[1])
        case Pow(base, exponent):
            parts = _fraction(base)
            return None if parts is None else (Pow(parts[0], exponent), _power(parts[1], exponent))
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            a, b = _fraction(left), _fraction(right)
            if a is None or b is None:
                return None
            match term:
                case Mul():
                    return _times(a[0], b[0]), _times(a[1], b[1])
                case Div():
                    return _times(_times(a[0], b[1]), b[1]), _times(_times(a[1], b[0]), b[1])
                case Add() | Sub():
                    sides = _times(a[0], b[1]), _times(b[0], a[1])
                    return type(term)(*sides), _times(a[1], b[1])
        case Number() | Symbol():
            return term, ONE
        case Call(_, args):
            return (term, ONE) if not any(_divides(a) for a in args) else None
        case _:
            assert_never(term)


def _divides(term: Term) -> bool:
    return isinstance(term, Div) or any(_divides(t) for t in operands(term))


def _times(a: Term, b: Term) -> Term:
    return b if a == ONE else a if b == ONE else Mul(a, b)


def _power(base: Term, exponent: int) -> Term:
    return ONE if base == ONE else Pow(base, exponent)


# Rounding errors --------------------------------------------------------------


def error_bound(term: Term, box: Box, errors: Errors) -> float:
    """A bound of |computed - exact| for all values in the box whose names are off by `errors`.

    Where a square root is undefined the computed value is NaN, which no atom accepts.
    """
    match term:
        case Number(value):
            return _representation_error(value)
        case Symbol():
            return errors[term]
        case Neg(child) | Call("abs", (child,)) | Pow(child, 1):
            return error_bound(child, box, errors)
        case Call("min" | "max", (left, right)):
            return max(error_bound(left, box, errors), error_bound(right, box, errors))
        case Add(left, right) | Sub(left, right):
            inherited = add_up(error_bound(left, box, errors), error_bound(right, box, errors))
            return _rounded(term, inherited, box)
        case Mul(left, right):
            return _product_error(term, left, right, box, errors)
        case Pow(base, exponent) if exponent % 2:
            return _product_error(term, base, Pow(base, exponent - 1), box, errors)
        case Pow(base, exponent):
            half = Pow(base, exponent // 2)
            return _product_error(term, half, half, box, errors)
        case Div(left, right):
            a, b = error_bound(left, box, errors), error_bound(right, box, errors)
            nearest = add_down(_size(right, box).low, -b)
            if nearest <= 0:
                raise _NoErrorBound
            return _rounded(term, div_up(add_up(a, mul_up(_size(term, box).high, b)), nearest), box)
        case Call("sqrt", (arg,)):
            a, low = error_bound(arg, box, errors), sqrt_down(max(evaluate(arg, box).low, 0.0))
            inherited = sqrt_up(a) if low == 0 else min(sqrt_up(a), div_up(a, low))
            return _rounded(term, inherited, box)
        case Call():
            raise _NoErrorBound
        case _:
            assert_never(term)


def _product_error(term: Term, left: Term, right: Term, box: Box, errors: Errors) -> float:
    a, b = error_bound(left, box, errors), error_bound(right, box, errors)
    crossed = add_up(mul_up(_size(left, box).high, b), mul_up(_size(right, box).high, a))
    return _rounded(term, add_up(crossed, mul_up(a, b)), box)


def _rounded(term: Term, inherited: float, box: Box) -> float:
    """The error after rounding a result whose operands caused an `inherited` one."""
    size = add_up(_size(term, box).high, inherited)
    if size > LARGEST:
        raise _NoErrorBound
    return add_up(inherited, add_up(mul_up(size, UNIT_ROUNDOFF), SMALLEST))


def _size(term: Term, box: Box) -> Interval:
    around = evaluate(term, box)
    if around.empty:
        raise _NoErrorBound
    return magnitude(around)


def _representation_error(value: Fraction) -> float:
    try:
        return enclosure(abs(Fraction(float(value)) - value)).high
    except OverflowError:
        raise _NoErrorBound from None
