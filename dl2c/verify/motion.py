"""The motion of a differential equation from one state: its solution as far as that is a polynomial of time,
what the text says of it, and facts that may hold all along.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from dl2c.diagnostics import CompileError
from dl2c.flows.solution import NotPolynomial, solve
from dl2c.ir.logic import conjuncts, disjunction, mapped, number, substituted, symbols, with_sides
from dl2c.ir.model import ONE, TRUE, ZERO, Add, Compare, Flow, Formula, Mul, Or, Pow, Sub, Symbol, Term
from dl2c.ir.polynomial import polynomial
from dl2c.parse import tree
from dl2c.verify.arithmetic.total import is_total
from dl2c.verify.states import State, Unsupported, formula_in, without_old

MAX_FACTS = 16
"""Facts about the start of a motion that may hold all along."""

Curves: TypeAlias = Mapping[Symbol, tuple[Term, ...]]
"""Coefficients of time."""


@dataclass(frozen=True, slots=True)
class Motion:
    """One ODE from one state: `start` has the first value of each symbol that moves, `domain` is H over these
    symbols, `rates` are theirs, `clock` is the time since the beginning, one of them; `state` is where it
    begins, H included. Where H cannot be expressed, `domain` is `true` and `bounded` False.
    """

    start: Mapping[Symbol, Term]
    rates: Mapping[Symbol, Term]
    domain: Formula
    state: State
    scope: Mapping[str, Term]
    moved: Mapping[str, Symbol]
    olds: Mapping[str, Term]
    clock: Symbol
    bounded: bool

    def initially(self, formula: Formula) -> Formula:
        """A formula about the symbols, where the motion begins."""
        return replaced(formula, self.start)


def replaced(formula: Formula, values: Mapping[Symbol, Term]) -> Formula:
    """A formula with symbols replaced; atoms between numbers are decided."""
    return mapped(formula, lambda t: substituted(t, values))


def motion_formula(written: tree.Formula, motion: Motion) -> Formula | None:
    """A formula of the text over what moves, `old(x)` being where it began; None where there is no such."""
    try:
        opened = without_old(written)
        scope = {**motion.scope, **motion.olds, **_speeds(motion)}
        return formula_in(opened, replace(motion.state, store=scope))
    except (Unsupported, CompileError):
        return None


def _speeds(motion: Motion) -> dict[str, Term]:
    """The rates of what the equation changes; x' of any other x is what it was before."""
    return {f"{x}'": motion.rates[s] for x, s in motion.moved.items()}


# The solution ------------------------------------------------------------------------------


def curves_of(motion: Motion, defined: set[Symbol]) -> dict[Symbol, tuple[Term, ...]]:
    """The coefficients of time of every symbol whose motion is a polynomial. Only rates of `defined` symbols
    have values wherever the domain holds.
    """
    left = dict(motion.rates)
    _without(left, motion, motion.rates.keys() - defined)
    while left:
        equations = tuple((s.name, rate) for s, rate in left.items())
        found = solve(Flow(equations, TRUE, TRUE, (), None))
        if not isinstance(found, NotPolynomial):
            return {s: tuple(substituted(c, motion.start) for c in found.variables[s.name]) for s in left}
        _without(left, motion, {s for s in left if s.name == found.variable})
    return {}


def _without(left: dict[Symbol, Term], motion: Motion, lost: set[Symbol]) -> None:
    """Leave out symbols, and those whose rates depend on any that is left out."""
    while lost:
        for s in lost:
            left.pop(s, None)
        lost = {s for s, rate in left.items() if symbols(rate) & (motion.rates.keys() - left.keys())}


def instant(motion: Motion, curves: Curves) -> dict[Symbol, Term]:
    """The values of what moves as polynomials of time, in terms of the clock."""
    return {s: _at(c, motion.clock) for s, c in curves.items() if s != motion.clock}


def _at(coefficients: Sequence[Term], time: Term) -> Term:
    """The value of a polynomial of time."""
    result: Term = coefficients[0]
    for k, c in enumerate(coefficients[1:], 1):
        if c != ZERO:
            result = Add(result, Mul(c, Pow(time, k) if k > 1 else time))
    return result


def on_the_way(motion: Motion, curves: Curves) -> Iterator[Formula]:
    """That time does not run back, and what the domain says between start and end: for conjuncts of degree 2
    in time, at their vertex."""
    duration = motion.clock
    yield Compare(">=", duration, ZERO)
    along = {s: tuple(c) for s, c in curves.items()}
    for atom in conjuncts(motion.domain):
        if not isinstance(atom, Compare) or symbols(atom) & (motion.rates.keys() - curves.keys()):
            continue
        sides = (atom.right, atom.left) if atom.op in ("<", "<=") else (atom.left, atom.right)
        margin = polynomial(Sub(*sides), along)
        if margin is None or not is_total(*margin):
            continue
        if atom.op == "=":
            still = Compare("=", duration, ZERO)
            yield from (disjunction([still, Compare("=", c, ZERO)]) for c in margin[1:])
        elif atom.op != "!=" and len(margin) == 3:
            yield _vertex(margin, duration, ">" if atom.op in ("<", ">") else ">=")


def _vertex(margin: Sequence[Term], duration: Symbol, op: str) -> Or:
    """c0 + c1 t + c2 t^2 is not negative where it is least, if that is on the way."""
    c0, c1, c2 = margin
    two, four = number(2), number(4)
    least = Sub(Mul(four, Mul(c0, c2)), Pow(c1, 2))
    return Or(
        (
            Compare("<=", c2, ZERO),
            Compare(">=", c1, ZERO),
            Compare("<=", Add(Mul(two, Mul(c2, duration)), c1), ZERO),
            Compare(">" if op == ">" else ">=", least, ZERO),
        )
    )


# What may hold all along -------------------------------------------------------------------


def facts_that_move(motion: Motion) -> list[Formula]:
    """What is known of the state where the motion begins, said of all its states; the last first."""
    moving = {value: s for s, value in motion.start.items() if isinstance(value, Symbol)}
    found = [with_sides(f, lambda t: substituted(t, moving)) for f in reversed(motion.state.facts)]
    return [f for f in found if symbols(f) & motion.rates.keys()][:MAX_FACTS]


def facts_until_now(motion: Motion) -> list[Formula]:
    """What is known of the whole time that the domain allows, said of the time that has passed.

    Where the domain says `t <= ep`, guards speak of ep, the worst case. Of t they say what holds at every
    instant, which is often a step of the proof.
    """
    found: dict[Formula, None] = {}
    for clock, limit in _time_limits(motion):
        for fact in motion.state.facts:
            names = symbols(fact)
            if limit in names and len(names) > 2:
                found.setdefault(with_sides(fact, lambda t, now={limit: clock}: substituted(t, now)))
    return list(found)[-MAX_FACTS:]


def _time_limits(motion: Motion) -> Iterator[tuple[Symbol, Symbol]]:
    """Clocks of the motion, each with a constant that it may not exceed."""
    for atom in conjuncts(motion.domain):
        match atom:
            case Compare("<=" | "<", Symbol() as clock, Symbol() as limit) | Compare(
                ">=" | ">", Symbol() as limit, Symbol() as clock
            ) if motion.rates.get(clock) == ONE and limit not in motion.rates:
                yield clock, limit
            case _:
                pass
