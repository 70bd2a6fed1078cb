"""Solve equalities of the precondition: a name that an equality determines is not drawn.

Top-level conjuncts and a box that holds every initial state come in; definitions for
as many names as there are independent equalities go out, with the conjuncts that are
left. A name has one definition where an equality is linear in it and its coefficient is
proved to vanish nowhere in the box; else an equality is solved in charts (branches.py).
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dl2c.interval.arithmetic import Box, Interval, magnitude, truth
from dl2c.ir.logic import atoms, folded, mapped, size, symbols
from dl2c.ir.model import ONE, ZERO, Compare, Div, Formula, Neg, Number, Sub, Symbol, Term
from dl2c.ir.normal import normal_form, symbol_of
from dl2c.sampling.equalities.algebra import (
    content,
    derivative,
    fraction,
    is_affine,
    remainder,
    term_of,
    without_content,
)
from dl2c.sampling.equalities.branches import Branch, Row, branches_of
from dl2c.sampling.equalities.linear import Solution, is_tautology, linear_parts, rank, replaced, solutions
from dl2c.sampling.equalities.root_of import Definition, names_of, with_terms

LONG = 60
"""Nodes of an equality that is left as it is written."""


@dataclass(frozen=True, slots=True)
class Elimination:
    """`definitions` in the order of evaluation; `rest` holds no equality. `rows` are the slopes of
    the defined names that are not affine functions of others."""

    definitions: tuple[tuple[Symbol, Definition], ...]
    rest: tuple[Formula, ...]
    rows: tuple[Row, ...] = ()


@dataclass(frozen=True, slots=True)
class Unsolved:
    """An equality that determines no name; so many equalities at least are independent."""

    atom: Compare
    equalities: int


class _Stuck(Exception):
    def __init__(self, unsolved: Unsolved) -> None:
        super().__init__(unsolved)
        self.unsolved = unsolved


def eliminate(
    conjuncts: Sequence[Formula], names: Sequence[Symbol], box: Box
) -> tuple[Elimination, ...] | Unsolved:
    """Solve every equality for one of `names`, the most direct definitions first.

    Where none is known to have one solution, each way to solve one gives an elimination of its own;
    together they hold the solutions once, but for their common boundaries and singular points.
    """
    pending = [c for c in conjuncts if isinstance(c, Compare) and c.op == "="]
    rest = tuple(c for c in conjuncts if c not in pending)
    try:
        found = tuple(_eliminated(pending, rest, tuple(names), (), box))
    except _Stuck as stuck:
        return stuck.unsolved
    inner = next((a for e in found for c in e.rest for a in atoms(c) if a.op == "="), None)
    return found if inner is None else Unsolved(inner, 0)


def _eliminated(
    pending: Sequence[Compare],
    rest: tuple[Formula, ...],
    names: tuple[Symbol, ...],
    chosen: tuple[Branch, ...],
    box: Box,
) -> Iterator[Elimination]:
    solved, left = _directly_solved(pending, names, rest, box, steep=False)
    if any(isinstance(e.left, Number) and isinstance(e.right, Number) for e in left):
        return
    limits = (*rest, *(c for s in solved for c in s.conditions if c not in rest))
    if (shorter := [_cancelled(e, limits, box) for e in left]) != left:
        others = shorter + [Compare("=", s.symbol, s.term) for s in solved]
        yield from _eliminated(others, limits, names, chosen, box)
        return
    known = {s.symbol for s in solved}
    unknown = [n for n in names if n not in known]
    equality, branches = _branching(left, unknown, box, lambda s: _is_nonzero(s, limits, box))
    if left and not branches:
        solved, left = _directly_solved(pending, names, rest, box, steep=True)
        if left:
            raise _Stuck(Unsolved(left[0], len(solved) + len(chosen) + 1))
    if not branches:
        yield _assembled(chosen, solved, rest, box)
    for branch in branches:
        reduced = [_reduced(e, branch) for e in left if e is not equality]
        others = [e for e, _ in reduced] + [Compare("=", s.symbol, s.term) for s in solved]
        conditions = [c for s in solved for c in s.conditions] + [c for _, cs in reduced for c in cs]
        free = tuple(n for n in names if n != branch.symbol and n not in names_of(branch.value))
        yield from _eliminated(others, (*rest, *conditions, *branch.conditions), free, (*chosen, branch), box)


def _is_nonzero(symbol: Symbol, conjuncts: Iterable[Formula], box: Box) -> bool:
    """Whether one of the conjuncts is false wherever the name is zero."""
    there = {**box, symbol: Interval(0.0, 0.0)}
    return any(truth(c, there) == "false" for c in conjuncts)


def _cancelled(equality: Compare, others: Sequence[Formula], box: Box) -> Compare:
    """A polynomial equality divided by names that the other conjuncts keep from being zero."""
    form = normal_form(Sub(equality.left, equality.right))
    if form is None:
        return equality
    nonzero = {n for n in content(form) if _is_nonzero(symbol_of(*n), others, box)}
    if not nonzero:
        return equality
    return Compare("=", term_of(without_content(form, nonzero)), ZERO, span=equality.span)


def _branching(
    equalities: Sequence[Compare], names: Sequence[Symbol], box: Box, is_nonzero: Callable[[Symbol], bool]
) -> tuple[Compare | None, tuple[Branch, ...]]:
    """The shortest equality that can be solved in charts, and these."""
    for equality in sorted(equalities, key=lambda e: len(symbols(e))):
        if branches := branches_of(equality, names, box, is_nonzero):
            return equality, branches
    return None, ()


def _assembled(
    chosen: Sequence[Branch], solved: Sequence[Solution], rest: Sequence[Formula], box: Box
) -> Elimination:
    definitions = [
        *((b.symbol, b.value) for b in chosen),
        *((s.symbol, s.term) for s in reversed(solved)),
    ]
    rows = [*(b.row for b in chosen), *(r for s in solved if (r := _row(s, box)) is not None)]
    return _with_numbers(definitions, [*rest, *(c for s in solved for c in s.conditions)], rows)


def _directly_solved(
    pending: Sequence[Compare], names: Sequence[Symbol], rest: Sequence[Formula], box: Box, steep: bool
) -> tuple[list[Solution], list[Compare]]:
    """Solutions in the order found, each replaced in the equalities that are left."""
    solved: list[Solution] = []
    pending = list(pending)
    mentions = Counter(s for formula in rest for s in symbols(formula))
    while pending := [e for e in pending if not is_tautology(e)]:
        found = [
            (rank(s, names, mentions), k, s)
            for k, e in enumerate(pending)
            for s in solutions(e, names, box)
            if steep or math.isfinite(s.slope)
        ]
        if not found:
            break
        _, k, best = min(found, key=lambda f: f[:2])
        del pending[k]
        solved.append(best)
        value = {best.symbol: best.term}
        pending = [
            _collected(Compare("=", replaced(e.left, value), replaced(e.right, value), span=e.span))
            for e in pending
        ]
    return solved, pending


def _collected(equality: Compare) -> Compare:
    """A long equality with what belongs together added up, where that makes it shorter: linear ones never
    grow longer than they have names."""
    difference = Sub(equality.left, equality.right)
    if size(difference) <= LONG or (form := normal_form(difference)) is None:
        return equality
    whole = term_of(form)
    return Compare("=", whole, ZERO, span=equality.span) if size(whole) < size(difference) else equality


def _reduced(equality: Compare, branch: Branch) -> tuple[Compare, tuple[Formula, ...]]:
    """The equality where that of the branch holds, which may say it already; and its divisor is not zero."""
    parts = fraction(Sub(equality.left, equality.right))
    form = None if parts is None else normal_form(parts[0])
    if parts is None or form is None or (rest := remainder(form, branch.form, branch.symbol)) is None:
        return equality, ()
    if any(rest) and len(rest) > len(form):
        return equality, ()
    divisor = () if parts[1] == ONE else (Compare("!=", parts[1], ZERO, span=equality.span),)
    return Compare("=", term_of(rest), ZERO, span=equality.span), divisor


def _row(solution: Solution, box: Box) -> Row | None:
    """How the name follows the others; None where it is an affine function of them. Where it is a multiple
    of one of them, its own range limits the factor."""
    if is_affine(solution.term):
        return None
    found = symbols(solution.term)
    ordered = sorted(found, key=lambda s: (s.kind, s.name))
    largest = magnitude(box[solution.symbol]).high
    limits: dict[Symbol, Term] = {}
    if math.isfinite(largest):
        multiples = [s for s in ordered if (p := linear_parts(solution.term, s)) and p[1] == ZERO]
        limits = {s: Div(Number(Fraction(largest)), s) for s in multiples}
    slopes = {s: folded(Neg(derivative(solution.term, s))) for s in ordered}
    return Row(solution.symbol, slopes, limits=limits)


def _with_numbers(
    definitions: Iterable[tuple[Symbol, Definition]], rest: Iterable[Formula], rows: Iterable[Row]
) -> Elimination:
    """Names that turned out to be plain numbers replaced wherever they occur."""
    numbers: dict[Symbol, Term] = {}
    simple: list[tuple[Symbol, Definition]] = []
    for symbol, definition in definitions:
        value = with_terms(definition, lambda t: replaced(t, numbers))
        simple.append((symbol, value))
        if isinstance(value, Number):
            numbers[symbol] = value
    return Elimination(
        tuple(simple),
        tuple(mapped(c, lambda t: replaced(t, numbers)) for c in rest),
        tuple(
            Row(
                r.symbol,
                {s: replaced(t, numbers) for s, t in r.slopes.items() if s not in numbers},
                r.gentle,
                {s: replaced(t, numbers) for s, t in r.limits.items()},
            )
            for r in rows
            if r.symbol not in numbers
        ),
    )
