"""Functions that are defined by differential equations, solved by those of the library.

Comes in: an implicit definition. Goes out: its value at any time as a term, or None where no
solution is known. Solved are linear motion, growth, rotation, and the equations by which the
library itself is defined.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import TypeAlias

from dl2c.ir import model as ir
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import subterms, with_term
from dl2c.ir.printer import print_term
from dl2c.parse import tree
from dl2c.parse.parser import parse_term
from dl2c.resolve.symbols import mentioned, nodes

Solution: TypeAlias = Callable[[tree.Term], tree.Term]
"""The value at a time."""

Factor: TypeAlias = tuple[Fraction, tree.Term | None]
"""A number, and what it is multiplied by."""

ZERO, ONE = parse_term("0"), parse_term("1")


def solve(function: tree.Declaration, expanded: Solution) -> Solution | None:
    """The solution of `function`, an implicit definition with one parameter.

    `expanded` is applied to the terms of the definition, and leaves what moves in them as it is.
    """
    assert function.implicit and function.parameters
    time = function.parameters[0].name
    start = {n.name: expanded(n.term) for n in nodes(function.body) if isinstance(n, tree.Assign)}
    rates = {n.name: expanded(n.term) for n in nodes(function.body) if isinstance(n, tree.AtomicODE)}
    if start.pop(time, ZERO) != ZERO or rates.pop(time, ONE) != ONE:
        return None
    names = _needed(function.name, rates)
    if len(names) > 2 or any(n not in start or set(mentioned(start[n])) & {*rates, time} for n in names):
        return None
    system = [(start[name], rates[name]) for name in names]
    return _of_library(system, names, time) or _linear(system, names, frozenset({*names, time}))


def _needed(first: str, rates: dict[str, tree.Term]) -> list[str]:
    """The variables that the motion of the first depends on, the first before them."""
    found = {first: None}
    waiting = [first]
    while waiting:
        more = [n for n in mentioned(rates[waiting.pop()]) if n in rates and n not in found]
        found |= dict.fromkeys(more)
        waiting += dict.fromkeys(more)
    return list(found)


def _of_library(system: list[tuple[tree.Term, tree.Term]], names: list[str], time: str) -> Solution | None:
    """A function with poles goes on after the first one, where its differential equation ends."""
    for known, row in FUNCTIONS.items():
        if not row.has_poles and system == _equations(known, names, time):
            return lambda at: tree.FuncOf(known, (at,), span=at.span)
    return None


def _equations(function: str, names: list[str], time: str) -> list[tuple[tree.Term, tree.Term]]:
    """The values at time 0 and the rates of a function and of the one that its rate needs, as variables of
    these `names`; nothing where there are fewer or more.
    """
    slope, at = FUNCTIONS[function].slope, ir.Symbol(time, "time")
    if slope is None:
        return []
    first = ir.Call(function, (at,))
    calls = [first, *(t for t in subterms(slope(first, at)) if isinstance(t, ir.Call) and t.args == (at,))]
    calls = list(dict.fromkeys(calls))
    if len(calls) != len(names):
        return []
    found: list[tuple[tree.Term, tree.Term]] = []
    for call in calls:
        row = FUNCTIONS[call.function]
        assert row.slope is not None
        rate = row.slope(call, at)
        for other, name in zip(calls, names, strict=True):
            rate = with_term(rate, other, ir.Symbol(name, "variable"))
        found.append((parse_term(f"{row.value(0.0):g}"), parse_term(print_term(rate))))
    return found


def _linear(
    system: list[tuple[tree.Term, tree.Term]], names: list[str], moving: frozenset[str]
) -> Solution | None:
    """Of `f' = c`, `f' = k*f` and `f' = k*g, g' = -k*f`."""
    (start, rate), *others = system
    if not others and _is_constant(rate, moving):
        return lambda at: tree.Plus(start, tree.Times(rate, at))
    factor = _factor(rate, names[-1], moving)
    if factor is None:
        return None
    speed = _as_term(factor)
    if not others:
        return lambda at: tree.Times(start, tree.FuncOf("exp", (tree.Times(speed, at),)))
    other, back = others[0]
    if _factor(back, names[0], moving) != (-factor[0], factor[1]):
        return None
    return lambda at: tree.Plus(
        tree.Times(start, tree.FuncOf("cos", (tree.Times(speed, at),))),
        tree.Times(other, tree.FuncOf("sin", (tree.Times(speed, at),))),
    )


def _is_constant(term: tree.Term, moving: frozenset[str]) -> bool:
    return moving.isdisjoint(mentioned(term))


def _factor(term: tree.Term, name: str, moving: frozenset[str]) -> Factor | None:
    """The constant k where the term is k times the variable; None where it is not."""
    match term:
        case tree.Variable(other) if other == name:
            return Fraction(1), None
        case tree.Neg(child):
            return _scaled(_factor(child, name, moving), tree.Neg(ONE))
        case tree.Times(left, right) if _is_constant(left, moving):
            return _scaled(_factor(right, name, moving), left)
        case tree.Times(left, right) if _is_constant(right, moving):
            return _scaled(_factor(left, name, moving), right)
        case tree.Divide(left, right) if _is_constant(right, moving):
            return _scaled(_factor(left, name, moving), tree.Divide(ONE, right))
        case _:
            return None


def _scaled(factor: Factor | None, by: tree.Term) -> Factor | None:
    if factor is None:
        return None
    number, rest = factor
    match by:
        case tree.Number(value):
            return number * value, rest
        case tree.Neg(child):
            return _scaled((-number, rest), child)
        case tree.Divide(tree.Number(above), tree.Number(below)) if below:
            return number * above / below, rest
        case _:
            return number, by if rest is None else tree.Times(rest, by)


def _as_term(factor: Factor) -> tree.Term:
    number, rest = factor
    size: tree.Term = tree.Number(abs(number))
    term = size if rest is None else rest if size == ONE else tree.Times(size, rest)
    return tree.Neg(term) if number < 0 else term
