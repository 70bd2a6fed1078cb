"""What path enumeration finds: a graph of guarded paths.

A step starts at point 0. A path leads from its point through the discrete statements up
to a flow or another cut point, such as the head of a while loop, follows that flow, and
arrives at the next point, or at the end of the step (`END`). Guards, tests of inputs and
updates are all over the state at the path's own point: assignments on the way are
substituted. Masks, the compiled step, action sets and lints read nothing else of the
program.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from dl2c.ir.model import Formula, Role, Symbol, Term
from dl2c.paths.admission import Admission
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


def duration_input(flow: int) -> Input:
    """The agent's decision for what part of its longest duration a flow lasts."""
    return Input(f"duration_{flow}", "", "agent", Fraction(0), Fraction(1))


@dataclass(frozen=True, slots=True)
class Path:
    """One guarded path.

    `decisions` holds for every discrete decision of the step the alternative taken, -1 where
    the path does not meet it; `met` are the decisions met, in order, and `marks` whether the
    alternative of each is marked `@fallback`. `guard` is every test that no input decides,
    with the domain of the flow at its start. `updates` are the changed variables. A path that
    `enters` begins with an iteration of a while loop. Decisions and inputs that were met earlier
    in the step keep their outcome: a path of another alternative is closed. `statements` are the places of
    what it executes, in order.
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
    enters: bool = False
    statements: tuple[Span, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Paths:
    """All paths of a step, grouped by point in program order.

    Decisions and inputs of the agent come first, then those of the environment, then those of a
    reset. The leading statements of a step start at point `lead`, the program before the loop at
    point `prefix`; None where there is none. `sampled` are the flows whose durations a step draws. Masks that
    are `deep` follow runs beyond flows.
    """

    decisions: tuple[Decision, ...]
    inputs: tuple[Input, ...]
    points: int
    paths: tuple[Path, ...]
    lead: int | None = None
    prefix: int | None = None
    sampled: tuple[int, ...] = ()
    deep: bool = False

    def of(self, point: int) -> tuple[Path, ...]:
        return tuple(p for p in self.paths if p.point == point)

    @property
    def own_points(self) -> int:
        """How many points belong to the step itself: these come first."""
        return min(p for p in (self.lead, self.prefix, self.points) if p is not None)

    @property
    def draws(self) -> tuple[tuple[str, int], ...]:
        """How many numbers a step draws, by what they decide: one for each alternative, one for an input
        or the duration of a flow (`flow_<k>`).
        """
        return (*self._drawn("env"), *((f"flow_{k}", 1) for k in self.sampled))

    @property
    def reset_draws(self) -> tuple[tuple[str, int], ...]:
        """How many numbers the program before the loop draws; for the duration of a flow, `flow_<k>`, one."""
        start = self.points if self.prefix is None else self.prefix
        flows = dict.fromkeys(p.flow for p in self.paths if p.point >= start and p.flow is not None)
        return (*self._drawn("reset"), *((f"flow_{k}", 1) for k in flows))

    def _drawn(self, role: Role) -> tuple[tuple[str, int], ...]:
        choices = [(d.key, len(d.alternatives)) for d in self.decisions if d.role == role]
        return (*choices, *((i.key, 1) for i in self.inputs if i.role == role))

    @property
    def looks_ahead(self) -> bool:
        """Whether which runs are open depends on more than the paths of point 0."""
        onward = (p for p in self.of(0) if p.target != END)
        return self.lead is not None or any(self.deep or p.flow is None for p in onward)

    @property
    def runs(self) -> tuple[tuple[int, ...], ...]:
        """What the agent decides on each whole control path up to the first flow, once each, in order."""
        agent = sum(d.role == "agent" for d in self.decisions)
        return tuple(dict.fromkeys(taken[:agent] for taken in self._vectors()))

    def _vectors(self) -> Iterator[tuple[int, ...]]:
        """The decision vectors of all runs up to the first flow, in program order."""
        waiting = [(0, (-1,) * len(self.decisions))]
        seen = set(waiting)
        while waiting:
            point, taken = waiting.pop()
            if point == END:
                yield taken
                continue
            found: list[tuple[int, tuple[int, ...]]] = []
            for path in self.of(point):
                pairs = list(zip(taken, path.decisions, strict=True))
                if all(-1 in pair or pair[0] == pair[1] for pair in pairs):
                    found.append((path.target if path.flow is None else END, tuple(map(max, pairs))))
            waiting += [item for item in reversed(found) if item[0] == END or item not in seen]
            seen.update(found)
