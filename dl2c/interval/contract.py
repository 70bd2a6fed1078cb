"""HC4 contraction: shrink a box without losing a point that satisfies a formula.

A formula and a box come in; a smaller box goes out, or None when the box is proved to
hold no satisfying point. Every atom is evaluated forwards and its bounds are then
propagated backwards through its terms (Benhamou et al., "Revising hull and box
consistency", 1999). Conjunctions are iterated, disjunctions give the hull of their
branches.
"""

from dataclasses import dataclass, field
from typing import TypeAlias, assert_never

from dl2c.interval.arithmetic import (
    INF,
    WHOLE,
    Box,
    Interval,
    compared,
    hull_of,
    meet,
    minus,
    negated,
    plus,
    quotients,
    root,
    times,
)
from dl2c.interval.nodes import Graph, Node
from dl2c.ir.logic import symbols
from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Truth,
)
from dl2c.work import spend

NONNEGATIVE = Interval(0.0, INF)

MOST_EFFECTS = 2**12
"""Of one part; beyond, all are forgotten."""

_Key: TypeAlias = tuple[int | Interval | None, ...]
"""How often conjunctions are gone through, and the ranges of the symbols of a part."""

_Effect: TypeAlias = tuple[Interval, ...] | None
"""The smaller ranges; None where nothing is left."""


