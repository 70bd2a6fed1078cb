"""Conditions as signs of margins: what is watched along a flow.

Comes in: a formula in negation normal form. Goes out: an equivalent one (over the reals, an
undefined atom being false) whose atoms are `margin >= 0`, `> 0`, `= 0` or `!= 0`, and whose
margins are smooth wherever the other atoms of their conjunction hold: `abs`, `min` and `max`
are split into cases, and divisors and square roots bring the condition that they are defined.
"""

from collections.abc import Callable
from typing import TypeAlias

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import (
    atoms,
    conjunction,
    difference,
    disjunction,
    folded,
    negation,
    operands,
    rewritten,
    with_term,
)
from dl2c.ir.model import ZERO, Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Term

MAX_ATOMS = 256
"""A condition that would need more cases is refused."""

MAX_KINKS = 12


Moves: TypeAlias = Callable[[Term], bool]
"""Whether a term changes along the flow."""


class TooManyCases(Exception):
    """The condition has too many cases, as the message says."""


def margin_of(atom: Compare) -> Term:
    """A term that is positive inside the atom and 0 on its boundary; for `=` and `!=` left minus right."""
    mirrored = Compare(atom.op, atom.right, atom.left) if atom.op in ("<", "<=") else atom
    return difference(mirrored)


def smooth(formula: Formula, moves: Moves, as_written: bool = False) -> Formula:
    """The formula over margins; terms that do not move keep their kinks. Raises `TooManyCases`.

    Divisors that move are multiplied out, unless margins are wanted `as_written`.
    """
    made = _smooth(formula, moves, as_written)
    if len(list(atoms(made))) > MAX_ATOMS:
        raise TooManyCases(f"more than {MAX_ATOMS} comparisons")
    return made


def _smooth(formula: Formula, moves: Moves, as_written: bool) -> Formula:
    def whole(atom: Compare) -> Formula:
        margin = _over_margin(atom)
        if _kink(margin.left, moves, 1) is None:
            return _atom(margin, moves, as_written)
        # An atom without value is false, also where the case that decides has one.
        known = _defined(margin.left)
        smoothed = [_smooth(f, moves, as_written) for f in known]
        return conjunction([*smoothed, _atom(margin, moves, as_written, frozenset(known))])

    return rewritten(formula, whole)


def _over_margin(atom: Compare) -> Compare:
    """`margin >= 0`, `> 0`, `= 0` or `!= 0`."""
    kind = {"<=": ">=", "<": ">"}.get(atom.op, atom.op)
    assert kind in (">=", ">", "=", "!=")
    return Compare(kind, margin_of(atom), ZERO, span=atom.span)


def _atom(
    atom: Compare, moves: Moves, as_written: bool, known: frozenset[Formula] = frozenset(), depth: int = 0
) -> Formula:
    """One atom, its first kink resolved into cases, then the cases; what is `known` is not said again."""
    if depth > MAX_KINKS:
        raise TooManyCases(f"more than {MAX_KINKS} of abs, min and max in one comparison")
    found = _kink(atom.left, moves, 1)
    if found is None:
        margin = atom.left if as_written else cleared(atom.left, moves, atom.op in ("=", "!="))
        defined = [f for f in _defined(atom.left) if f not in known]
        return conjunction([*defined, Compare(atom.op, margin, ZERO, span=atom.span)])
    call, direction = found
    branches = _branches(call)
    cases = [Compare(atom.op, with_term(atom.left, call, b), ZERO, span=atom.span) for b in branches]
    parts = [_atom(c, moves, as_written, known, depth + 1) for c in cases]
    if direction and atom.op in (">=", ">"):
        grows = (direction > 0) == (call.function != "min")
        return disjunction(parts) if grows else conjunction(parts)
    first, second = branches
    chosen = Compare("<" if call.function == "min" else ">", first, second, span=atom.span)
    return disjunction(
        [
            conjunction([_smooth(chosen, moves, as_written), parts[0]]),
            conjunction([_smooth(negation(chosen), moves, as_written), parts[1]]),
        ]
    )


