"""Runs of one differential equation, exactly: solutions that are polynomials of time, and germs of others.

A polynomial that satisfies the equations, and the domain at all instants, is a run whatever else there is;
so it does not matter how it was found. Of the package only the constructors of syntax trees are used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from oracles.exact_numbers import Unclear, Undefined
from oracles.exact_time import ZERO, Poly
from oracles.exact_values import State, evaluate, throughout, truth

from dl2c.parse import tree

ORDER = 12
"""Coefficients of a germ beyond the first."""
LARGEST = 16
"""Degrees of polynomials."""


class Stuck(Exception):
    """A test or a domain fails, or a value is undefined: there is no such run."""


@dataclass(frozen=True)
class Flow:
    """How long a flow lasts; `solution` has coefficients by power of time where the equations do not say."""

    time: Fraction
    solution: Mapping[str, Sequence[Fraction | int]] = field(default_factory=dict[str, Sequence[Fraction]])


@dataclass(frozen=True)
class Moment:
    """So short a time that no sign changes any more: the state after it is a germ."""


def after(ode: tree.ODESystem, state: State, flow: Flow | Moment) -> State:
    """The state after a flow. Raises `Stuck` where the domain forbids it, `Unclear`."""
    if not truth(ode.domain, state):
        raise Stuck("the domain does not hold where the flow begins")
    try:
        if isinstance(flow, Moment):
            return _moment(ode, state)
        if flow.time == 0:
            return state
        moving = motion(ode, state, flow)
    except Undefined as problem:
        raise Stuck(f"a rate is undefined: {problem}") from None
    if not throughout(ode.domain, {**state, **moving}, flow.time):
        raise Stuck("the domain does not hold all the time")
    return {**state, **{name: track.at(flow.time) for name, track in moving.items()}}


def motion(ode: tree.ODESystem, state: State, flow: Flow) -> dict[str, Poly]:
    """What changes, as polynomials on [0, time]; by iteration from the constant ones, or as given."""
    rates = equations(ode)
    start = {name: _constant(state[name], flow.time) for name in rates}
    if flow.solution:
        given = {n: start[n]._with([Fraction(x) for x in flow.solution[n]]) for n in rates}
        slopes = _evaluated(rates, state, given)
        if any(given[n].at(ZERO) != state[n] or given[n].derivative() != slopes[n] for n in rates):
            raise Stuck("this is no solution")
        return given
    found = start
    for _ in range(len(rates) + 3):
        slopes = _evaluated(rates, state, found)
        following = {name: start[name] + slopes[name].integral() for name in rates}
        if following == found:
            return found
        if any(len(track.c) > LARGEST for track in following.values()):
            break
        found = following
    raise Unclear("motion that is no polynomial of time")


def equations(ode: tree.ODESystem) -> dict[str, tree.Term]:
    if not all(isinstance(e, tree.AtomicODE) for e in ode.equations):
        raise Unclear("a symbol for a differential equation")
    return {e.name: e.term for e in ode.equations if isinstance(e, tree.AtomicODE)}


def _constant(value: Any, until: Fraction | None, order: int = 0) -> Poly:
    if not isinstance(value, Fraction):
        raise Unclear("motion from what is no rational number")
    return Poly((), order, until) + value


def _evaluated(rates: Mapping[str, tree.Term], state: State, tracks: Mapping[str, Poly]) -> dict[str, Poly]:
    inside = {**state, **tracks}
    return {name: tracks[name]._lifted(evaluate(term, inside)) for name, term in rates.items()}


def _moment(ode: tree.ODESystem, state: State) -> State:
    """By power series; a rate that is not analytic where the flow begins is `Unclear`."""
    rates = equations(ode)
    start = {name: _constant(state[name], None, ORDER) for name in rates}
    found = start
    for _ in range(ORDER + 2):
        slopes = _evaluated(rates, state, found)
        before, found = found, {name: start[name] + slopes[name].integral() for name in rates}
    if found != before:
        raise Unclear("a series that does not settle")
    still = {n: state[n] for n, term in rates.items() if evaluate(term, state) == 0 and _plain(term)}
    later = {**state, **found, **still}
    if not truth(ode.domain, later):
        raise Stuck("the domain does not hold just after the flow begins")
    return later


def _plain(term: tree.Term) -> bool:
    """Whether a term is a number, so that what has it as rate and does not move now never will."""
    return isinstance(term, tree.Number)
