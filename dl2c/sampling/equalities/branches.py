"""Equalities between polynomials, solved for each of their names in turn.

An equality comes in; charts go out: in each one name is a term of the others, and it is the name to
whose changes the equality is most sensitive. So its changes are at most as large as those of the
other names that could have been solved for. The charts cover all solutions but singular points, and
meet only in their boundaries. Names of degree 1 and 2 have terms; those of higher degrees are looked for
where a draw leaves no other way, since that takes longer.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import isqrt

from dl2c.interval.arithmetic import Box, evaluate
from dl2c.ir.logic import folded, plus, size
from dl2c.ir.model import (
    ONE,
    ZERO,
    Add,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
)
from dl2c.ir.normal import Normal, derivative, divided, normal_form, powers, quotient, symbol_of
from dl2c.sampling.equalities.algebra import content, fraction, remainder, term_of, without_content
from dl2c.sampling.equalities.root_of import Definition, has_roots, roots_of

TWO, FOUR = Number(Fraction(2)), Number(Fraction(4))


@dataclass(frozen=True, slots=True)
class Row:
    """How a name that is not an affine function follows the others: `symbol` changes by minus the sum
    of `slopes` times the changes of their names; `gentle` slopes are at most 1 in size, others at most
    their term of `limits`, where they have one."""

    symbol: Symbol
    slopes: Mapping[Symbol, Term]
    gentle: frozenset[Symbol] = frozenset()
    limits: Mapping[Symbol, Term] = field(default_factory=dict[Symbol, Term])


@dataclass(frozen=True, slots=True)
class Branch:
    """The equality, `form` = 0, is solved by `symbol = value` where the `conditions` hold."""

    symbol: Symbol
    value: Definition
    conditions: tuple[Formula, ...]
    row: Row
    form: Normal


def branches_of(
    equality: Compare, names: Sequence[Symbol], box: Box, is_nonzero: Callable[[Symbol], bool]
) -> tuple[Branch, ...]:
    """Charts of the solutions over `names`; none where no name is solved for or terms are too long."""
    parts = fraction(Sub(equality.left, equality.right))
    form = None if parts is None else normal_form(parts[0])
    if parts is None or form is None:
        return ()
    below = normal_form(parts[1])
    form = without_content(form, set() if below is None else content(below))
    divisor = () if parts[1] == ONE else (Compare("!=", parts[1], ZERO, span=equality.span),)
    try:
        return tuple(
            replace(b, conditions=(*divisor, *_placed(b.conditions, equality)))
            for b in _solved(form, names, box, is_nonzero)
        )
    except _TooLong:
        return ()


def _solved(
    form: Normal, names: Sequence[Symbol], box: Box, is_nonzero: Callable[[Symbol], bool]
) -> list[Branch]:
    """By names of degree 1 and 2, unless slopes along others have no bound then. Raises `_TooLong`."""
    short = [s for s in names if _degree(form, s) in (1, 2)]
    every = [s for s in names if s in short or has_roots(_degree(form, s), s, box)]
    found = [b for s in short for b in _charts(form, s, short, box, is_nonzero)]
    if every == short or (short and all(_is_gentle(b, form, every, box) for b in found)):
        return found
    return [b for s in every for b in _charts(form, s, every, box, is_nonzero)]


def _is_gentle(branch: Branch, form: Normal, names: Sequence[Symbol], box: Box) -> bool:
    """Whether the changes with each of these names have a bound."""
    slope = evaluate(term_of(derivative(form, branch.symbol)), box)
    bounded = {branch.symbol, *branch.row.gentle, *branch.row.limits}
    return not slope.contains(0.0) or all(s in bounded for s in names)


class _TooLong(Exception):
    """A polynomial has too many monomials."""


def _placed(conditions: Sequence[Formula], equality: Compare) -> Iterator[Formula]:
    for c in conditions:
        yield Compare(c.op, c.left, c.right, span=equality.span) if isinstance(c, Compare) else c


def _degree(form: Normal, symbol: Symbol) -> int:
    return max(powers(form, symbol), default=0)


def _charts(
    form: Normal,
    symbol: Symbol,
    solvable: Sequence[Symbol],
    box: Box,
    is_nonzero: Callable[[Symbol], bool],
) -> Iterator[Branch]:
    by_power = powers(form, symbol)
    c0, c1, c2 = (term_of(by_power.get(k, {})) for k in range(3))
    slope = term_of(derivative(form, symbol))
    is_quadratic = max(by_power) == 2
    steepness = _expanded(_discriminant(c0, c1, c2) if is_quadratic else Pow(slope, 2))
    others = {o: term_of(derivative(form, o)) for o in _symbols(form) if o != symbol}
    conditions: list[Formula] = []
    for other in (o for o in solvable if o != symbol):
        if not _always_equal(Sub(Pow(slope, 2), Pow(others[other], 2)), form, symbol):
            conditions.append(_at_least(steepness, Pow(others[other], 2), is_nonzero))
        elif solvable.index(other) < solvable.index(symbol):
            return
    steps = [derivative(form, s) for s in solvable]
    limits = {o: _limit(derivative(form, o), steps) for o in others if o not in solvable}
    row = Row(
        symbol,
        {o: folded(Div(g, slope)) for o, g in others.items()},
        frozenset(o for o in solvable if o != symbol),
        {o: limit for o, limit in limits.items() if limit is not None},
    )
    values = _roots(c0, c1, c2) if max(by_power) <= 2 else roots_of(form, symbol, box)
    for value in values:
        yield Branch(symbol, value, tuple(conditions), row, form)


def _limit(form: Normal, steps: Sequence[Normal]) -> Term | None:
    """A bound of the polynomial relative to the steepest of the `steps`: each of its monomials is divided
    by one of them that is a monomial too; None where that does not go."""
    bound: Term = ZERO
    for monomial, value in form.items():
        quotients = [q for s in steps if len(s) == 1 and (q := quotient(monomial, value, s)) is not None]
        if not quotients:
            return None
        shortest = min(quotients, key=lambda q: len(next(iter(q))))
        bound = plus(bound, Call("abs", (term_of(shortest),)))
    return bound


def _at_least(large: Term, small: Term, is_nonzero: Callable[[Symbol], bool]) -> Compare:
    """`large >= small`, in its shorter form: equal parts cancel if they are multiplied out, and squares of
    names that are not zero if everything is divided by them."""
    form = normal_form(Sub(large, small))
    if form is None:
        raise _TooLong
    shorter = form
    for name in sorted(n for n in content(form) if is_nonzero(symbol_of(*n))):
        least = min(e for m in form for k, n, e in m if (k, n) == name)
        shorter = divided(shorter, name, least - least % 2)
    expanded = term_of(shorter)
    if shorter != form or size(expanded) <= size(large) + size(small):
        return Compare(">=", expanded, ZERO)
    return Compare(">=", large, small)


def _always_equal(difference: Term, form: Normal, symbol: Symbol) -> bool:
    """Whether the difference vanishes wherever `form` does."""
    expanded = normal_form(difference)
    rest = None if expanded is None else remainder(expanded, form, symbol)
    if rest is None:
        raise _TooLong
    return not rest


def _roots(c0: Term, c1: Term, c2: Term) -> tuple[Term, ...]:
    """The solutions s of c0 + c1*s + c2*s^2 = 0."""
    if c2 == ZERO:
        return (_expanded_quotient(folded(Neg(c0)), c1),)
    if c1 == ZERO:
        root = _root(_expanded_quotient(_expanded(Neg(c0)), c2))
        return (root, folded(Neg(root)))
    root = _root(_expanded(_discriminant(c0, c1, c2)))
    below = folded(Mul(TWO, c2))
    return Div(Sub(root, c1), below), Div(Neg(Add(root, c1)), below)


def _discriminant(c0: Term, c1: Term, c2: Term) -> Term:
    product = Mul(FOUR, Mul(c2, c0))
    return folded(Neg(product)) if c1 == ZERO else Sub(Pow(c1, 2), product)


def _root(radicand: Term) -> Term:
    """The square root, as a number where it is rational."""
    if isinstance(radicand, Number) and (value := radicand.value) >= 0:
        above, below = isqrt(value.numerator), isqrt(value.denominator)
        if above**2 == value.numerator and below**2 == value.denominator:
            return Number(Fraction(above, below))
    return Call("sqrt", (radicand,))


def _expanded(term: Term) -> Term:
    """The polynomial multiplied out, so that equal parts cancel. Raises `_TooLong`."""
    form = normal_form(term)
    if form is None:
        raise _TooLong
    return term_of(form)


def _expanded_quotient(above: Term, below: Term) -> Term:
    quotient = folded(Div(above, below))
    return _expanded(quotient) if isinstance(below, Number) else quotient


def _symbols(form: Normal) -> list[Symbol]:
    names = {(kind, name) for monomial in form for kind, name, _ in monomial}
    return [symbol_of(*name) for name in sorted(names)]
