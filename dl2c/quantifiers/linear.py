"""Fourier-Motzkin elimination: that there is a number between bounds, as one conjunction.

Comes in: a formula, and a symbol for which some value is asked. Goes out: an equivalent formula without it,
if all conditions on it are linear with numbers as coefficients. Virtual substitution finds one too, but of
alternatives that meet where two bounds are equal: no enclosure shows around there that one of them holds.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import product
from math import prod

from dl2c.ir.logic import ascending, conjunction, conjuncts, difference, disjunction, symbols
from dl2c.ir.model import Compare, Formula, Or, Symbol
from dl2c.ir.normal import Normal, added, normal_form, powers, scaled
from dl2c.quantifiers.signs import SIGNS, sign_in

MOST_CLAUSES = 16


def some_between(x: Symbol, formula: Formula) -> Formula | None:
    """That some value of a symbol makes a formula true; None where that is no question of linear bounds."""
    found: list[Formula] = []
    for clause in _clauses(formula, x):
        between = _between(x, clause)
        if between is None:
            return None
        found.append(between)
    return disjunction(found)


def _clauses(formula: Formula, x: Symbol) -> list[list[Formula]]:
    """Conjunctions of which one has to hold: alternatives without the symbol stay together."""
    parts: list[list[list[Formula]]] = []
    for c in conjuncts(formula):
        match c:
            case Or(children) if x in symbols(c):
                parts.append([clause for child in children for clause in _clauses(child, x)])
            case _:
                parts.append([[c]])
    if prod(map(len, parts)) > MOST_CLAUSES:
        return [[formula]]
    return [[c for clause in chosen for c in clause] for chosen in product(*parts)]


def _between(x: Symbol, clause: Sequence[Formula]) -> Formula | None:
    lower: list[tuple[Normal, Compare]] = []
    upper: list[tuple[Normal, Compare]] = []
    found = [c for c in clause if x not in symbols(c)]
    for c in clause:
        if x not in symbols(c):
            continue
        if not isinstance(c, Compare) or c.op == "!=" or (bound := _bound(x, atom := ascending(c))) is None:
            return None
        rises, form = bound
        if rises or c.op == "=":
            upper.append((form, atom))
        if not rises or c.op == "=":
            lower.append((form, atom))
    for (low, one), (high, other) in product(lower, upper):
        apart = added(low, scaled(high, Fraction(-1)))
        if apart is None:
            return None
        if one is other:
            continue
        signs = SIGNS["<"] if "<" in (one.op, other.op) else SIGNS["<="]
        found.append(sign_in(apart, signs, one.span))
    return conjunction(found)


def _bound(x: Symbol, atom: Compare) -> tuple[bool, Normal] | None:
    """What an atom compares a symbol with, and whether that is an upper bound."""
    form = normal_form(difference(atom))
    by_power = {} if form is None else powers(form, x)
    slope = by_power.get(1, {})
    if by_power.keys() - {0, 1} or slope.keys() != {()}:
        return None
    factor = slope[()]
    bound = scaled(by_power.get(0, {}), -1 / factor)
    return None if bound is None else (factor > 0, bound)
