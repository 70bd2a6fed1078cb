"""What a proof promises of every state after a step, evaluated exactly at the doubles of a run.

The postcondition and the invariants of a problem come in; how far a state misses them goes out, decided with
fractions (auditor.py). A miss is the least of a few tolerances, relative to the terms of an atom, with which
it is none: equalities are met by rounded numbers, and within the tolerance of the solver, or not at all.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from oracles.initial_states import verdict

from dl2c.ir.logic import atoms, conjunction, operands
from dl2c.ir.model import TRUE, Call, Formula, Model, Symbol, Term
from dl2c.ir.slack import relaxed
from dl2c.lower.invariant import invariant
from dl2c.pipeline import Compilation

ULPS = Fraction(1, 2**50)
MISSES = (Fraction(0), ULPS, Fraction(1, 10**12), Fraction(1, 10**9), Fraction(1, 10**6))
FURTHER = Fraction(1)
ALGEBRAIC = {"abs", "min", "max", "sqrt"}


@dataclass(frozen=True)
class Promise:
    """What holds after each step of a model, if its proof is one."""

    model: Model
    formula: Formula

    @cached_property
    def _names(self) -> list[Symbol]:
        variables = [Symbol(v.name, "variable") for v in self.model.variables]
        return [*variables, *(Symbol(c.name, "constant") for c in self.model.constants)]

    @cached_property
    def _looser(self) -> list[tuple[Fraction, Formula]]:
        return [(miss, relaxed(self.formula, miss)) for miss in MISSES]

    def missed(self, x: Iterable[float], p: Iterable[float]) -> Fraction:
        """By how much the state misses it: one of `MISSES`, or `FURTHER`. What is not decided is met."""
        exact = [Fraction(v) for v in (*x, *p)]
        state = {s: (v, v) for s, v in zip(self._names, exact, strict=True)}
        return next((miss for miss, f in self._looser if verdict(f, state) != "no"), FURTHER)


def promise_of(found: Compilation) -> Promise | None:
    """None where nothing is proved of a box and all constants, or nothing that has exact arithmetic."""
    model = found.planned.build.model
    shape, some = found.resolved.problem.shape, found.resolved.problem.existential
    if some or model.postcondition is None or shape.postcondition is None:
        return None
    formula = conjunction([model.postcondition, invariant(found.resolved.problem) or TRUE])
    sides = [side for atom in atoms(formula) for side in (atom.left, atom.right)]
    return Promise(model, formula) if all(map(_is_algebraic, sides)) else None


def _is_algebraic(term: Term) -> bool:
    known = not isinstance(term, Call) or term.function in ALGEBRAIC
    return known and all(map(_is_algebraic, operands(term)))


def told(misses: Sequence[Fraction]) -> str:
    """The largest of them in words; of none, nothing."""
    if not misses:
        return ""
    largest = max(misses)
    if largest in (0, ULPS):
        return "ulps" if largest else "exact"
    return f"{float(largest):g}" if largest != FURTHER else "missed"
