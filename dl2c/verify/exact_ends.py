"""The ends of a program's runs, described exactly, so that an assumption about all of them can be used.

`[a] F` says F of each end of a run. It is used as: whatever the values and durations that `a` leaves open, if
the tests and domains on the way hold, then F at the end. That is the assumption itself only where these
conditions are exact: for solutions that are polynomials of time, in domains whose conditions are linear in
time, so that they hold all the way if they hold at both ends.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from dl2c.ir.logic import conjuncts, disjunction, negation, symbols
from dl2c.ir.model import TRUE, ZERO, Compare, Formula, Sub, Symbol
from dl2c.ir.polynomial import polynomial
from dl2c.parse import tree
from dl2c.verify.arithmetic.total import is_total
from dl2c.verify.flows import Flows
from dl2c.verify.motion import Curves, Motion, instant, replaced
from dl2c.verify.states import Names, State, Unsupported, formula_in, loses_a_reading, term_in

MOST = 8
"""Ends of one program that are looked at."""


@dataclass(frozen=True, slots=True)
class End:
    """A state after a program; its facts are the conditions on the way, over the `open` symbols too."""

    state: State
    open: frozenset[Symbol]


@dataclass(slots=True)
class ExactEnds:
    """Follows programs whose runs can be described exactly. Its methods raise `Unsupported`."""

    flows: Flows
    names: Names

    def clauses(self, box: tree.Box, state: State) -> Iterator[tuple[frozenset[Symbol], Formula]]:
        """What a box says of each way through its program: open symbols, and a formula over them."""
        ends = list(self._ends(box.program, End(replace(state, facts=()), frozenset())))
        for end in ends[:MOST]:
            found = _exactly(box.child, end.state)
            if not is_total(found, *end.state.facts):
                raise Unsupported("a condition that may be undefined", box.span)
            yield end.open, disjunction([*map(negation, end.state.facts), found])

    def _ends(self, program: tree.Program, begun: End) -> Iterator[End]:
        state = begun.state
        match program:
            case tree.Assign(name, term, False, span=span):
                value = term_in(term, state)
                if not is_total(value):
                    raise Unsupported("a value that may be undefined", span)
                yield replace(begun, state=state.having({name: value}))
            case tree.AssignAny(name, False):
                value = self.names.fresh(name)
                yield End(state.having({name: value}), begun.open | {value})
            case tree.Test(formula):
                known = state.where(_exactly(formula, state))
                if known is not None:
                    yield replace(begun, state=known)
            case tree.Compose(left, right):
                for middle in self._ends(left, begun):
                    yield from self._ends(right, middle)
            case tree.Choice(left, right):
                yield from self._ends(left, begun)
                yield from self._ends(right, begun)
            case tree.ODESystem():
                yield from self._motion(program, begun)
            case _:
                raise Unsupported("a program whose runs are not described exactly", program.span)

    def _motion(self, ode: tree.ODESystem, begun: End) -> Iterator[End]:
        _exactly(ode.domain, begun.state)
        motion = self.flows.motion(ode, begun.state, self.names)
        if motion is None:
            return
        whole = is_total(*motion.rates.values(), *motion.start.values(), motion.domain)
        curves: Curves = self.flows.curves(motion) if whole else {}
        if not motion.bounded or len(curves) < len(motion.rates) or not _is_linear(motion, curves):
            raise Unsupported("a motion that is not described exactly", ode.span)
        values = instant(motion, curves)
        end = motion.state.where(Compare(">=", motion.clock, ZERO), replaced(motion.domain, values))
        if end is not None:
            store = {x: values.get(s, s) for x, s in motion.moved.items()}
            yield End(end.having(store), begun.open | {motion.clock})


def _exactly(formula: tree.Formula, state: State) -> Formula:
    """A condition that says the same under both readings of undefined terms."""
    if loses_a_reading(formula, state):
        raise Unsupported("a quantifier over terms that may be undefined", formula.span)
    return formula_in(formula, state)


def _is_linear(motion: Motion, curves: Curves) -> bool:
    """Whether the domain holds all the way if it holds at both ends."""
    along = {s: tuple(c) for s, c in curves.items()}
    for atom in conjuncts(motion.domain):
        if atom == TRUE or not symbols(atom) & motion.rates.keys():
            continue
        if not isinstance(atom, Compare) or atom.op == "!=":
            return False
        margin = polynomial(Sub(atom.left, atom.right), along)
        if margin is None or len(margin) > 2:
            return False
    return True
