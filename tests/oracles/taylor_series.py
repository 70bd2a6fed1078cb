"""Power series of the terms of an ODE at 32 digits, coefficient by coefficient."""

from dataclasses import dataclass, field

import mpmath
from mpmath import mpf

from dl2c.ir.logic import operands
from dl2c.ir.model import Call, Div, Mul, Neg, Number, Pow, Symbol, Term

context = mpmath.mp.clone()
context.dps = 32


class Singular(Exception):
    """The solution ends, or a term of its equations has no value."""


def dot(a: list[mpf], b: list[mpf]) -> mpf:
    """a[0]*b[n-1] + ... + a[n-1]*b[0]"""
    return context.fdot(zip(a, reversed(b), strict=True))


def slopes(a: list[mpf], k: int) -> list[mpf]:
    """1*a[1], ..., k*a[k]"""
    return [i * a[i] for i in range(1, k + 1)]


@dataclass
class Node:
    """A term as a power series that grows by one coefficient at a time."""

    term: Term
    parts: tuple["Node", ...]
    c: list[mpf] = field(default_factory=list)
    other: list[mpf] = field(default_factory=list)
    """Of the cosine of a sine, and the other way round."""

    def grow(self) -> None:
        k = len(self.c)
        series = [p.c for p in self.parts]
        match self.term:
            case Number(exact):
                first = context.mpf(exact.numerator) / exact.denominator
                self.c.append(first if k == 0 else context.mpf(0))
            case Symbol():
                assert k > 0 and len(self.c) == k, "the integration sets these"
            case Neg():
                self.c.append(-series[0][k])
            case Div():
                a, b = series
                if b[0] == 0:
                    raise Singular
                self.c.append((a[k] - dot(b[1 : k + 1], self.c)) / b[0])
            case Call("sqrt"):
                self.c.append(self._root(series[0], k))
            case Call("exp"):
                (a,) = series
                self.c.append(context.exp(a[0]) if k == 0 else dot(slopes(a, k), self.c) / k)
            case Call("sin" | "cos" as name):
                self._turn(series[0], k, name)
            case _:
                self._algebra(series, k)

    def _algebra(self, series: list[list[mpf]], k: int) -> None:
        a, b = series
        match type(self.term).__name__:
            case "Add":
                self.c.append(a[k] + b[k])
            case "Sub":
                self.c.append(a[k] - b[k])
            case "Mul":
                self.c.append(dot(a[: k + 1], b[: k + 1]))
            case name:
                raise AssertionError(name)

    def _root(self, a: list[mpf], k: int) -> mpf:
        if a[0] <= 0:
            raise Singular
        if k == 0:
            return context.sqrt(a[0])
        return (a[k] - dot(self.c[1:k], self.c[1:k])) / (2 * self.c[0])

    def _turn(self, a: list[mpf], k: int, name: str) -> None:
        sines, cosines = (self.c, self.other) if name == "sin" else (self.other, self.c)
        if k == 0:
            sines.append(context.sin(a[0]))
            cosines.append(context.cos(a[0]))
            return
        s = dot(slopes(a, k), cosines) / k
        c = -dot(slopes(a, k), sines) / k
        sines.append(s)
        cosines.append(c)


def nodes_of(terms: list[Term]) -> tuple[list[Node], list[Node]]:
    """One node for each subterm, operands first, and the nodes of the terms themselves."""
    made: dict[Term, Node] = {}

    def visit(term: Term) -> Node:
        if isinstance(term, Pow):
            parts = (visit(term.base),)
            product = parts[0]
            for n in range(2, term.exponent + 1):
                known = Pow(term.base, n)
                made[known] = product = made.get(known) or Node(
                    Mul(term.base, term.base), (product, parts[0])
                )
            return product
        if term not in made:
            parts = tuple(visit(t) for t in operands(term))
            made[term] = Node(term, parts)
        return made[term]

    tops = [visit(t) for t in terms]
    return list(made.values()), tops
