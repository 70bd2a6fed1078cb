"""A straight line of statements up to a cut point: its inputs, and the tests that none of them decides.

Comes in: assignments, inputs and tests, as the interpreter goes through them. Tests of inputs are
written over the state where the line begins; all others are evaluated where they stand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dl2c.interp.lines import Straight
from dl2c.ir.evaluate import Valuation, Value, truth, value_of
from dl2c.ir.logic import conjunction, conjuncts, mapped, substituted, symbols
from dl2c.ir.model import Assign, AssignAny, Evolve, Formula, Symbol, Term, Test
from dl2c.paths.admission import Admission, Unknown, admissions

Box = Mapping[str, tuple[Fraction, Fraction]]
"""The limits of inputs by key."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The inputs of a line in program order, and what may be given to them."""

    unknowns: tuple[Unknown, ...] = ()
    admissions: tuple[Admission, ...] = ()


def planned(line: Sequence[Straight], limits: Box) -> Plan:
    """The inputs of a line."""
    if not any(isinstance(s, AssignAny) for s in line):
        return Plan()
    values: dict[Symbol, Term] = {}
    tests: list[Formula] = []
    keys: list[str] = []
    for statement in line:
        match statement:
            case Assign(name, term):
                values[Symbol(name, "variable")] = substituted(term, values)
            case AssignAny(name, key):
                values[Symbol(name, "variable")] = Symbol(key, "input")
                keys += [key] if key not in keys else []
            case Test(formula):
                tests.append(mapped(formula, lambda term: substituted(term, values)))
            case Evolve():
                raise AssertionError("the domain of a flow counts as a test")
    unknowns = tuple(Unknown(Symbol(key, "input"), *limits[key]) for key in keys)
    _, found = admissions(conjunction(tests), unknowns)
    return Plan(unknowns, found)


def passable(line: Sequence[Straight], env: Valuation, exact: bool) -> bool:
    """Whether the tests hold that no input decides."""
    moved: dict[Symbol, Value | None] = dict(env)
    decided: set[Symbol] = set()
    for statement in line:
        match statement:
            case Assign(name, term):
                symbol = Symbol(name, "variable")
                (decided.discard if decided.isdisjoint(symbols(term)) else decided.add)(symbol)
                moved[symbol] = None if symbol in decided else value_of(term, moved, exact)
            case AssignAny(name):
                decided.add(Symbol(name, "variable"))
            case Test(formula):
                parts = (p for p in conjuncts(formula) if decided.isdisjoint(symbols(p)))
                if not all(truth(p, moved, exact) for p in parts):
                    return False
            case Evolve():
                raise AssertionError("the domain of a flow counts as a test")
    return True
