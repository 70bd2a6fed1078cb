"""Derived constants: what the conditions and rewards of steps need of constants alone, once an episode.

A quotient or a function of constants keeps its value for as long as they keep theirs. It is kept behind
them, so that steps read it as they read a constant; it is computed by the operations that it stands for, so
that every bit is the same.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice

from dl2c.interval.arithmetic import Interval, evaluate
from dl2c.interval.bounded import interval_of
from dl2c.ir.logic import operands, sides, subterms, with_operands, with_sides
from dl2c.ir.model import TRUE, Call, Div, Formula, Model, Number, Symbol, Term
from dl2c.paths.path import Paths
from dl2c.symbolic.terms import LARGEST

MOST = 16
"""More of them would need more memory in each step than they save time."""

PARTS = 100
"""A term with more parts is looked at only part by part."""

CHEAP = frozenset({"abs", "min", "max"})
"""Functions that take no longer than reading a number."""


@dataclass(frozen=True, slots=True)
class Derived:
    """The derived constants of a model by the terms that they stand for, in the order of their places.
    `bounds` encloses constants, derived ones too; `changed` is what terms have been changed to, by identity:
    formulas share what definitions expand to.
    """

    symbols: Mapping[Term, Symbol] = field(default_factory=dict[Term, Symbol])
    bounds: Mapping[Symbol, Interval] = field(default_factory=dict[Symbol, Interval])
    changed: dict[int, tuple[Term, Term]] = field(default_factory=dict[int, tuple[Term, Term]])

    def in_formula(self, formula: Formula) -> Formula:
        """The formula with derived constants in place of the terms that they stand for."""
        return with_sides(formula, self.in_term) if self.symbols else formula

    def in_term(self, term: Term) -> Term:
        """The same for a term."""
        if (seen := self.changed.get(id(term))) is None:
            seen = self.changed[id(term)] = term, self._changed(term)
        return seen[1]

    def _changed(self, term: Term) -> Term:
        if _is_derivable(term, self.bounds) and term in self.symbols:
            return self.symbols[term]
        before = operands(term)
        after = tuple(map(self.in_term, before))
        same = all(new is old for new, old in zip(after, before, strict=True))
        return term if same else with_operands(term, after)


def derived_constants(model: Model, paths: Paths) -> Derived:
    """Those of conditions and rewards of every step."""
    bounds = {c.symbol: interval_of(c.bound, c.value) for c in model.constants}
    found = dict.fromkeys(_derivable(_terms_of_steps(model, paths), bounds))
    symbols = {term: _symbol(k) for k, term in enumerate(islice(found, MOST))}
    return Derived(symbols, bounds | {symbol: evaluate(term, bounds) for term, symbol in symbols.items()})


def _terms_of_steps(model: Model, paths: Paths) -> Iterator[Term]:
    for predicate in model.predicates:
        yield from sides(predicate.relaxed)
        yield from sides(predicate.due or TRUE)
        earned = predicate.reward, predicate.penalty, predicate.shape
        yield from (term for term in earned if term is not None)
    yield from sides(model.postcondition or TRUE)
    for path in paths.paths:
        yield from sides(path.guard)


def _derivable(terms: Iterable[Term], bounds: Mapping[Symbol, Interval]) -> Iterator[Term]:
    """Each largest subterm that a derived constant can stand for, from left to right."""
    seen: set[int] = set()
    stack = list(reversed(list(terms)))
    while stack:
        term = stack.pop()
        if id(term) in seen:
            continue
        seen.add(id(term))
        if _is_derivable(term, bounds):
            yield term
        else:
            stack.extend(reversed(operands(term)))


def _is_derivable(term: Term, bounds: Mapping[Symbol, Interval]) -> bool:
    """Whether a term takes time to compute and has one finite value in an episode, as all its parts have."""
    if not _takes_time(term):
        return False
    parts = list(islice(subterms(term), PARTS + 1))
    names = [part for part in parts if isinstance(part, Symbol)]
    if not names or len(parts) > PARTS or any(name not in bounds for name in names):
        return False
    return all(_is_finite(evaluate(part, bounds)) for part in parts)


def _takes_time(term: Term) -> bool:
    match term:
        case Div(_, Number()):
            return False
        case Div():
            return True
        case Call(function):
            return function not in CHEAP
        case _:
            return False


def _symbol(k: int) -> Symbol:
    """No name of dL has `_` before a letter."""
    return Symbol(f"derived_constant{k + 1}", "constant")


def _is_finite(value: Interval) -> bool:
    return value.total and not value.empty and max(abs(value.low), abs(value.high)) <= LARGEST
