"""Terms as quotients of polynomials: what equations between them say about one name.

Terms of the IR come in; polynomials in normal form, their coefficients and derivatives, and terms
again go out. All arithmetic is exact, over the reals.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import reduce
from typing import assert_never

from dl2c.ir.logic import folded, minus, number, plus, raised, subterms, symbols, times
from dl2c.ir.model import ONE, ZERO, Add, Binary, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.ir.normal import Monomial, Normal, divided, normal_form, powers, symbol_of


def fraction(term: Term) -> tuple[Term, Term] | None:
    """(n, d) without divisions outside of function calls: where d is not zero, and only there,
    the term is defined and is n / d. None where a function stands above a division."""
    match term:
        case Neg(child):
            parts = fraction(child)
            return None if parts is None else (Neg(parts[0]), parts[1])
        case Pow(base, exponent):
            parts = fraction(base)
            return None if parts is None else (Pow(parts[0], exponent), _power(parts[1], exponent))
        case Binary():
            a, b = fraction(term.left), fraction(term.right)
            return None if a is None or b is None else _combined(term, a, b)
        case Number() | Symbol():
            return term, ONE
        case Call(_, args):
            return (term, ONE) if not any(isinstance(t, Div) for t in subterms(*args)) else None
        case _:
            assert_never(term)


def _combined(term: Add | Sub | Mul | Div, a: tuple[Term, Term], b: tuple[Term, Term]) -> tuple[Term, Term]:
    """The sum, difference, product or quotient of two fractions."""
    match term:
        case Mul():
            return _times(a[0], b[0]), _times(a[1], b[1])
        case Div():
            return _times(_times(a[0], b[1]), b[1]), _times(_times(a[1], b[0]), b[1])
        case Add() | Sub():
            return type(term)(_times(a[0], b[1]), _times(b[0], a[1])), _times(a[1], b[1])


def _times(a: Term, b: Term) -> Term:
    return b if a == ONE else a if b == ONE else Mul(a, b)


def _power(base: Term, exponent: int) -> Term:
    return ONE if base == ONE else Pow(base, exponent)


def remainder(form: Normal, divisor: Normal, symbol: Symbol) -> Normal | None:
    """A multiple of the polynomial less a multiple of the divisor, of lower degree in the name than that
    (pseudo-division); None where it has too many monomials."""
    by_power = powers(divisor, symbol)
    degree = max(by_power)
    leading, whole = term_of(by_power[degree]), term_of(divisor)
    rest: Normal | None = form
    while rest and (highest := max(powers(rest, symbol))) >= degree:
        top = term_of(powers(rest, symbol)[highest])
        shift = times(top, raised(symbol, highest - degree))
        rest = normal_form(Sub(Mul(leading, term_of(rest)), Mul(shift, whole)))
    return rest


def content(form: Normal) -> set[tuple[str, str]]:
    """The names that every monomial contains, by kind and name."""
    names = [{(k, n) for k, n, _ in monomial} for monomial in form]
    return set[tuple[str, str]].intersection(*names) if names else set()


def without_content(form: Normal, nonzero: set[tuple[str, str]]) -> Normal:
    """The polynomial divided by such powers of these names as divide it; none of them is zero."""
    for name in sorted(content(form) & nonzero):
        least = min(e for m in form for k, n, e in m if (k, n) == name)
        form = divided(form, name, least)
    return form


def is_affine(term: Term) -> bool:
    """Whether the term is a polynomial of degree at most one."""
    form = normal_form(term)
    return form is not None and all(sum(e for _, _, e in m) <= 1 for m in form)


def has_dyadic_numbers(term: Term) -> bool:
    """Whether all coefficients of a polynomial have powers of two below."""
    form = normal_form(term)
    return form is not None and all(c.denominator & (c.denominator - 1) == 0 for c in form.values())


def term_of(form: Normal) -> Term:
    """The polynomial as a term."""
    parts = [_monomial(m, c) for m, c in sorted(form.items(), key=lambda i: (-len(i[0]), i[0]))]
    return _balanced(parts) if parts else ZERO


def _balanced(parts: Sequence[Term]) -> Term:
    """The sum as a shallow tree, of which intervals are propagated faster."""
    if len(parts) <= 3:
        return reduce(_joined, parts)
    middle = len(parts) // 2
    return Add(_balanced(parts[:middle]), _balanced(parts[middle:]))


def _monomial(monomial: Monomial, value: Fraction) -> Term:
    powers = [raised(symbol_of(k, n), e) for k, n, e in monomial]
    factors: list[Term] = [Number(value)] if value != 1 or not powers else []
    return reduce(Mul, [*factors, *powers])


def _joined(a: Term, b: Term) -> Term:
    match b:
        case Number(value) if value < 0:
            return Sub(a, Number(-value))
        case Mul(Number(value), rest) if value == -1:
            return Sub(a, rest)
        case _:
            return Add(a, b)


def derivative(term: Term, symbol: Symbol) -> Term:
    """By one name, where the term is differentiable; functions in it are square roots."""
    if symbol not in symbols(term):
        return ZERO
    match term:
        case Symbol():
            return ONE
        case Neg(child):
            return folded(Neg(derivative(child, symbol)))
        case Add(left, right) | Sub(left, right):
            return (minus if isinstance(term, Sub) else plus)(
                derivative(left, symbol), derivative(right, symbol)
            )
        case Mul(left, right):
            return plus(times(derivative(left, symbol), right), times(left, derivative(right, symbol)))
        case Div(left, right):
            above = minus(derivative(left, symbol), times(term, derivative(right, symbol)))
            return ZERO if above == ZERO else Div(above, right)
        case Pow(base, exponent):
            outer = times(number(exponent), raised(base, exponent - 1))
            return times(outer, derivative(base, symbol))
        case Call("sqrt", (arg,)):
            return Div(derivative(arg, symbol), Mul(number(2), term))
        case Call() | Number():
            raise AssertionError(f"no derivative of {term}")
        case _:
            assert_never(term)
