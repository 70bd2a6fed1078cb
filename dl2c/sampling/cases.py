"""A precondition as alternatives in which equalities are plain conjuncts.

A formula and a box around all initial states come in; lists of conjuncts go out, one list per
alternative. A disjunction is split only where an equality stands in it, and an equality only where
`abs`, `min`, `max`, a root or a product equal to zero make it several. Alternatives without a state
in the box are left out.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import TypeAlias

from dl2c.interval.arithmetic import Box
from dl2c.interval.contract import contract
from dl2c.ir.logic import (
    always_defined,
    ascending,
    atoms,
    conjunction,
    conjuncts,
    disjunction,
    negated,
    operands,
    plus,
    rewritten,
    sides,
    symbols,
    with_term,
)
from dl2c.ir.margins import margin_of
from dl2c.ir.model import (
    FALSE,
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
    Term,
    Truth,
)
from dl2c.ir.normal import Monomial, normal_form, powers
from dl2c.sampling.equalities.algebra import term_of

Conjuncts: TypeAlias = tuple[Formula, ...]
Key: TypeAlias = tuple[str, frozenset[tuple[Monomial, Fraction]]]

MOST = 64
"""Alternatives; of more, each would be too rare to be worth its code."""


class TooMany(Exception):
    """The equalities of a precondition stand in too many alternatives."""


def alternatives(formula: Formula, box: Box) -> tuple[Conjuncts, ...]:
    """The formula is equivalent to the disjunction of them inside the box. Raises `TooMany`."""
    return tuple(dict.fromkeys(_split(formula, box)))


def _split(formula: Formula, box: Box) -> list[Conjuncts]:
    match formula:
        case Compare("="):
            return _equality(formula, box)
        case And(children):
            combined: list[Conjuncts] = [()]
            for child in sorted(children, key=_has_equality):
                parts = _split(child, box)
                combined = [(*c, *p) for c in combined for p in parts]
                if len(parts) > 1:
                    combined = [c for c in combined if contract(conjunction(c), box) is not None]
                _limit(combined)
            return combined
        case Or(children) if _has_equality(formula):
            plain = disjunction(c for c in children if not _has_equality(c))
            found = [] if plain == Truth(False) else [(plain,)]
            for child in children:
                if _has_equality(child) and contract(child, box) is not None:
                    found += _split(child, box)
            _limit(found)
            return found
        case Truth(True):
            return [()]
        case _:
            return [(formula,)]


def resolved(formula: Formula) -> Formula:
    """The formula without alternatives that one of its other conjuncts denies."""
    parts = conjuncts(formula)
    denied = {k for p in parts if isinstance(p, Compare) and (k := _key(negated(p))) is not None}
    return conjunction(p if isinstance(p, Compare) else _without(p, denied) for p in parts)


def _without(formula: Formula, denied: set[Key]) -> Formula:
    return rewritten(formula, lambda atom: FALSE if _key(atom) in denied else atom)


def _key(atom: Compare) -> Key | None:
    """What the atom says, however it is written."""
    atom = ascending(atom)
    form = normal_form(margin_of(atom))
    return None if form is None else (atom.op, frozenset(form.items()))


def _limit(found: Sequence[Conjuncts]) -> None:
    if len(found) > MOST:
        raise TooMany


def _has_equality(formula: Formula) -> bool:
    return any(a.op == "=" for a in atoms(formula))


def _equality(atom: Compare, box: Box) -> list[Conjuncts]:
    """The cases of an equality."""
    difference = Sub(atom.left, atom.right)
    squares = _squares(difference, 1) or _squares(difference, -1) or _completed(difference)
    if squares:
        return _split(conjunction(Compare("=", s, ZERO, span=atom.span) for s in squares), box)
    for side, other in ((atom.left, atom.right), (atom.right, atom.left)):
        match side, other:
            case (Mul(a, b), _) if other == ZERO:
                factors = [Compare("=", t, ZERO, span=atom.span) for t in (a, b)]
                defined = [_defined(b, atom), _defined(a, atom)]
                return [(*e, *d) for f, d in zip(factors, defined, strict=True) for e in _split(f, box)]
            case (Pow(base, _), _) if other == ZERO:
                return _split(Compare("=", base, ZERO, span=atom.span), box)
            case Call("sqrt", (arg,)), _:
                squared = Compare("=", arg, Pow(other, 2), span=atom.span)
                sign = Compare(">=", other, ZERO, span=atom.span)
                return [(*c, sign) for c in _split(squared, box)]
            case _:
                pass
    kink = next((k for side in sides(atom) for k in _kinks(side)), None)
    return [(atom,)] if kink is None else _kink_cases(atom, kink, box)


def _squares(term: Term, sign: int) -> list[Term] | None:
    """What has to be zero where a sum of squares is; None for another term. Its squares have this sign."""
    match term:
        case Number(value) if value == 0:
            return []
        case Pow(base, exponent) if exponent % 2 == 0:
            return [base] if sign > 0 else None
        case Mul(left, right) if left == right:
            return [left] if sign > 0 else None
        case Mul(Number(value), child) | Mul(child, Number(value)) | Div(child, Number(value)) if value != 0:
            return _squares(child, sign if value > 0 else -sign)
        case Neg(child):
            return _squares(child, -sign)
        case Add(left, right) | Sub(left, right):
            first = _squares(left, sign)
            second = _squares(right, sign if isinstance(term, Add) else -sign)
            return None if first is None or second is None else [*first, *second]
        case _:
            return None


def _completed(difference: Term) -> list[Term] | None:
    """The same for a polynomial of degree 2, by completing the squares (Lagrange)."""
    rest = normal_form(difference)
    if rest is None or any(sum(e for _, _, e in m) > 2 for m in rest):
        return None
    found: list[Term] = []
    signs: set[bool] = set()
    for symbol in sorted(symbols(difference), key=lambda s: s.name):
        by_power = powers(rest, symbol)
        if 2 not in by_power:
            continue
        ((_, leading),) = by_power[2].items()
        half = {m: c / (2 * leading) for m, c in by_power.get(1, {}).items()}
        beside, below = term_of(half), term_of(by_power.get(0, {}))
        found.append(plus(symbol, beside))
        signs.add(leading > 0)
        rest = normal_form(Sub(below, Mul(Number(leading), Pow(beside, 2))))
        if rest is None:
            return None
    return found if not rest and len(signs) == 1 else None


def _defined(term: Term, atom: Compare) -> Conjuncts:
    """That the other factor of a product has a value."""
    return () if always_defined(term) else (Compare("<=", ZERO, Pow(term, 2), span=atom.span),)


def _kinks(term: Term) -> Iterator[Call]:
    """Calls of abs, min and max, the inner ones first."""
    for operand in operands(term):
        yield from _kinks(operand)
    if isinstance(term, Call) and term.function in ("abs", "min", "max"):
        yield term


def _kink_cases(atom: Compare, kink: Call, box: Box) -> list[Conjuncts]:
    if kink.function == "abs":
        (a,) = kink.args
        first, values = Compare(">=", a, ZERO, span=atom.span), (a, Neg(a))
    else:
        a, b = values = kink.args
        first = Compare("<" if kink.function == "min" else ">", a, b, span=atom.span)
    found: list[Conjuncts] = []
    for condition, value in zip((first, negated(first)), values, strict=True):
        case = with_term(atom.left, kink, value), with_term(atom.right, kink, value)
        found += [(condition, *c) for c in _split(Compare("=", *case, span=atom.span), box)]
    return found
