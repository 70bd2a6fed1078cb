"""What a monitor is: checks, each a disjunction of cases, each a conjunction of numbered conditions.

Conditions are formulas over `Symbol(x, "variable")`, the value of x in the state before, over
`after(x)`, its value in the state after, and over the constants. A check of one state has the former
alone. Everything is over the reals; how it is evaluated is decided where code is made of it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import accumulate
from typing import Literal, TypeAlias

from dl2c.ir.logic import folded, symbols
from dl2c.ir.model import (
    ONE,
    Add,
    And,
    Call,
    Compare,
    Formula,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Sub,
    Symbol,
    Term,
)
from dl2c.ir.polynomial import Coefficients
from dl2c.ir.slack import relaxed, sides_of
from dl2c.paths.path import Decision, Input
from dl2c.source import NOWHERE, Span

Kind: TypeAlias = Literal["init", "controller", "model", "safety"]
KINDS: tuple[Kind, ...] = ("init", "controller", "model", "safety")

OUT_OF_RANGE = 1
"""The condition that all numbers are finite and of reasonable size, constants inside their bounds."""


@dataclass(frozen=True, slots=True)
class Condition:
    """`number` is what a verdict names it by; `about` says what part of the model it stands for. `first` is
    the number of the first condition of the monitor with the same formula. `gradual` where a state can be
    nearer to or farther from violating it: an equality can not.
    """

    number: int
    formula: Formula
    about: str
    span: Span = NOWHERE
    first: int = 0
    gradual: bool = True


@dataclass(frozen=True, slots=True)
class Case:
    """One way to satisfy a check: all its conditions. Their numbers count up."""

    conditions: tuple[Condition, ...]
    about: str
    span: Span = NOWHERE


@dataclass(frozen=True, slots=True)
class Check:
    """Satisfied where a case is. `transition` where it compares two states. Numbers of its conditions count
    up by one.
    """

    kind: Kind
    cases: tuple[Case, ...]

    @property
    def transition(self) -> bool:
        return self.kind in ("controller", "model")

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Those of all cases."""
        return tuple(c for case in self.cases for c in case.conditions)

    @property
    def bounds(self) -> tuple[int, ...]:
        """The numbers at which its cases begin, and the one after its last condition."""
        first = next((c.number for c in self.conditions), 0)
        return tuple(accumulate((len(case.conditions) for case in self.cases), initial=first))


@dataclass(frozen=True, slots=True)
class Given:
    """An input on a run. `admits` is what its value must satisfy, given those of earlier inputs; where that
    may change are roots of `criticals`, polynomials in the value of degree 1 or 2.
    """

    input: Input
    admits: Formula
    criticals: tuple[Coefficients, ...]
    span: Span = NOWHERE


@dataclass(frozen=True, slots=True)
class Run:
    """A control path. `case` is its place among the cases of the controller's check, `taken` the alternative
    of each of the agent's decisions, -1 where it does not meet it, `seen` that of each that is measured;
    `updates` are over the state before and its inputs.
    """

    case: int
    taken: tuple[int, ...]
    given: tuple[Given, ...]
    updates: tuple[tuple[str, Term], ...]
    about: str
    span: Span = NOWHERE
    seen: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Controller:
    """All runs in program order, and the order in which a fallback tries them: those whose first decision
    is marked `@fallback`, then program order. `decisions` are the agent's, `measured` those that the
    environment takes before it.
    """

    inputs: tuple[Input, ...]
    decisions: tuple[Decision, ...]
    runs: tuple[Run, ...]
    preferred: tuple[int, ...]
    measured: tuple[Decision, ...] = ()

    def field(self, key: str) -> str:
        """What an input is called: its variable, and a number where there are several of it."""
        return key.removeprefix("assign_")


@dataclass(frozen=True, slots=True)
class Monitor:
    """Everything that code of a monitor is made of. `controller` where the controller is checked."""

    model: Model
    checks: tuple[Check, ...]
    tolerance: "Tolerance"
    controller: Controller | None = None

    @property
    def conditions(self) -> Iterator[tuple[Check, Case, Condition]]:
        for check in self.checks:
            for case in check.cases:
                for condition in case.conditions:
                    yield check, case, condition


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How much a computed value may differ from the model's: `relative * (1 + |value|)`, or what is given
    for a variable, in its unit. Copied values and exact numbers must be equal where nothing is given.
    """

    relative: Fraction = Fraction(1, 10**9)
    absolute: Mapping[str, Fraction] = field(default_factory=dict[str, Fraction])

    def equal(self, variable: str, value: Term, span: Span = NOWHERE) -> Formula:
        """That the variable's value afterwards is `value`."""
        new = after(variable)
        if variable not in self.absolute and (self.relative == 0 or _is_copied(value)):
            return Compare("=", new, value, span=span)
        size = Add(ONE, Call("abs", (new,)))
        given = self.absolute.get(variable)
        slack = Number(given) if given is not None else Mul(Number(self.relative), size)
        return Compare("<=", Call("abs", (Sub(new, value),)), slack, span=span)

    def met(self, test: Formula) -> Formula:
        """The test with equalities of chosen values met closely, as a step solves them in doubles."""
        match test:
            case And(children):
                return And(tuple(map(self.met, children)))
            case Or(children):
                return Or(tuple(map(self.met, children)))
            case Compare("=", left, right) if not (_is_copied(left) and _is_copied(right)):
                chosen = any(s.kind == "input" for s in symbols(left, right))
                return relaxed(test, self.relative, sides_of) if chosen else test
            case _:
                return test


def after(variable: str) -> Symbol:
    """The value of a variable in the state after. No dL name looks like it."""
    return Symbol(f"{variable}_post", "input")


def _is_copied(value: Term) -> bool:
    """Whether the value is computed without rounding, in single precision too."""
    match value:
        case Symbol():
            return True
        case Neg(child):
            return _is_copied(child)
        case Number(exact):
            return abs(exact.numerator) < 2**24 and exact.denominator in (1, 2, 4, 8, 16)
        case _:
            return folded(value) != value and _is_copied(folded(value))
