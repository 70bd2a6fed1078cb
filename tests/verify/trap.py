"""What a trap is: a theorem that is false, though it looks proved to a prover with a mistake."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from oracles.exact_motion import Flow, Moment

from dl2c.verify.report import Counterexample

Value = int | Fraction

MODEL = """ArchiveEntry "model"
ProgramVariables Real x; Real y; Real v; Real t; Real c; End.
Problem
  {problem}
End.
End.
"""
"""Around a problem over a few variables."""


@dataclass(frozen=True)
class Trap:
    """`why` it is false, and what would hide that. `state` and `decisions` are a run that shows it; names
    without a value are 0. Where no such run exists in rational numbers, `argument` says why it is false.

    `polynomial`: terms are polynomials, the problem is a box, and an exact run refutes it, so that the prover
    is expected to. `undefined`: false only where a term outside of its domain may be any real number; then
    `proved-if-defined` is right.
    """

    name: str
    problem: str
    why: str
    state: Mapping[str, Value] = field(default_factory=dict[str, Value])
    decisions: Sequence[Any] = ()
    argument: str = ""
    polynomial: bool = True
    undefined: bool = False
    variables: str = "Real x; Real y; Real z; Real t;"
    definitions: str = ""

    @property
    def text(self) -> str:
        """The whole file."""
        definitions = f"Definitions\n  {self.definitions}\nEnd.\n\n" if self.definitions else ""
        return (
            f'ArchiveEntry "{self.name}"\n\n{definitions}ProgramVariables\n  {self.variables}\nEnd.\n\n'
            f"Problem\n  {self.problem}\nEnd.\n\nEnd.\n"
        )


L, R = True, False
"""The left and the right of a choice."""
AGAIN, STOP = True, False
"""One more iteration of a loop, or none."""
MOMENT = Moment()


def once(*decisions: Any) -> tuple[Any, ...]:
    """One iteration of a loop with these decisions, then the end of the loop."""
    return (AGAIN, *decisions, STOP)


def times(count: int, *decisions: Any) -> tuple[Any, ...]:
    """Many iterations, each with these decisions."""
    return ((AGAIN, *decisions) * count) + (STOP,)


def lasting(time: Value | str, **solution: Sequence[Value]) -> Flow:
    """A flow of some duration; the coefficients of its solution where the equations alone do not say."""
    return Flow(Fraction(time), solution)


def decided(run: Counterexample) -> list[Any]:
    """Decisions in the words of the oracle."""
    return [_said(name, value) for name, value in run.decisions]


def _said(name: str, value: Fraction) -> Any:
    match name:
        case "alternative":
            return value == 0
        case "once more":
            return value == 1
        case "duration":
            return Flow(value)
        case _:
            return value
