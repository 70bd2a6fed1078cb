"""Universal assumptions that no elimination of quantifiers expresses: what they say of values that are known.

`\\forall x (P(x) -> R(x))` gives `R(t)` for each t of which a fact says `P(t)`, as far as the shapes of both
agree. Nothing else of the assumption is used.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice

from dl2c.ir.logic import conjuncts, negated, operands, substituted, symbols, with_sides
from dl2c.ir.model import Add, Call, Compare, Formula, Mul, Number, Or, Pow, Symbol, Term
from dl2c.verify.arithmetic.total import is_total
from dl2c.verify.states import State

Binding = Mapping[Symbol, Term]

MOST = 12
"""Of one assumption."""

_TURNED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def instantiated(state: State) -> State | None:
    """The state with what its universal assumptions say of known values; None where that is false."""
    found: list[Formula] = []
    for bound, formula in state.universals:
        for binding in islice(_bindings(bound, formula, state.facts), MOST):
            found.append(with_sides(formula, lambda t, b=binding: substituted(t, b)))
    return state.where(*found) if found else state


def assuming(bound: frozenset[Symbol], formula: Formula, state: State) -> State:
    """The state where a formula holds whatever the `bound` symbols are."""
    parts = [(frozenset(symbols(f)) & bound, f) for f in conjuncts(formula)]
    return replace(state, universals=(*state.universals, *parts))


def _bindings(bound: frozenset[Symbol], formula: Formula, facts: Sequence[Formula]) -> Iterator[Binding]:
    """Values for which facts say all premises that have bound symbols, or enough of them."""
    cases = formula.children if isinstance(formula, Or) else (formula,)
    premises = [negated(c) for c in cases if isinstance(c, Compare) and symbols(c) & bound]
    known = [f for f in facts if isinstance(f, Compare)]
    seen: set[tuple[tuple[Symbol, Term], ...]] = set()

    def extended(k: int, binding: Binding) -> Iterator[Binding]:
        if len(binding) == len(bound):
            key = tuple(sorted(binding.items(), key=str))
            if key not in seen:
                seen.add(key)
                yield binding
            return
        if k == len(premises):
            return
        for fact in known:
            for more in _compared(premises[k], fact, bound, binding):
                yield from extended(k + 1, more)
        yield from extended(k + 1, binding)

    yield from extended(0, {})


def _compared(pattern: Compare, fact: Compare, bound: frozenset[Symbol], known: Binding) -> Iterator[Binding]:
    if pattern.op == fact.op:
        yield from _all((pattern.left, pattern.right), (fact.left, fact.right), bound, known)
    if _TURNED.get(pattern.op, pattern.op) == fact.op:
        yield from _all((pattern.left, pattern.right), (fact.right, fact.left), bound, known)


def _all(
    patterns: Sequence[Term], terms: Sequence[Term], bound: frozenset[Symbol], known: Binding
) -> Iterator[Binding]:
    if not patterns:
        yield known
        return
    for more in _matched(patterns[0], terms[0], bound, known):
        yield from _all(patterns[1:], terms[1:], bound, more)


def _matched(pattern: Term, term: Term, bound: frozenset[Symbol], known: Binding) -> Iterator[Binding]:
    """Values of bound symbols that make a pattern a term, up to the order of sums and products."""
    if isinstance(pattern, Symbol) and pattern in bound:
        if known.get(pattern, term) == term and is_total(term):
            yield {**known, pattern: term}
        return
    if not symbols(pattern) & bound:
        if pattern == term:
            yield known
        return
    if type(pattern) is not type(term) or isinstance(pattern, Number):
        return
    if isinstance(pattern, Pow) and isinstance(term, Pow) and pattern.exponent != term.exponent:
        return
    if isinstance(pattern, Call) and isinstance(term, Call) and pattern.function != term.function:
        return
    parts, others = operands(pattern), operands(term)
    if len(parts) != len(others):
        return
    yield from _all(parts, others, bound, known)
    if isinstance(pattern, Add | Mul):
        yield from _all(parts, others[::-1], bound, known)
