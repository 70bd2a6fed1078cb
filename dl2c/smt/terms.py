"""IR terms and formulas as Z3 expressions over exact reals.

Division and square roots are total functions in Z3. Each atom therefore becomes a
conjunction of the comparison and the conditions under which its subterms are defined;
formulas are in negation normal form, so an undefined atom is false. Transcendental
functions have no translation: `Untranslatable` names the subterm.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import comb
from typing import Any, TypeAlias, assert_never

import z3 as untyped_z3

from dl2c.ir.logic import ARITHMETIC, COMPARISONS, fold
from dl2c.ir.model import Add, Binary, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term

z3: Any = untyped_z3
"""Z3 publishes no types; what it returns is an `Expression`."""

Expression: TypeAlias = Any


MAX_MONOMIALS = 5000
MAX_DEGREE = 100
"""Of a term multiplied out, as Z3 does without looking at the time."""


class TooLarge(Exception):
    """A term that Z3 would take too long to read."""


class Untranslatable(Exception):
    """A function that is not definable in real arithmetic."""

    def __init__(self, call: Call) -> None:
        super().__init__(call.function)
        self.call = call


def solver_of(context: Expression, assertions: Sequence[Expression], seconds: float) -> Expression:
    """A solver for these assertions, with a limit of time."""
    solver = z3.Solver(ctx=context)
    solver.set("timeout", max(1, int(seconds * 1000)))
    solver.set("random_seed", 0)
    solver.add(*assertions)
    return solver


def answer_of(solver: Expression) -> Expression:
    """What a solver or optimizer finds: sat, unsat or unknown. Raises `KeyboardInterrupt`: while Z3 works, it
    takes Ctrl-C itself, as a reason to give up.
    """
    answer = solver.check()
    if answer == z3.unknown and solver.reason_unknown() == "interrupted from keyboard":
        raise KeyboardInterrupt
    return answer


def solution_of(solver: Expression, names: Iterable[str], context: Expression) -> dict[str, Fraction | str]:
    """The values of names in the solution that was found: exact, or decimal text of irrational ones."""
    values = solver.model()
    return {name: _value_of(values.eval(z3.Real(name, context), True)) for name in names}


def _value_of(value: Expression) -> Fraction | str:
    if z3.is_rational_value(value):
        return Fraction(value.numerator_as_long(), value.denominator_as_long())
    return str(value.as_decimal(20)).rstrip("?")


def condition(formula: Formula, context: Expression) -> Expression:
    """The formula as a Z3 Boolean. Raises `Untranslatable`, `TooLarge`."""

    def compared(atom: Compare) -> Expression:
        for side in (atom.left, atom.right):
            _check_size(side)
        defined: list[Expression] = []
        verdict = COMPARISONS[atom.op](*(real(t, context, defined) for t in (atom.left, atom.right)))
        return z3.And(*defined, verdict) if defined else verdict

    def truth(value: bool) -> Expression:
        return z3.BoolVal(value, context)

    return fold(formula, truth, compared, lambda parts: z3.And(*parts), lambda parts: z3.Or(*parts))


def real(term: Term, context: Expression, defined: list[Expression]) -> Expression:
    """The term as a Z3 real; what makes it defined is appended to `defined`."""
    match term:
        case Number(value):
            return z3.RealVal(f"{value.numerator}/{value.denominator}", context)
        case Symbol(name):
            return z3.Real(name, context)
        case Neg(child):
            return -real(child, context, defined)
        case Div(left, right):
            divisor = real(right, context, defined)
            if not isinstance(right, Number) or right.value == 0:
                defined.append(divisor != 0)
            return real(left, context, defined) / divisor
        case Binary():
            operation = ARITHMETIC[type(term)]
            return operation(real(term.left, context, defined), real(term.right, context, defined))
        case Pow(base, exponent):
            factor = real(base, context, defined)
            product = factor
            for _ in range(exponent - 1):
                product = product * factor
            return product
        case Call("abs", (arg,)):
            value = real(arg, context, defined)
            return z3.If(value >= 0, value, -value)
        case Call("min", (left, right)):
            a, b = real(left, context, defined), real(right, context, defined)
            return z3.If(a < b, a, b)
        case Call("max", (left, right)):
            a, b = real(left, context, defined), real(right, context, defined)
            return z3.If(a > b, a, b)
        case Call("sqrt", (arg,)):
            root = z3.FreshConst(z3.RealSort(context), "sqrt")
            defined += (root >= 0, root * root == real(arg, context, defined))
            return root
        case Call():
            raise Untranslatable(term)
        case _:
            assert_never(term)


def _check_size(term: Term) -> None:
    monomials, degree = _size(term)
    if monomials > MAX_MONOMIALS or degree > MAX_DEGREE:
        raise TooLarge


def _size(term: Term) -> tuple[int, int]:
    """Upper limits of how many monomials a term multiplied out has, and of their degree."""
    match term:
        case Number():
            return 1, 0
        case Symbol():
            return 1, 1
        case Neg(child):
            return _size(child)
        case Add(left, right) | Sub(left, right):
            (m, d), (n, e) = _size(left), _size(right)
            return m + n, max(d, e)
        case Mul(left, right) | Div(left, right):
            (m, d), (n, e) = _size(left), _size(right)
            return min(m * n, MAX_MONOMIALS + 1), d + e
        case Pow(base, exponent):
            m, d = _size(base)
            return min(comb(m + exponent - 1, exponent), MAX_MONOMIALS + 1), d * exponent
        case Call(_, args):
            for arg in args:
                _check_size(arg)
            return 1, 1
        case _:
            assert_never(term)
