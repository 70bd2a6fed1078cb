"""Quantifier elimination by virtual substitution (Weispfenning 1997, Loos and Weispfenning 1993).

Comes in: a quantifier-free formula whose atoms are polynomials of degree at most 2 in one symbol.
Goes out: an equivalent of its existential closure, over the reals. A formula that holds somewhere
holds at minus infinity, or where one of its atoms begins to hold when x grows: at a root of the
atom's polynomial, or just above one. These test points are put for x by their defining equations;
no square root is left. By the mirror image, the ends of atoms serve as well as the beginnings.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, assert_never

from dl2c.ir.logic import atoms, conjunction, conjuncts, disjunction, rewritten, symbols
from dl2c.ir.model import FALSE, TRUE, And, Compare, Comparison, Formula, Or, Sub, Symbol, Truth
from dl2c.ir.normal import Normal, normal_form, powers
from dl2c.quantifiers.quadratic import Quadratic, minus, number, plus, present, root_of, times
from dl2c.quantifiers.signs import (
    ANY,
    SIGNS,
    Signs,
    TooLarge,
    opposite,
    possible_signs,
    sign_in,
    simplified,
    size,
)
from dl2c.source import Span

MAX_SIZE = 2000
"""Numbers and symbols in a result; twice as many may be built on the way."""

TOO_LONG = f"more than {MAX_SIZE} numbers and names"

ZERO_SIGN = SIGNS["="]
NONZERO = SIGNS["!="]


@dataclass(frozen=True, slots=True)
class Condition:
    """That the sign of a polynomial in x, which means something where it is `defined`, is one of `signs`."""

    of: Quadratic
    signs: Signs
    span: Span
    defined: Formula = TRUE


@dataclass(frozen=True, slots=True)
class Root:
    """A root of `of`, or what lies just above it.

    `branch` is 0 for the root of a linear polynomial, else the sign of the square root. Where `guard`
    holds, the root exists, c2 of a linear polynomial is 0, and the coefficient of the highest power has
    one of the signs `lead`.
    """

    of: Quadratic
    branch: int
    lead: Signs
    above: bool
    guard: Formula


@dataclass(frozen=True, slots=True)
class MinusInfinity:
    """Below everything."""

    guard: Formula = TRUE


Point: TypeAlias = Root | MinusInfinity


# Elimination --------------------------------------------------------------------


Defined: TypeAlias = Mapping[Symbol, Formula]
"""Of symbols that stand for terms, where these have values."""


def exists(x: Symbol, formula: Formula, defined: Defined) -> Formula:
    """A formula without x that holds where some real x makes `formula` hold.

    Where a symbol is not `defined`, `formula` must say so before it reads the symbol, as the result does:
    in `d & p` or `!d | p`. Raises `TooLarge`.
    """
    formula = simplified(formula)
    match formula:
        case Or(children):
            return simplified(disjunction(exists(x, c, defined) for c in children))
        case And(children):
            free = [c for c in children if x not in symbols(c)]
            bound = conjunction(c for c in children if x in symbols(c))
            if free:
                return simplified(conjunction([*free, exists(x, bound, defined)]))
        case Compare() | Truth():
            if x not in symbols(formula):
                return formula
        case _:
            assert_never(formula)
    return _limited(simplified(_eliminated(x, formula, defined)))


def _eliminated(x: Symbol, formula: Formula, defined: Defined) -> Formula:
    conditions = {a: _condition_of(a, x, defined) for a in atoms(formula) if x in symbols(a)}
    equations = [conditions[a] for a in conjuncts(formula) if isinstance(a, Compare) and a.op == "="]
    if equations:
        equation = min(equations, key=_directness)
        points: Sequence[Point] = tuple(_points(equation))
        vanishes = [sign_in(c, ZERO_SIGN, equation.span) for c in _coefficients(equation.of)]
        rest = conjunction(
            c for c in conjuncts(formula) if not isinstance(c, Compare) or conditions[c] != equation
        )
        everywhere = conjunction(vanishes)
        others = FALSE if everywhere == FALSE else conjunction([everywhere, exists(x, rest, defined)])
        return disjunction([others, _at_points(formula, conditions, points)])
    mirrored = {a: replace(c, of=c.of.mirrored) for a, c in conditions.items()}
    sides = [(c, _starting_points(c)) for c in (conditions, mirrored)]
    chosen, points = min(sides, key=lambda side: _cost(side[1]))
    return _at_points(formula, chosen, points)


def _limited(formula: Formula) -> Formula:
    if size(formula) > MAX_SIZE:
        raise TooLarge(TOO_LONG)
    return formula


def _condition_of(atom: Compare, x: Symbol, defined: Defined) -> Condition:
    """Raises `TooLarge`."""
    found = powers(present(normal_form(Sub(atom.left, atom.right))), x)
    assert max(found, default=0) <= 2
    of = Quadratic(found.get(0, {}), found.get(1, {}), found.get(2, {}))
    read = sorted(symbols(atom) & defined.keys(), key=lambda s: s.name)
    return Condition(of, SIGNS[atom.op], atom.span, conjunction(defined[s] for s in read))


def _coefficients(of: Quadratic) -> tuple[Normal, Normal, Normal]:
    return of.c0, of.c1, of.c2


def _directness(equation: Condition) -> tuple[bool, bool]:
    """Smaller where the equation says more simply what x is."""
    lead = equation.of.c2 or equation.of.c1
    return bool(equation.of.c2), 0 in possible_signs(lead)


def _starting_points(conditions: dict[Compare, Condition]) -> tuple[Point, ...]:
    """Where conditions may begin to hold, each point once."""
    found: list[Point] = [MinusInfinity()]
    for condition in conditions.values():
        found += [p for p in _points(condition) if p not in found]
    return tuple(found)


def _cost(points: Sequence[Point]) -> int:
    return sum(1 if isinstance(p, MinusInfinity) or p.branch == 0 else 3 for p in points)


def _at_points(formula: Formula, conditions: dict[Compare, Condition], points: Sequence[Point]) -> Formula:
    if len(points) * size(formula) > 2 * MAX_SIZE:
        raise TooLarge(TOO_LONG)
    found: list[Formula] = []
    built = 0
    for point in points:
        there = conjunction([point.guard, _substituted(formula, conditions, point)])
        built += size(there)
        if built > 2 * MAX_SIZE:
            raise TooLarge(TOO_LONG)
        found.append(simplified(there))
    return disjunction(found)


def _substituted(formula: Formula, conditions: dict[Compare, Condition], point: Point) -> Formula:
    return rewritten(formula, lambda atom: _at(conditions[atom], point) if atom in conditions else atom)


# Test points --------------------------------------------------------------------


def _points(condition: Condition) -> Iterator[Root]:
    """Where a condition may begin to hold; both roots of an equation."""
    of, signs, span = condition.of, condition.signs, condition.span
    falls = -1 if signs in (SIGNS["<"], SIGNS["<="]) else 1
    both = signs in (ZERO_SIGN, NONZERO)
    leads = NONZERO if both else frozenset({falls})
    above = 0 not in signs
    line = [sign_in(of.c2, ZERO_SIGN, span), sign_in(of.c1, leads, span)]
    linear = conjunction([condition.defined, *line])
    if linear != FALSE:
        yield Root(of, 0, _lead(of.c1, leads), above, linear)
    square = conjunction([condition.defined, sign_in(of.c2, NONZERO, span)])
    if square == FALSE:
        return
    root = root_of(of.discriminant) if of.c0 else of.c1
    if root is not None:
        for side in (root, minus({}, root)) if root else (root,):
            factor = Quadratic(minus(of.c1, side), times(number(2), of.c2), {})
            yield Root(factor, 0, _lead(of.c2, NONZERO), above, square)
        return
    real = conjunction([square, sign_in(of.discriminant, SIGNS[">="], span)])
    for branch in (-1, 1) if both else (falls,):
        if real != FALSE:
            yield Root(of, branch, _lead(of.c2, NONZERO), above, real)


def _lead(coefficient: Normal, signs: Signs) -> Signs:
    return possible_signs(coefficient) & signs


def _at(condition: Condition, point: Point) -> Formula:
    if condition.of.is_constant:
        return sign_in(condition.of.c0, condition.signs, condition.span)
    match point:
        case MinusInfinity():
            return _far_below(condition, 2)
        case Root(above=False):
            return _at_root(condition, point)
        case Root():
            return _above_root(condition, point)
        case _:
            assert_never(point)


def _far_below(condition: Condition, power: int) -> Formula:
    """The sign of the first coefficient that is not 0 decides."""
    of, signs, span = condition.of, condition.signs, condition.span
    coefficient = _coefficients(of)[power]
    wanted = opposite(signs) if power == 1 else signs
    if power == 0:
        return sign_in(coefficient, wanted, span)
    vanishes = sign_in(coefficient, ZERO_SIGN, span)
    rest = FALSE if vanishes == FALSE else _far_below(condition, power - 1)
    decides = sign_in(coefficient, wanted & NONZERO, span) if wanted & NONZERO else FALSE
    return disjunction([decides, conjunction([vanishes, rest])])


def _above_root(condition: Condition, point: Root) -> Formula:
    """The sign there, and where the polynomial vanishes that of its derivative just above."""
    if condition.of.is_constant:
        return sign_in(condition.of.c0, condition.signs, condition.span)
    signs = condition.signs
    there = _at_root(replace(condition, signs=signs & NONZERO), point)
    vanishes = _at_root(replace(condition, signs=ZERO_SIGN), point)
    if vanishes == FALSE:
        return there
    after = _above_root(replace(condition, of=condition.of.derivative), point)
    return disjunction([there, conjunction([vanishes, after])])


def _at_root(condition: Condition, point: Root) -> Formula:
    """The sign of a polynomial that is not constant, at a root of another one."""
    if not condition.signs:
        return FALSE
    if point.branch == 0 and condition.of.c2 and condition.of.c2 == point.of.c2:
        return _at(replace(condition, of=replace(condition.of, c2={})), replace(point, above=False))
    return _at_line(condition, point) if point.branch == 0 else _at_surd(condition, point)


def _at_line(condition: Condition, point: Root) -> Formula:
    """The point is -k0/k1: a linear value has the sign of its numerator times k1."""
    p, k0, k1 = condition.of, point.of.c0, point.of.c1
    if not p.c2:
        value = minus(times(p.c0, k1), times(p.c1, k0))
        return _over(value, k1, point.lead, condition)
    value = minus(times(p.c2, k0, k0), times(p.c1, k0, k1))
    return sign_in(plus(value, times(p.c0, k1, k1)), condition.signs, condition.span)


def _over(value: Normal, divisor: Normal, lead: Signs, condition: Condition) -> Formula:
    """The sign of value/divisor, where the divisor has one of the signs `lead`."""
    signs = condition.signs
    if lead == SIGNS[">"] or signs == opposite(signs):
        return sign_in(value, signs, condition.span)
    if lead == SIGNS["<"]:
        return sign_in(value, opposite(signs), condition.span)
    return sign_in(times(value, divisor), signs, condition.span)


def _at_surd(condition: Condition, point: Root) -> Formula:
    """At t = (-k1 + branch*sqrt(d)) / (2*k2) a polynomial of degree 2 is (r1*t + r0)/k2 by division, and
    r1*t + r0 = (a + b*sqrt(d)) / (2*k2), where a^2 - b^2*d = 4*k2*e."""
    p, k = condition.of, point.of
    if p.c2:
        r0 = minus(times(p.c0, k.c2), times(p.c2, k.c0))
        r1 = minus(times(p.c1, k.c2), times(p.c2, k.c1))
    else:
        r0, r1 = p.c0, p.c1
    a = minus(times(number(2), k.c2, r0), times(k.c1, r1))
    b = times(number(point.branch), r1)
    e = plus(minus(times(k.c2, r0, r0), times(k.c1, r0, r1)), times(k.c0, r1, r1))
    signs = condition.signs
    if not p.c2 and signs != opposite(signs):
        if point.lead == SIGNS["<"]:
            signs = opposite(signs)
        elif point.lead != SIGNS[">"]:
            a, b = times(a, k.c2), times(b, k.c2)
    if point.lead == SIGNS["<"]:
        e = minus({}, e)
    elif point.lead != SIGNS[">"]:
        e = times(e, k.c2)
    return _surd(a, b, e, replace(condition, signs=signs))


def _surd(a: Normal, b: Normal, e: Normal, condition: Condition) -> Formula:
    """The sign of a + b*sqrt(d), where e has that of a^2 - b^2*d."""
    signs, span = condition.signs, condition.span
    if signs == ANY or not signs:
        return TRUE if signs else FALSE
    if not b:
        return sign_in(a, signs, span)
    if signs in (SIGNS[">"], SIGNS[">="]):
        flipped = replace(condition, signs=opposite(signs))
        return _surd(minus({}, a), minus({}, b), e, flipped)

    def sign(form: Normal, op: Comparison) -> Formula:
        return sign_in(form, SIGNS[op], span)

    if signs == SIGNS["<"]:
        below = disjunction([sign(a, "<"), sign(e, "<")])
        return disjunction([_both(sign(a, "<"), sign(e, ">")), _both(sign(b, "<="), below)])
    if signs == SIGNS["<="]:
        return disjunction([_both(sign(a, "<="), sign(e, ">=")), _both(sign(b, "<="), sign(e, "<="))])
    if signs == ZERO_SIGN:
        against = [_both(sign(a, "<="), sign(b, ">=")), _both(sign(a, ">="), sign(b, "<="))]
        return _both(sign(e, "="), disjunction(against))
    along = [_both(sign(a, "<"), sign(b, "<")), _both(sign(a, ">"), sign(b, ">"))]
    return disjunction([sign(e, "!="), *along])


def _both(left: Formula, right: Formula) -> Formula:
    return conjunction((left, right))
