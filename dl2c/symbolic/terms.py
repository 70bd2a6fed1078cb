"""IR terms and formulas as CasADi SX expressions.

CasADi's own simplifications would change rounding and drop definedness (`x/x` to 1,
`x/y*y` to x), so graphs are built with them switched off: every IR operation becomes
exactly one operation (a power, its multiplications).

A formula becomes an expression that is 1 where it holds and 0 elsewhere. Conditions for
definedness are part of each atom: the value of both sides must be finite, and so must
every operand behind which an infinity could disappear (semantics 5). What the bounds of
the episode constants and the largest state value already prove is left out.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias, assert_never

import casadi as untyped_casadi

from dl2c.interval.arithmetic import Interval, enclosure
from dl2c.interval.arithmetic import evaluate as enclose
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import ARITHMETIC, COMPARISONS, fold, operands, symbols
from dl2c.ir.model import LARGEST_STATE, Binary, Call, Compare, Div, Formula, Neg, Number, Pow, Symbol, Term
from dl2c.symbolic.exclusive import CASADI

casadi: Any = untyped_casadi
"""CasADi publishes no types."""

Graph: TypeAlias = Any
"""A casadi.SX scalar."""

LARGEST = 1.7976931348623157e308
"""The largest double."""

STATE = Interval(-enclosure(LARGEST_STATE).high, enclosure(LARGEST_STATE).high)
"""Where every variable and input lies."""

casadi.GlobalOptions.setSimplificationOnTheFly(False)


@dataclass(slots=True)
class Builder:
    """Builds graphs over one set of input symbols. `constants` encloses the episode constants, `state` all
    other symbols; what stays below `largest` is finite.
    """

    constants: Mapping[Symbol, Interval] = field(default_factory=dict[Symbol, Interval])
    state: Interval = STATE
    largest: float = LARGEST
    inputs: dict[Symbol, Graph] = field(default_factory=dict[Symbol, Graph])
    known: dict[int, tuple[Term, Graph]] = field(default_factory=dict[int, tuple[Term, Graph]])

    def __del__(self) -> None:
        with CASADI:
            self.inputs.clear()
            self.known.clear()

    def term(self, term: Term) -> Graph:
        """The graph of a term; equal objects give one node."""
        if (seen := self.known.get(id(term))) is not None:
            return seen[1]
        graph = self._term(term)
        self.known[id(term)] = (term, graph)
        return graph

    def _term(self, term: Term) -> Graph:
        match term:
            case Number(value):
                return casadi.SX(float(value))
            case Symbol(name):
                return self.inputs.setdefault(term, casadi.SX.sym(name))
            case Neg(child):
                return -self.term(child)
            case Binary():
                return ARITHMETIC[type(term)](self.term(term.left), self.term(term.right))
            case Pow(base, exponent):
                return _power(self.term(base), exponent)
            case Call(function, args):
                return getattr(casadi, FUNCTIONS[function].casadi)(*map(self.term, args))
            case _:
                assert_never(term)

    def holds(self, formula: Formula) -> Graph:
        """The graph of a formula's truth."""
        return fold(
            formula, _truth, self._atom, lambda parts: _all(list(parts)), lambda parts: _any(list(parts))
        )

    def _atom(self, atom: Compare) -> Graph:
        verdict = COMPARISONS[atom.op](self.term(atom.left), self.term(atom.right))
        return _all([verdict, *self.defined(atom.left), *self.defined(atom.right)])

    def all_defined(self, terms: Iterable[Term]) -> Graph:
        """Whether every term has a finite value with finite, defined subterms."""
        return _all([c for t in terms for c in self.defined(t)])

    def defined(self, term: Term) -> list[Graph]:
        """Conditions under which the term and all its subterms are defined and finite; none if always."""
        conditions: list[Graph] = []
        if not self._surely_finite(term):
            conditions.append(_finite(self.term(term)))
        for part in _absorbing(term):
            if not self._surely_finite(part):
                conditions.append(_finite(self.term(part)))
        return conditions

    def _surely_finite(self, term: Term) -> bool:
        """Proved from the constants' bounds, or as finite as the state is."""
        match term:
            case Number() | Symbol():
                return True
            case Neg(child) | Call("abs", (child,)):
                return self._surely_finite(child)
            case Call("min" | "max", (left, right)):
                return self._surely_finite(left) and self._surely_finite(right)
            case _:
                box = {s: self.constants.get(s, self.state) for s in symbols(term)}
                value = enclose(term, box)
                return value.total and not value.empty and abs(value.low) <= self.largest >= abs(value.high)


def _absorbing(term: Term) -> Iterator[Term]:
    """Subterms whose infinity or NaN the value of `term` need not show."""
    for part in operands(term):
        yield from _absorbing(part)
    match term:
        case Div(_, divisor):
            yield divisor
        case Call(function, args) if not FUNCTIONS[function].shows_infinity:
            yield from args
        case _:
            pass


def _finite(graph: Graph) -> Graph:
    return casadi.fabs(graph) <= LARGEST


def _truth(value: bool) -> Graph:
    return casadi.SX(1.0 if value else 0.0)


def _all(graphs: Iterable[Graph]) -> Graph:
    """Their conjunction; constants are absorbed."""
    result = _truth(True)
    for graph in graphs:
        if graph.is_zero():
            return graph
        if not graph.is_one():
            result = graph if result.is_one() else casadi.logic_and(result, graph)
    return result


def _any(graphs: Iterable[Graph]) -> Graph:
    """Their disjunction; constants are absorbed."""
    result = _truth(False)
    for graph in graphs:
        if graph.is_one():
            return graph
        if not graph.is_zero():
            result = graph if result.is_zero() else casadi.logic_or(result, graph)
    return result


def _power(base: Graph, exponent: int) -> Graph:
    if exponent == 1:
        return base
    if exponent % 2:
        return base * _power(base, exponent - 1)
    half = _power(base, exponent // 2)
    return half * half