def _branches(call: Call) -> tuple[Term, Term]:
    """The two terms of which a call is the larger or the smaller."""
    if call.function == "abs":
        return call.args[0], folded(Neg(call.args[0]))
    first, second = call.args
    return first, second


def _kink(term: Term, moves: Moves, direction: int) -> tuple[Call, int] | None:
    """The first `abs`, `min` or `max` without one inside, and how the term follows it: 1 it grows, -1 it
    falls, 0 where that depends on the state.
    """
    if not moves(term):
        return None
    match term:
        case Call("abs" | "min" | "max", args):
            inner = [k for a in args if (k := _kink(a, moves, 0)) is not None]
            return inner[0] if inner else (term, direction)
        case Add(left, right):
            sides = ((left, direction), (right, direction))
        case Sub(left, right):
            sides = ((left, direction), (right, -direction))
        case Neg(child):
            sides = ((child, -direction),)
        case Mul(Number(value), factor) | Mul(factor, Number(value)):
            sides = ((factor, direction if value >= 0 else -direction),)
        case _:
            sides = tuple((t, 0) for t in operands(term))
    return next((k for t, d in sides if (k := _kink(t, moves, d)) is not None), None)


def cleared(term: Term, moves: Moves, zero_alone: bool = False) -> Term:
    """A term of the same sign, wherever the term has a value, without divisors that move: n*d for n/d, or
    n where only zero matters.
    """
    above, below = fraction(term, moves)
    return above if below is None or zero_alone else Mul(above, below)


def fraction(term: Term, cleared: Callable[[Term], bool]) -> tuple[Term, Term | None]:
    """Dividend and divisor, None for 1, made of the divisors that are to be `cleared`."""
    match term:
        case Div(left, right) if cleared(right):
            (a, b), (c, d) = fraction(left, cleared), fraction(right, cleared)
            return times(a, d), times(c, b)
        case Div(left, right):
            a, b = fraction(left, cleared)
            return (term, None) if b is None else (folded(Div(a, right)), b)
        case Neg(child):
            a, b = fraction(child, cleared)
            return folded(Neg(a)), b
        case Add(left, right) | Sub(left, right):
            (a, b), (c, d) = fraction(left, cleared), fraction(right, cleared)
            below = b if d is None or d == b else times(d, b)
            scaled = (a, c) if b == d else (times(a, d), times(c, b))
            return (term, None) if below is None else (folded(type(term)(*scaled)), below)
        case Mul(left, right):
            (a, b), (c, d) = fraction(left, cleared), fraction(right, cleared)
            below = b if d is None else times(d, b)
            return (term, None) if below is None else (folded(Mul(a, c)), below)
        case Pow(base, exponent):
            a, b = fraction(base, cleared)
            return (term, None) if b is None else (folded(Pow(a, exponent)), folded(Pow(b, exponent)))
        case _:
            return term, None


def times(term: Term, factor: Term | None) -> Term:
    return term if factor is None else folded(Mul(term, factor))


def _defined(term: Term) -> list[Formula]:
    """When a term has a value, as far as a state decides it."""
    found = [f for t in operands(term) for f in _defined(t)]
    match term:
        case Div(_, divisor) if divisor == ZERO or not isinstance(divisor, Number):
            found.append(Compare("!=", divisor, ZERO))
        case Call(function, args) if (domain := FUNCTIONS[function].domain) is not None:
            found += domain(*args)
        case _:
            pass
    return list(dict.fromkeys(found))


def margins_of(formulas: list[Formula]) -> tuple[Term, ...]:
    """Every margin of smooth formulas, each once, in the order of first occurrence."""
    return tuple(dict.fromkeys(a.left for f in formulas for a in atoms(f)))
