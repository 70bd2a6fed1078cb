"""What path enumeration finds: a graph of guarded paths.

A step starts at point 0. A path leads from its point through the discrete statements up
to a flow, follows that flow, and arrives at the next point, or at the end of the step
(`END`). Guards, tests of inputs and updates are all over the state at the path's own
point: assignments on the way are substituted. Masks, the compiled step, action sets and
lints read nothing else of the program.
"""

from dataclasses import dataclass
from fractions import Fraction

from dl2c.ir.model import Formula, Role, Symbol, Term
from dl2c.source import NOWHERE, Span

END = -1
"""The target of a path that completes the step."""


@dataclass(frozen=True, slots=True)
class Decision:
    """A discrete decision: one text per alternative, as the model writes it."""

    key: str
    name: str
    role: Role
    alternatives: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Input:
    """A continuous decision `variable := *` with the limits of its Box."""

    key: str
    variable: str
    role: Role
    low: Fraction
    high: Fraction

    @property
    def symbol(self) -> Symbol:
        return Symbol(self.key, "input")


@dataclass(frozen=True, slots=True)
class Limit:
    """An atom `offset + slope*u >= 0` (or > 0) of an input u: where slope > 0 a lower limit, else upper."""

    offset: Term
    slope: Term


@dataclass(frozen=True, slots=True)
class Admission:
    """The tests of one input on a path: `tests` must hold, and `limits` are where they change."""

    input: int
    tests: Formula
    limits: tuple[Limit, ...]


@dataclass(frozen=True, slots=True)
class Path:
    """One guarded path.

    `decisions` holds for every discrete decision of the step the alternative taken, -1 where
    the path does not meet it; `met` are the decisions met, in order, and `marks` whether the
    alternative of each is marked `@fallback`. `guard` is every test that no input decides,
    with the domain of the flow at its start. `updates` are the changed variables.
    """

    point: int
    decisions: tuple[int, ...]
    met: tuple[int, ...]
    marks: tuple[bool, ...]
    guard: Formula
    admissions: tuple[Admission, ...]
    updates: tuple[tuple[str, Term], ...]
    flow: int | None
    target: int
    span: Span = NOWHERE


@dataclass(frozen=True, slots=True)
class Paths:
    """All paths of a step, grouped by point in program order."""

    decisions: tuple[Decision, ...]
    inputs: tuple[Input, ...]
    points: int
    paths: tuple[Path, ...]

    def of(self, point: int) -> tuple[Path, ...]:
        return tuple(p for p in self.paths if p.point == point)

    @property
    def runs(self) -> tuple[tuple[int, ...], ...]:
        """The decision vectors of the whole control paths up to the first flow, each once, in order."""
        return tuple(dict.fromkeys(p.decisions for p in self.of(0)))