@dataclass(frozen=True, slots=True)
class _Atom:
    op: Comparison
    left: Node
    right: Node


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A part, and what it makes of ranges of its symbols: among boxes that differ little, most ranges are
    met again.
    """

    part: "_Atom | _Some"
    symbols: tuple[Node, ...]
    effects: dict[_Key, _Effect] = field(default_factory=dict[_Key, _Effect])


@dataclass(frozen=True, slots=True)
class _All:
    parts: tuple["_Part", ...]


@dataclass(frozen=True, slots=True)
class _Some:
    parts: tuple["_Part", ...]


_Part: TypeAlias = "Truth | _Kept | _All"


@dataclass(frozen=True, slots=True)
class Contractor:
    """A formula made ready to contract many boxes that differ little."""

    graph: Graph
    part: _Part

    def contract(self, box: Box, rounds: int = 8) -> dict[Symbol, Interval] | None:
        """A box inside `box` that keeps every point satisfying the formula; None: there is none.

        Conjunctions are gone through at most `rounds` times, or until nothing changes.
        """
        spend()
        self.graph.assign(box)
        if not _narrow_part(self.part, self.graph, rounds):
            return None
        return {**box, **{s: node.value() for s, node in self.graph.symbols.items()}}


def contractor(formula: Formula) -> Contractor:
    """To contract boxes by a formula."""
    graph = Graph()
    return Contractor(graph, _part(formula, graph))


def contract(formula: Formula, box: Box, rounds: int = 8) -> dict[Symbol, Interval] | None:
    """What a `Contractor` of the formula makes of a box."""
    return contractor(formula).contract(box, rounds)


def _part(formula: Formula, graph: Graph) -> _Part:
    match formula:
        case Truth():
            return formula
        case Compare(op, left, right):
            return _kept(_Atom(op, graph.node(left), graph.node(right)), formula, graph)
        case And(children):
            return _All(tuple(_part(c, graph) for c in children))
        case Or(children):
            return _kept(_Some(tuple(_part(c, graph) for c in children)), formula, graph)
        case _:
            assert_never(formula)


def _kept(part: _Atom | _Some, formula: Formula, graph: Graph) -> _Kept:
    return _Kept(part, tuple(graph.symbols[s] for s in symbols(formula)))


# The functions below shrink the ranges of symbols and return False when nothing is left.


def _narrow_part(part: _Part, graph: Graph, rounds: int) -> bool:
    match part:
        case Truth(value):
            return value
        case _Kept():
            return _narrow_kept(part, graph, rounds)
        case _All(parts):
            for _ in range(rounds):
                before = graph.ranges()
                if not all(_narrow_part(child, graph, rounds) for child in parts):
                    return False
                if graph.ranges() == before:
                    break
            return True
        case _:
            assert_never(part)


def _narrow_kept(part: _Kept, graph: Graph, rounds: int) -> bool:
    key = (rounds, *[node.known for node in part.symbols])
    if key not in part.effects:
        return _narrow_anew(part, key, graph, rounds)
    after = part.effects[key]
    if after is None:
        return False
    for node, value in zip(part.symbols, after, strict=True):
        node.assign(value)
    return True


def _narrow_anew(part: _Kept, key: _Key, graph: Graph, rounds: int) -> bool:
    inner, effects = part.part, part.effects
    left = _narrow_atom(inner) if isinstance(inner, _Atom) else _narrow_some(inner, graph, rounds)
    if len(effects) >= MOST_EFFECTS:
        effects.clear()
    effects[key] = tuple([node.value() for node in part.symbols]) if left else None
    return left


def _narrow_some(part: _Some, graph: Graph, rounds: int) -> bool:
    """To the hull of what the parts leave each."""
    before = graph.ranges()
    branches: list[list[Interval]] = []
    for child in part.parts:
        graph.restore(before)
        if _narrow_part(child, graph, rounds):
            branches.append(graph.ranges())
    if branches:
        graph.restore([hull_of(ranges) for ranges in zip(*branches, strict=True)])
    return bool(branches)


def _narrow_atom(atom: _Atom) -> bool:
    left, right = atom.left, atom.right
    if compared(atom.op, left.value(), right.value()) == "false":
        return False
    if atom.op == "!=":
        return True
    if atom.op == "=":
        return _narrow(left, right.value()) and _narrow(right, left.value())
    small, large = (left, right) if atom.op in ("<", "<=") else (right, left)
    return _narrow(small, Interval(-INF, large.value().high)) and _narrow(
        large, Interval(small.value().low, INF)
    )


def _narrow(node: Node, target: Interval) -> bool:
    """Keep the points of the box at which the term is defined with a value in `target`."""
    value = node.value()
    if value.total and target.low <= value.low and value.high <= target.high:
        return not value.empty  # as every point of the box has such a value, none is lost further below
    kept = meet(value, target)
    if kept.empty:
        return False
    match node.term:
        case Number():
            return True
        case Symbol():
            node.assign(Interval(kept.low, kept.high))
            return True
        case term:
            return _narrow_operands(term, node.args, kept)


def _narrow_operands(
    term: Neg | Add | Sub | Mul | Div | Pow | Call, args: tuple[Node, ...], target: Interval
) -> bool:
    a, b = args[0], args[-1]
    match term:
        case Neg():
            return _narrow(a, negated(target))
        case Add():
            return _narrow(a, minus(target, b.value())) and _narrow(b, minus(target, a.value()))
        case Sub():
            return _narrow(a, plus(target, b.value())) and _narrow(b, minus(a.value(), target))
        case Mul() if a is b:
            return _narrow_power(a, 2, target)
        case Mul():
            return _narrow_factor(a, target, b.value()) and _narrow_factor(b, target, a.value())
        case Div():
            return _narrow(a, times(target, b.value())) and _narrow_factor(b, a.value(), target)
        case Pow(_, exponent):
            return _narrow_power(a, exponent, target)
        case Call("abs"):
            return _narrow_mirrored(a, meet(target, NONNEGATIVE))
        case Call("sqrt"):
            return _narrow(a, times(meet(target, NONNEGATIVE), meet(target, NONNEGATIVE)))
        case Call("min"):
            return _narrow_least(a, b, target) and _narrow_least(b, a, target)
        case Call("max"):
            return _narrow_greatest(a, b, target) and _narrow_greatest(b, a, target)
        case Call():
            return True
        case _:
            assert_never(term)


def _narrow_factor(factor: Node, product: Interval, other: Interval) -> bool:
    """factor * other = product. Nothing follows where `other` may be 0 and `product` too."""
    if product.contains(0.0) and other.contains(0.0):
        return _narrow(factor, WHOLE)
    return _narrow_pieces(factor, quotients(product, other))


def _narrow_power(base: Node, exponent: int, target: Interval) -> bool:
    if exponent % 2 == 0:
        target = meet(target, NONNEGATIVE)
        return not target.empty and _narrow_mirrored(base, root(target, exponent))
    pieces: list[Interval] = []
    if target.high >= 0:
        pieces.append(root(target, exponent))
    if target.low <= 0:
        pieces.append(negated(root(negated(target), exponent)))
    return _narrow_pieces(base, tuple(pieces))


def _narrow_mirrored(node: Node, size: Interval) -> bool:
    """|term| lies in `size`."""
    return _narrow_pieces(node, (negated(size), size))


def _narrow_pieces(node: Node, pieces: tuple[Interval, ...]) -> bool:
    """The term lies in one of the pieces."""
    value = node.value()
    reached = [kept for piece in pieces if not (kept := meet(value, piece)).empty]
    return bool(reached) and _narrow(node, hull_of(reached))


def _narrow_least(node: Node, other: Node, target: Interval) -> bool:
    """min(term, other) lies in `target`: the term is the minimum where the other one is too large."""
    is_least = other.value().low > target.high
    return _narrow(node, Interval(target.low, target.high if is_least else INF))


def _narrow_greatest(node: Node, other: Node, target: Interval) -> bool:
    """max(term, other) lies in `target`."""
    is_greatest = other.value().high < target.low
    return _narrow(node, Interval(target.low if is_greatest else -INF, target.high))
