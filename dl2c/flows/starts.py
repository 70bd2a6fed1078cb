"""Values that are computed once where a flow begins, because they do not change along it.

The slack of a predicate keeps the value that it has there, by definition (`slack.py`). A flow conserves some
terms: their Lie derivative is identically zero. Where a flow is followed numerically, such terms are replaced
by their values at its start, so that errors of the solver neither fail a watch nor cause events. The end of
the flow is projected onto equalities of its domain, P, Q and predicates that hold at its start and stay true.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from dl2c.flows.conserved import is_darboux, is_invariant
from dl2c.flows.solution import moving
from dl2c.flows.watch import Watch
from dl2c.ir.evaluate import Valuation, Value, in_range, literal, value_of
from dl2c.ir.logic import (
    atoms,
    conjunction,
    operands,
    substituted,
    symbols,
    with_atoms,
    with_sides,
    with_term,
)
from dl2c.ir.model import ZERO, Compare, Flow, Formula, Model, Sub, Symbol, Term
from dl2c.ir.slack import slack_of, widened


@dataclass(frozen=True, slots=True)
class Start:
    """A symbol that keeps, along a flow, the value of a term where the flow begins; 0 if that is undefined or
    out of range.
    """

    symbol: Symbol
    value: Term


@dataclass(frozen=True, slots=True)
class Projection:
    """An equality that a flow conserves. The end of the flow is moved onto it if `holds` is true where the
    flow begins, which the symbol `held` keeps as 1 or 0. Both are None for equalities of the domain, without
    which the flow does not begin.
    """

    equality: Compare
    held: Symbol | None = None
    holds: Formula | None = None


@dataclass(frozen=True, slots=True)
class Steady:
    """Watches over what a flow changes and over symbols for values at its start, which `starts` defines."""

    watches: tuple[Watch, ...]
    starts: tuple[Start, ...]


def slacks_of(watches: Sequence[Watch]) -> tuple[Start, ...]:
    """The slacks of all watches, each once."""
    return tuple(dict.fromkeys(Start(*item) for watch in watches for item in watch.slacks))


def merged(watches: Sequence[Watch]) -> tuple[Watch, ...]:
    """The watches with one symbol for slacks that are the same term."""
    first: dict[Term, Symbol] = {}
    same: dict[Symbol, Term] = {}
    for symbol, term in (slack for watch in watches for slack in watch.slacks):
        if first.setdefault(term, symbol) != symbol:
            same[symbol] = first[term]

    def changed(formula: Formula) -> Formula:
        return with_sides(formula, lambda term: substituted(term, same))

    return tuple(
        replace(
            watch,
            stays=changed(watch.stays),
            due=changed(watch.due),
            goal=changed(watch.goal),
            plainly=changed(watch.plainly),
            slacks=tuple((symbol, term) for symbol, term in watch.slacks if symbol not in same),
        )
        for watch in watches
    )


def used(starts: Sequence[Start], parts: Sequence[Term | Formula]) -> tuple[Start, ...]:
    """The starts whose symbols occur in `parts`."""
    names = symbols(*parts)
    return tuple(s for s in starts if s.symbol in names)


def begun(starts: Sequence[Start], env: Valuation, exact: bool) -> Valuation:
    """The valuation where a flow begins, extended by the values of `starts`."""
    values: dict[Symbol, Value | None] = dict(env)
    for start in starts:
        value = value_of(start.value, env, exact)
        values[start.symbol] = value if in_range(value) else literal(Fraction(0), exact)
    return values


def conserved(term: Term, flow: Flow) -> bool:
    """Whether a term has variables that move and yet does not change along the flow."""
    rates = dict(flow.equations)
    return bool(moving(term, rates)) and is_invariant(term, rates)


def steady(flow: Flow, watches: Sequence[Watch]) -> Steady:
    """The watches with conserved parts, as large as possible, replaced by symbols."""
    found: dict[Term, Symbol] = {}

    def frozen(atom: Compare) -> Compare:
        difference = Sub(atom.left, atom.right)
        parts = (difference, ZERO) if conserved(difference, flow) else (atom.left, atom.right)
        return Compare(atom.op, *(_frozen(t, flow, found) for t in parts), span=atom.span)

    def changed(formula: Formula) -> Formula:
        return with_atoms(formula, frozen)

    made = tuple(
        replace(
            watch,
            stays=changed(watch.stays),
            due=changed(watch.due),
            goal=changed(watch.goal),
            plainly=changed(watch.plainly),
        )
        for watch in watches
    )
    slacks: dict[Symbol, Term] = {s.symbol: s.value for s in slacks_of(watches)}
    return Steady(made, tuple(Start(s, substituted(term, slacks)) for term, s in found.items()))


def _frozen(term: Term, flow: Flow, found: dict[Term, Symbol]) -> Term:
    for part in _conserved_parts(term, flow):
        symbol = found.setdefault(part, Symbol(f"at_start{len(found)}", "start"))
        term = with_term(term, part, symbol)
    return term


def _conserved_parts(term: Term, flow: Flow) -> list[Term]:
    if not moving(term, dict(flow.equations)):
        return []
    if conserved(term, flow):
        return [term]
    return [part for t in operands(term) for part in _conserved_parts(t, flow)]


def _stays(flow: Flow, equality: Compare, known: Sequence[Compare]) -> bool:
    """Whether an equality over variables that move stays true along the flow, if those `known` do."""
    rates = dict(flow.equations)
    term = Sub(equality.left, equality.right)
    if not moving(term, rates):
        return False
    return is_invariant(term, rates) or is_darboux(term, rates, [Sub(e.left, e.right) for e in known])


def projections(flow: Flow, equalities: Sequence[Compare], tolerance: Fraction) -> tuple[Projection, ...]:
    """What the end of a flow is moved onto: equalities of its domain, then those of `equalities` that stay
    true by themselves, then those that stay true if the ones before do.
    """
    found = [Projection(invariant) for invariant in flow.invariants]
    left = [e for e in dict.fromkeys(equalities) if e not in flow.invariants]
    alone = [e for e in left if _stays(flow, e, ())]
    kept = [*flow.invariants, *alone]
    while (more := next((e for e in left if e not in kept and _stays(flow, e, kept)), None)) is not None:
        kept.append(more)
    for k, equality in enumerate(kept[len(flow.invariants) :]):
        needed = (equality,) if equality in alone else kept[: kept.index(equality) + 1]
        holds = conjunction(widened(e, slack_of(e, tolerance)) for e in needed)
        found.append(Projection(equality, Symbol(f"at_start_held{k}", "start"), holds))
    return tuple(found)


def equalities_of(model: Model) -> tuple[Compare, ...]:
    """All equalities in the precondition, the predicates and the postcondition."""
    formulas = [model.precondition, *(p.formula for p in model.predicates)]
    formulas += [] if model.postcondition is None else [model.postcondition]
    return tuple(a for f in formulas for a in atoms(f) if a.op == "=")
