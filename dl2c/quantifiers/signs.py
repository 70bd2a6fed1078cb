"""Conditions on the signs of polynomials, written in one way each, and formulas of them kept small.

A polynomial is its normal form; a set of signs is a subset of {-1, 0, 1}. Over the reals, and
for symbols that all have values: nothing here asks whether a term is defined.
"""

import sys
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import reduce
from math import gcd, lcm
from typing import TypeAlias, assert_never

from dl2c.ir.logic import conjunction, conjuncts, folded, leaves, negation, raised
from dl2c.ir.model import (
    FALSE,
    TRUE,
    ZERO,
    Add,
    And,
    Compare,
    Comparison,
    Formula,
    Mul,
    Number,
    Or,
    Term,
    Truth,
)
from dl2c.ir.normal import Monomial, Normal, symbol_of
from dl2c.source import Span

Signs: TypeAlias = frozenset[int]

ANY: Signs = frozenset({-1, 0, 1})
SIGNS: dict[Comparison, Signs] = {
    "<": frozenset({-1}),
    "<=": frozenset({-1, 0}),
    "=": frozenset({0}),
    "!=": frozenset({-1, 1}),
    ">=": frozenset({0, 1}),
    ">": frozenset({1}),
}
COMPARISONS: dict[Signs, Comparison] = {signs: op for op, signs in SIGNS.items()}

MAX_EXACT = 2**53
MAX_ABSORBED = 60
"""Of more alternatives none is compared with the others, which takes time quadratic in their number."""


class TooLarge(Exception):
    """A condition that is too large to be of use; the message is what it would have too many of."""


# Conditions -------------------------------------------------------------------


def sign_in(form: Normal, signs: Signs, span: Span) -> Formula:
    """That the sign of a polynomial is one of `signs`: at most one atom. Raises `TooLarge`."""
    possible = possible_signs(form)
    wanted = signs & possible
    if wanted == possible:
        return TRUE
    if not wanted:
        return FALSE
    if len(form) == 1:
        return _monomial_sign(*next(iter(form.items())), wanted, span)
    return _atom(form, wanted, span)


def possible_signs(form: Normal) -> Signs:
    """Signs that the polynomial may have, as far as its coefficients tell."""
    if not form:
        return frozenset({0})
    signs = {1 if c > 0 else -1 for c in form.values()}
    if len(signs) > 1 or any(e % 2 for monomial in form for _, _, e in monomial):
        return ANY
    return frozenset(signs) if () in form else frozenset({0, *signs})


def opposite(signs: Signs) -> Signs:
    """The signs of -p where these are those of p."""
    return frozenset(-s for s in signs)


def _monomial_sign(monomial: Monomial, factor: Fraction, signs: Signs, span: Span) -> Formula:
    """Odd exponents count as 1, even ones as 2; whether a square is 0 is whether its root is."""
    if factor < 0:
        signs = opposite(signs)
    if all(e % 2 == 0 for _, _, e in monomial):
        root = {tuple((k, n, 1) for k, n, _ in monomial): Fraction(1)}
        return _atom(root, SIGNS["="] if 0 in signs else SIGNS["!="], span)
    exponent = 1 if signs in (SIGNS["="], SIGNS["!="]) else 2
    lower = tuple((k, n, 1 if e % 2 else exponent) for k, n, e in monomial)
    return _atom({lower: Fraction(1)}, signs, span)


def _atom(form: Normal, signs: Signs, span: Span) -> Compare:
    """Whole coprime coefficients where doubles hold them; the first monomial and no other side negative."""
    order = sorted(form, key=lambda m: (-sum(e for _, _, e in m), m))
    if form[order[0]] < 0:
        form, signs = {m: -c for m, c in form.items()}, opposite(signs)
    scale = Fraction(lcm(*(c.denominator for c in form.values())))
    scale /= gcd(*(int(c * scale) for c in form.values()))
    if all(abs(c * scale) <= MAX_EXACT for c in form.values()):
        form = {m: c * scale for m, c in form.items()}
    if any(abs(c) > sys.float_info.max for c in form.values()):
        raise TooLarge("coefficients beyond the largest double")
    left = _sum([(m, form[m]) for m in order if form[m] > 0])
    right = _sum([(m, -form[m]) for m in order if form[m] < 0])
    return Compare(COMPARISONS[signs], left, right, span=span)


def _sum(parts: list[tuple[Monomial, Fraction]]) -> Term:
    terms = [_product(monomial, factor) for monomial, factor in parts]
    return reduce(Add, terms) if terms else ZERO


def _product(monomial: Monomial, factor: Fraction) -> Term:
    powers = [raised(symbol_of(k, n), e) for k, n, e in monomial]
    if not powers:
        return Number(factor)
    product = reduce(Mul, powers)
    return product if factor == 1 else folded(Mul(Number(factor), product))


def size(formula: Formula) -> int:
    """How many numbers and symbols are written in it."""
    return sum(1 for _ in leaves(formula))


# Formulas of them ---------------------------------------------------------------

Known: TypeAlias = Mapping[tuple[Term, Term], Signs]
"""The signs that left minus right may have, by the sides of atoms."""


def simplified(formula: Formula, known: Known | None = None) -> Formula:
    """An equivalent formula, given what is `known`; never longer.

    Each part is read in the light of the conditions beside it.
    """
    known = known or {}
    match formula:
        case Truth():
            return formula
        case Compare(op, left, right):
            possible = known.get((left, right), ANY)
            return TRUE if possible <= SIGNS[op] else formula if possible & SIGNS[op] else FALSE
        case And():
            return _simplified_and(formula, known)
        case Or():
            return negation(simplified(negation(formula), known))
        case _:
            assert_never(formula)


def _simplified_and(formula: Formula, known: Known) -> Formula:
    """Until the parts have no more atoms to tell the others."""
    before = -1
    while isinstance(formula, And):
        count = sum(isinstance(c, Compare) for c in formula.children)
        if count == before:
            break
        before = count
        told = _merged([c for c in formula.children if isinstance(c, Compare)], known)
        if told is None:
            return FALSE
        inner = {**known}
        for atom in told:
            inner[atom.left, atom.right] = inner.get((atom.left, atom.right), ANY) & SIGNS[atom.op]
        others = [simplified(c, inner) for c in formula.children if not isinstance(c, Compare)]
        formula = conjunction([*told, *_absorbed(others)])
    return formula


def _merged(parts: Iterable[Compare], known: Known) -> list[Compare] | None:
    """One atom for each pair of sides, none for what is known; None where they contradict each other."""
    found: dict[tuple[Term, Term], tuple[Signs, Span]] = {}
    for atom in parts:
        key = atom.left, atom.right
        signs, span = found.get(key, (ANY, atom.span))
        found[key] = signs & SIGNS[atom.op], span
    if any(not known.get(key, ANY) & signs for key, (signs, _) in found.items()):
        return None
    return [
        Compare(COMPARISONS[signs], *key, span=span)
        for key, (signs, span) in found.items()
        if not known.get(key, ANY) <= signs
    ]


def _absorbed(parts: Iterable[Formula]) -> list[Formula]:
    """Without disjunctions that are implied because another one has some of their alternatives alone."""
    flat = list(dict.fromkeys(c for part in parts for c in (conjuncts(part) or (part,))))
    alternatives = [frozenset(p.children) if isinstance(p, Or) else frozenset({p}) for p in flat]
    if len(flat) > MAX_ABSORBED:
        return flat
    return [p for p, mine in zip(flat, alternatives, strict=True) if not any(a < mine for a in alternatives)]
