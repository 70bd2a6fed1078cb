"""Enclosures of many terms over boxes that change little by little.

Terms come in and become nodes of a graph, equal parts one node. A node keeps its enclosure until a symbol
below it changes. What it encloses is what `arithmetic.evaluate` gives.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import assert_never

from dl2c.interval.arithmetic import OPERATIONS, Box, Interval, applied, enclosure, negated, power
from dl2c.ir.model import Binary, Call, Mul, Neg, Number, Pow, Symbol, Term


@dataclass(slots=True, eq=False)
class Node:
    """A term: what it is computed from and how, and its enclosure where that is known."""

    term: Term
    args: tuple["Node", ...]
    compute: Callable[..., Interval]
    known: Interval | None = None
    above: list["Node"] = field(default_factory=list["Node"])

    def value(self) -> Interval:
        """An enclosure over the present box."""
        if self.known is None:
            self.known = self.compute(*[a.value() for a in self.args])
        return self.known

    def assign(self, value: Interval) -> None:
        """Give a symbol another range."""
        now = self.known
        if now is None or now.low != value.low or now.high != value.high or now.total != value.total:
            self.known = value
            self.forget()

    def forget(self) -> None:
        """What depends on this node is not known any more."""
        for node in self.above:
            if node.known is not None:
                node.known = None
                node.forget()


@dataclass(slots=True, eq=False)
class Graph:
    """The nodes of terms."""

    nodes: dict[Term, Node] = field(default_factory=dict[Term, Node])
    symbols: dict[Symbol, Node] = field(default_factory=dict[Symbol, Node])

    def node(self, term: Term) -> Node:
        """The node of a term."""
        found = self.nodes.get(term)
        if found is None:
            found = self.nodes[term] = self._made(term)
            for operand in found.args:
                operand.above.append(found)
            if isinstance(term, Symbol):
                self.symbols[term] = found
        return found

    def _made(self, term: Term) -> Node:
        match term:
            case Number(value):
                return Node(term, (), partial(enclosure, value))
            case Symbol():
                return Node(term, (), _unassigned)
            case Neg(child):
                return Node(term, (self.node(child),), negated)
            case Mul(left, right) if left == right:
                return Node(term, (self.node(left),), partial(_raised, 2))
            case Binary():
                return Node(term, (self.node(term.left), self.node(term.right)), OPERATIONS[type(term)])
            case Pow(base, exponent):
                return Node(term, (self.node(base),), partial(_raised, exponent))
            case Call(function, args):
                return Node(term, tuple(self.node(a) for a in args), lambda *a: applied(function, a))
            case _:
                assert_never(term)

    def assign(self, box: Box) -> None:
        """Go to another box, which has every symbol."""
        for symbol, node in self.symbols.items():
            node.assign(box[symbol])

    def ranges(self) -> list[Interval]:
        """The present box, in the order of `symbols`."""
        return [node.value() for node in self.symbols.values()]

    def restore(self, ranges: Sequence[Interval]) -> None:
        """Go to a box as `ranges` gives it."""
        for node, value in zip(self.symbols.values(), ranges, strict=True):
            node.assign(value)


def _unassigned() -> Interval:
    raise AssertionError("a symbol has no range before it is assigned one")


def _raised(exponent: int, base: Interval) -> Interval:
    return power(base, exponent)
