"""HC4 contraction: shrink a box without losing a point that satisfies a formula.

A formula and a box come in; a smaller box goes out, or None when the box is proved to
hold no satisfying point. Every atom is evaluated forwards and its bounds are then
propagated backwards through its terms (Benhamou et al., "Revising hull and box
consistency", 1999). Conjunctions are iterated, disjunctions give the hull of their
branches.
"""

from typing import assert_never

from dl2c.interval.arithmetic import (
    INF,
    WHOLE,
    Box,
    Interval,
    enclosure,
    evaluate,
    hull_of,
    meet,
    minus,
    negated,
    plus,
    quotients,
    root,
    times,
    truth,
)
from dl2c.ir.model import (
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
    Symbol,
    Term,
    Truth,
)

NONNEGATIVE = Interval(0.0, INF)


def contract(formula: Formula, box: Box, rounds: int = 8) -> dict[Symbol, Interval] | None:
    """A box inside `box` that keeps every point satisfying the formula; None: there is none.

    Conjunctions are gone through at most `rounds` times, or until nothing changes.
    """
    current = dict(box)
    match formula:
        case Truth(value):
            return current if value else None
        case Compare():
            return current if _narrow_atom(formula, current) else None
        case Or(children):
            branches = [b for c in children if (b := contract(c, box, rounds)) is not None]
            return {s: hull_of(b[s] for b in branches) for s in box} if branches else None
        case And(children):
            for _ in range(rounds):
                before = dict(current)
                for child in children:
                    if isinstance(child, Compare):
                        if not _narrow_atom(child, current):
                            return None
                        continue
                    inner = contract(child, current, rounds)
                    if inner is None:
                        return None
                    current = inner
                if current == before:
                    break
            return current
        case _:
            assert_never(formula)


# The functions below shrink `box` in place and return False when nothing is left.

Working = dict[Symbol, Interval]


def _narrow_atom(atom: Compare, box: Working) -> bool:
    if truth(atom, box) == "false":
        return False
    left, right = atom.left, atom.right
    match atom.op:
        case "<" | "<=":
            return _narrow_ordered(left, right, box)
        case ">" | ">=":
            return _narrow_ordered(right, left, box)
        case "=":
            return _narrow(left, evaluate(right, box), box) and _narrow(right, evaluate(left, box), box)
        case "!=":
            return True
        case _:
            assert_never(atom.op)


def _narrow_ordered(small: Term, large: Term, box: Working) -> bool:
    return _narrow(small, Interval(-INF, evaluate(large, box).high), box) and _narrow(
        large, Interval(evaluate(small, box).low, INF), box
    )


def _narrow(term: Term, target: Interval, box: Working) -> bool:
    """Keep the points of the box at which the term is defined with a value in `target`."""
    match term:
        case Number(value):
            return not meet(enclosure(value), target).empty
        case Symbol():
            kept = meet(box[term], target)
            if kept.empty:
                return False
            box[term] = Interval(kept.low, kept.high)
            return True
        case _:
            target = meet(evaluate(term, box), target)
            return not target.empty and _narrow_operands(term, target, box)


def _narrow_operands(term: Neg | Add | Sub | Mul | Div | Pow | Call, target: Interval, box: Working) -> bool:
    match term:
        case Neg(child):
            return _narrow(child, negated(target), box)
        case Add(a, b):
            return _narrow(a, minus(target, evaluate(b, box)), box) and _narrow(
                b, minus(target, evaluate(a, box)), box
            )
        case Sub(a, b):
            return _narrow(a, plus(target, evaluate(b, box)), box) and _narrow(
                b, minus(evaluate(a, box), target), box
            )
        case Mul(a, b) if a == b:
            return _narrow_power(a, 2, target, box)
        case Mul(a, b):
            return _narrow_factor(a, target, evaluate(b, box), box) and _narrow_factor(
                b, target, evaluate(a, box), box
            )
        case Div(a, b):
            return _narrow(a, times(target, evaluate(b, box)), box) and _narrow_factor(
                b, evaluate(a, box), target, box
            )
        case Pow(base, exponent):
            return _narrow_power(base, exponent, target, box)
        case Call("abs", (a,)):
            return _narrow_mirrored(a, meet(target, NONNEGATIVE), box)
        case Call("sqrt", (a,)):
            return _narrow(a, times(meet(target, NONNEGATIVE), meet(target, NONNEGATIVE)), box)
        case Call("min", (a, b)):
            return _narrow_least(a, b, target, box) and _narrow_least(b, a, target, box)
        case Call("max", (a, b)):
            least = negated(target)
            return _narrow_least(Neg(a), Neg(b), least, box) and _narrow_least(Neg(b), Neg(a), least, box)
        case Call():
            return True
        case _:
            assert_never(term)


def _narrow_factor(factor: Term, product: Interval, other: Interval, box: Working) -> bool:
    """factor * other = product. Nothing follows where `other` may be 0 and `product` too."""
    if product.contains(0.0) and other.contains(0.0):
        return _narrow(factor, WHOLE, box)
    return _narrow_pieces(factor, quotients(product, other), box)


def _narrow_power(base: Term, exponent: int, target: Interval, box: Working) -> bool:
    if exponent % 2 == 0:
        target = meet(target, NONNEGATIVE)
        return not target.empty and _narrow_mirrored(base, root(target, exponent), box)
    pieces: list[Interval] = []
    if target.high >= 0:
        pieces.append(root(target, exponent))
    if target.low <= 0:
        pieces.append(negated(root(negated(target), exponent)))
    return _narrow_pieces(base, tuple(pieces), box)


def _narrow_mirrored(term: Term, size: Interval, box: Working) -> bool:
    """|term| lies in `size`."""
    return _narrow_pieces(term, (negated(size), size), box)


def _narrow_pieces(term: Term, pieces: tuple[Interval, ...], box: Working) -> bool:
    """The term lies in one of the pieces."""
    value = evaluate(term, box)
    reached = [kept for piece in pieces if not (kept := meet(value, piece)).empty]
    return bool(reached) and _narrow(term, hull_of(reached), box)


def _narrow_least(term: Term, other: Term, target: Interval, box: Working) -> bool:
    """min(term, other) lies in `target`: the term is the minimum where the other one is too large."""
    is_least = evaluate(other, box).low > target.high
    return _narrow(term, Interval(target.low, target.high if is_least else INF), box)
