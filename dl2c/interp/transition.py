"""What a step is asked for, where it starts and what it did: the interpreter's data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.ir.evaluate import Value
from dl2c.ir.model import Symbol
from dl2c.options import OnBlocked

Failure: TypeAlias = Literal["", "numerical", "diverged"]

Draws: TypeAlias = Mapping[str, Sequence[float]]
"""Numbers in [0, 1) by the key of what the agent does not decide: one for each alternative of a
choice, the least wins; one for an input or the duration of a flow (`flow_<k>`), its place in the
admissible range."""


@dataclass(frozen=True, slots=True)
class Settings:
    """The options that change what a step does."""

    on_blocked: OnBlocked = "fallback"
    blocked_penalty: float = 0.0
    limits: Mapping[str, tuple[Fraction, Fraction]] = field(
        default_factory=dict[str, tuple[Fraction, Fraction]]
    )


@dataclass(frozen=True, slots=True)
class Request:
    """What a step is asked for; `draws` decide what the agent does not."""

    choices: Mapping[str, int] = field(default_factory=dict[str, int])
    inputs: Mapping[str, Value] = field(default_factory=dict[str, Value])
    draws: Draws = field(default_factory=dict[str, Sequence[float]])


@dataclass(frozen=True, slots=True)
class Start:
    """Where a step starts: the state that its leading statements led to, and what was decided in them."""

    state: Mapping[str, Value]
    taken: Mapping[str, int] = field(default_factory=dict[str, int])
    values: Mapping[str, Value] = field(default_factory=dict[str, Value])


@dataclass(frozen=True, slots=True)
class Openings:
    """Whether some run is enabled, and by decision of the agent which alternatives such runs take.

    All alternatives of a decision that no enabled run meets.
    """

    open: bool
    mask: Mapping[str, tuple[bool, ...]]


@dataclass(frozen=True, slots=True)
class Step:
    """What a step did. `judged` is the state that it led to, `start` where the next one starts,
    `openings` what is enabled there.

    `reason` is empty while the episode goes on; else a predicate's name, or blocked, deadlock,
    numerical, diverged, end. `decisions` and `values` are those in effect, by key. `postcondition` is
    Q of `judged`; true where a problem without a loop has no run.
    """

    judged: Mapping[str, Value]
    start: Start
    decisions: dict[str, int]
    values: dict[str, Value]
    blocked: bool
    duration: Value
    reward: Value
    cost: int
    terminated: bool
    truncated: bool
    status: str
    reason: str
    postcondition: bool
    openings: Openings

    @property
    def state(self) -> Mapping[str, Value]:
        return self.start.state


@dataclass(frozen=True, slots=True)
class Trial:
    """A run so far. `left` where it is not the one requested; `failed` and `met` are watches, by number."""

    env: Mapping[Symbol, Value | None]
    taken: Mapping[str, int]
    values: Mapping[str, Value]
    duration: Value
    left: bool = False
    entered: int = 0
    failure: Failure = ""
    failed: frozenset[int] = frozenset()
    met: frozenset[int] = frozenset()
