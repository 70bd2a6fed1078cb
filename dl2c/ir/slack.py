"""How much an atom may be missed by, so that rounding ends no episode of a proved model (semantics 5).

An atom `a <= b` is relaxed to `a <= b + slack`, where the slack is `tolerance * (1 + the sizes of the
terms of a - b)`: the rounding error of a difference grows with its terms, however small the difference
is. A state is judged with its own slack. Along a flow the slack keeps the value that it has where the flow
begins. The formula has a symbol for it, so it adds neither cases nor degree to what is watched.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import TypeAlias

from dl2c.ir.logic import folded, mapped, substituted, symbols, with_atoms
from dl2c.ir.model import ONE, ZERO, Add, Call, Compare, Formula, Mul, Neg, Number, Sub, Symbol, Term

Scale: TypeAlias = Callable[[Compare], Iterator[Term]]
"""The terms whose sizes the slack of an atom grows with."""


def terms_of(atom: Compare) -> Iterator[Term]:
    """The additive terms of both sides as written: operands of their + and -, products whole."""
    for side in (atom.left, atom.right):
        yield from _additive(side)


def _additive(term: Term) -> Iterator[Term]:
    match term:
        case Add(left, right) | Sub(left, right):
            yield from _additive(left)
            yield from _additive(right)
        case Neg(child):
            yield from _additive(child)
        case _ if term != ZERO:
            yield term
        case _:
            pass


def sides_of(atom: Compare) -> Iterator[Term]:
    """Both sides, whatever they are made of."""
    yield from (side for side in (atom.left, atom.right) if side != ZERO)


def slack_of(atom: Compare, tolerance: Fraction, scale: Scale = terms_of) -> Term:
    """What an atom is relaxed by."""
    sizes = [folded(Call("abs", (term,))) for term in scale(atom)]
    return folded(Mul(Number(tolerance), reduce(lambda a, b: folded(Add(a, b)), sizes, ONE)))


def widened(atom: Compare, slack: Term) -> Compare:
    """The atom, missed by `slack` at most; `!=` as it is."""
    left, right, span = atom.left, atom.right, atom.span
    if atom.op == "!=":
        return atom
    if atom.op == "=":
        difference = left if right == ZERO else folded(Sub(left, right))
        return Compare("<=", folded(Call("abs", (difference,))), slack, span=span)
    if atom.op in ("<", "<="):
        return Compare(atom.op, left, slack if right == ZERO else folded(Add(right, slack)), span=span)
    return Compare(atom.op, folded(Add(left, slack)), right, span=span)


def relaxed(formula: Formula, tolerance: Fraction, scale: Scale = terms_of) -> Formula:
    """Each atom widened by its slack, `!=` kept."""
    if tolerance == 0:
        return formula
    return with_atoms(formula, lambda atom: widened(atom, slack_of(atom, tolerance, scale)))


def equalities_relaxed(formula: Formula, tolerance: Fraction, scale: Scale = terms_of) -> Formula:
    """Only the equalities widened, as by `relaxed`."""
    if tolerance == 0:
        return formula
    return with_atoms(
        formula, lambda atom: widened(atom, slack_of(atom, tolerance, scale)) if atom.op == "=" else atom
    )


@dataclass(frozen=True, slots=True)
class Slacks:
    """The slacks of one predicate, each with the symbol that stands for it along a flow.

    A slack that is a number needs no symbol. A slack over a quantifier's variable is eliminated with its
    atom. It grows with the two sides instead of their terms, since each size in it makes two cases.
    """

    name: str
    tolerance: Fraction
    terms: dict[Term, Symbol]

    def relaxed(self, atom: Compare) -> Compare:
        """The atom with a symbol for its slack."""
        if self.tolerance == 0 or atom.op == "!=":
            return atom
        slack = slack_of(atom, self.tolerance)
        names = symbols(slack)
        if any(" " in s.name for s in names):
            return widened(atom, slack_of(atom, self.tolerance, sides_of))
        if not names:
            return widened(atom, slack)
        fresh = Symbol(f"{self.name}_slack{len(self.terms)}", "start")
        return widened(atom, self.terms.setdefault(slack, fresh))

    @property
    def starts(self) -> tuple[tuple[Symbol, Term], ...]:
        """Every symbol with what it stands for where a flow begins."""
        return tuple((symbol, term) for term, symbol in self.terms.items())


def settled(formula: Formula, starts: tuple[tuple[Symbol, Term], ...]) -> Formula:
    """The formula in a state alone: symbols of slacks replaced by the slacks."""
    values = dict(starts)
    return mapped(formula, lambda term: substituted(term, values))


def least_slack(formula: Formula, tolerance: Fraction) -> Formula:
    """A condition that implies the formula: each symbol of a slack replaced by the tolerance, which is its
    least value, and equalities without slack.
    """

    def least(atom: Compare) -> Compare:
        match atom:
            case Compare("<=", Call("abs", (exact,)), Symbol(_, "start"), span=span):
                return Compare("=", exact, ZERO, span=span)
            case Compare(op, left, right, span=span):
                values = {s: Number(tolerance) for s in symbols(left, right) if s.kind == "start"}
                return Compare(op, substituted(left, values), substituted(right, values), span=span)

    return with_atoms(formula, least)
