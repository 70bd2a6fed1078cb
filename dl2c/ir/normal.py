"""Polynomials in normal form: whether a term is zero whatever the state.

Comes in: a term of + - * / by numbers and powers. Goes out: its coefficients by monomial,
exact; None for other terms and for polynomials of more than `MAX_TERMS` monomials.
"""

from fractions import Fraction
from typing import TypeAlias, cast

from dl2c.ir.model import Add, Div, Kind, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.work import spend

Monomial: TypeAlias = tuple[tuple[str, str, int], ...]
"""Symbols by kind and name, each with its exponent, in order."""

Normal: TypeAlias = dict[Monomial, Fraction]
"""No coefficient is zero."""

MAX_TERMS = 2000


def normal_form(term: Term) -> Normal | None:
    """The coefficients of a term."""
    match term:
        case Number(value):
            return {(): value} if value else {}
        case Symbol(name, kind):
            return {((kind, name, 1),): Fraction(1)}
        case Neg(child):
            return scaled(normal_form(child), Fraction(-1))
        case Add(left, right):
            return added(normal_form(left), normal_form(right))
        case Sub(left, right):
            return added(normal_form(left), scaled(normal_form(right), Fraction(-1)))
        case Mul(left, right):
            return multiplied(normal_form(left), normal_form(right))
        case Div(left, Number(value)) if value:
            return scaled(normal_form(left), 1 / value)
        case Pow(base, exponent):
            factor = normal_form(base)
            result: Normal | None = {(): Fraction(1)}
            for _ in range(exponent):
                result = None if factor is None else multiplied(result, factor)
                if not result:
                    break
            return result
        case _:
            return None


def symbol_of(kind: str, name: str) -> Symbol:
    """The symbol of a factor of a monomial."""
    return Symbol(name, cast("Kind", kind))


def powers(form: Normal, x: Symbol) -> dict[int, Normal]:
    """The polynomial by exponents of one symbol: coefficients that do not contain it."""
    found: dict[int, Normal] = {}
    for monomial, factor in form.items():
        exponent = next((e for k, n, e in monomial if (k, n) == (x.kind, x.name)), 0)
        rest = tuple(m for m in monomial if m[:2] != (x.kind, x.name))
        found.setdefault(exponent, {})[rest] = factor
    return found


def derivative(form: Normal, x: Symbol) -> Normal:
    """By one symbol."""
    found: Normal = {}
    for exponent, coefficient in powers(form, x).items():
        for rest, factor in coefficient.items():
            if exponent:
                lowered = ((x.kind, x.name, exponent - 1),) if exponent > 1 else ()
                found[tuple(sorted((*rest, *lowered)))] = factor * exponent
    return found


def divided(form: Normal, name: tuple[str, str], by: int) -> Normal:
    """By a power of a symbol, given by kind and name, that divides every monomial."""
    return {_lowered(m, name, by): c for m, c in form.items()}


def _lowered(monomial: Monomial, name: tuple[str, str], by: int) -> Monomial:
    lowered = ((k, n, e - by if (k, n) == name else e) for k, n, e in monomial)
    return tuple(factor for factor in lowered if factor[2])


def scaled(form: Normal | None, factor: Fraction) -> Normal | None:
    """Its product with a number other than 0."""
    return None if form is None else {m: c * factor for m, c in form.items()}


def added(a: Normal | None, b: Normal | None) -> Normal | None:
    """Their sum."""
    if a is None or b is None:
        return None
    out = dict(a)
    for monomial, coefficient in b.items():
        out[monomial] = out.get(monomial, Fraction(0)) + coefficient
    return {m: c for m, c in out.items() if c}


def multiplied(a: Normal | None, b: Normal | None) -> Normal | None:
    """Their product; None where it may have too many monomials."""
    spend()
    if a is None or b is None or len(a) * len(b) > MAX_TERMS:
        return None
    out: Normal = {}
    for left, x in a.items():
        for right, y in b.items():
            exponents: dict[tuple[str, str], int] = {}
            for kind, name, exponent in (*left, *right):
                exponents[kind, name] = exponents.get((kind, name), 0) + exponent
            monomial = tuple(sorted((k, n, e) for (k, n), e in exponents.items()))
            out[monomial] = out.get(monomial, Fraction(0)) + x * y
    return {m: c for m, c in out.items() if c}


def quotient(monomial: Monomial, value: Fraction, divisor: Normal) -> Normal | None:
    """The quotient of two monomials, where it is one."""
    ((below, factor),) = divisor.items()
    exponents = {(k, n): e for k, n, e in monomial}
    for kind, name, exponent in below:
        exponents[kind, name] = exponents.get((kind, name), 0) - exponent
    if any(e < 0 for e in exponents.values()):
        return None
    return {tuple(sorted((k, n, e) for (k, n), e in exponents.items() if e)): value / factor}
