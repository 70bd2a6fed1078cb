"""A loop around differential equations as a switched system: its modes, and how runs change between them.

In: the loop's body. Out: `Switching`, for guesses about stability. A mode is a differential equation, with
the tests of discrete variables that stand directly before it (`?u=1;`). A timer is a variable of rate 1 that
the body sets to 0, so that tests of it say how long a mode lasts.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import product, takewhile
from typing import TypeGuard

from dl2c.ir.logic import COMPARISONS, NEGATED
from dl2c.parse import tree
from dl2c.resolve.shape import conjuncts, statements
from dl2c.resolve.symbols import nodes
from dl2c.verify.arithmetic.exact import Inexact, Undefined, term_value

MAX_RUNS = 500
"""Runs of a body that are looked at."""

ZERO = tree.Number(Fraction(0))
ONE = tree.Number(Fraction(1))


@dataclass(frozen=True, slots=True)
class Mode:
    """`tests` are of discrete variables. `longest` is what the domain allows the timer, None for no limit."""

    system: tree.ODESystem
    tests: tuple[tree.Compare, ...]
    longest: Fraction | None


@dataclass(frozen=True, slots=True)
class Jump:
    """From one mode to another, each by its number, once the timer is at least `waited`; `reset` if the timer
    is 0 after it.
    """

    source: int
    target: int
    waited: Fraction
    reset: bool


@dataclass(frozen=True, slots=True)
class Switching:
    """`timer` is None where no variable is one, and then there are no jumps."""

    modes: tuple[Mode, ...]
    timer: str | None
    jumps: tuple[Jump, ...]


def switching(body: tree.Program) -> Switching | None:
    """The switched system of a loop's body; None where its runs are too many, or have loops."""
    if any(isinstance(n, tree.Loop | tree.Dual) for n in nodes(body)):
        return None
    runs: list[tuple[tree.Program, ...]] = []
    for run in _runs(body):
        if len(runs) == MAX_RUNS:
            return None
        runs.append(run)
    systems = tuple(n for n in nodes(body) if isinstance(n, tree.ODESystem))
    timer = _timer(body, systems)
    modes = tuple(Mode(s, _tests(s, runs), _longest(s.domain, timer)) for s in systems)
    if timer is None:
        return Switching(modes, None, ())
    jumps = {
        jump: None
        for (number, mode), run in product(enumerate(modes), runs)
        if (jump := _Followed.through(run, number, mode, systems, timer)) is not None
    }
    return Switching(modes, timer, tuple(jumps))


def _runs(program: tree.Program) -> Iterator[tuple[tree.Program, ...]]:
    """The sequences of statements that choices leave."""
    match program:
        case tree.Compose(left, right):
            for first in _runs(left):
                for second in _runs(right):
                    yield (*first, *second)
        case tree.Choice(left, right):
            yield from _runs(left)
            yield from _runs(right)
        case _:
            yield statements(program)


def _timer(body: tree.Program, systems: tuple[tree.ODESystem, ...]) -> str | None:
    """The one variable of rate 1 in all equations that the body sets to 0."""
    reset = {n.name for n in nodes(body) if isinstance(n, tree.Assign) and n.term == ZERO}
    steady = [
        {e.name for e in s.equations if isinstance(e, tree.AtomicODE) and e.term == ONE} for s in systems
    ]
    names = sorted(reset.intersection(*steady)) if steady else []
    return names[0] if len(names) == 1 else None


def _tests(system: tree.ODESystem, runs: list[tuple[tree.Program, ...]]) -> tuple[tree.Compare, ...]:
    """The tests directly before an equation that say which value a variable has; those of all runs."""
    moving = {e.name for e in system.equations if isinstance(e, tree.AtomicODE)}
    found: list[dict[tree.Compare, None]] = []
    for run in runs:
        if (place := _place(system, run)) is None:
            continue
        tests = takewhile(lambda s: isinstance(s, tree.Test), reversed(run[:place]))
        parts = (part for s in tests if isinstance(s, tree.Test) for part in conjuncts(s.formula))
        found.append({part: None for part in parts if _is_discrete(part, moving)})
    return tuple(test for test in found[0] if all(test in other for other in found)) if found else ()


def _place(system: tree.Program, programs: tuple[tree.Program, ...]) -> int | None:
    """Where this very equation stands: others may be equal."""
    return next((k for k, p in enumerate(programs) if p is system), None)


def _is_discrete(part: tree.Formula, moving: set[str]) -> TypeGuard[tree.Compare]:
    """Whether a test says which value a variable has that does not move."""
    match part:
        case tree.Compare("=", tree.Variable(name), value):
            return name not in moving and number(value) is not None
        case _:
            return False


def number(term: tree.Term) -> Fraction | None:
    """The value of a term without names."""
    try:
        return term_value(term, {})
    except (Undefined, Inexact):
        return None


def _longest(domain: tree.Formula, timer: str | None) -> Fraction | None:
    limits: list[Fraction] = []
    for part in conjuncts(domain):
        match part:
            case tree.Compare("<" | "<=", tree.Variable(name), limit) if name == timer:
                limits += [value] if (value := number(limit)) is not None else []
            case _:
                pass
    return min(limits, default=None)


def _value(test: tree.Compare) -> tuple[str, Fraction]:
    """What a test of a discrete variable says."""
    value = number(test.right)
    assert isinstance(test.left, tree.Variable) and value is not None
    return test.left.name, value


@dataclass(frozen=True, slots=True)
class _Followed:
    """A run of the body from a mode: what is known of discrete variables, and of the timer."""

    timer: str
    known: Mapping[str, Fraction] = field(default_factory=dict[str, Fraction])
    least: Fraction = Fraction(0)
    most: Fraction | None = None
    reset: bool = False

    @classmethod
    def through(
        cls,
        run: tuple[tree.Program, ...],
        source: int,
        mode: Mode,
        systems: tuple[tree.ODESystem, ...],
        timer: str,
    ) -> Jump | None:
        """The jump of a run that begins in a mode; None where tests forbid it."""
        state: _Followed | None = cls(timer, dict(map(_value, mode.tests)), most=mode.longest)
        for statement in run:
            if (target := _place(statement, systems)) is not None:
                return Jump(source, target, state.least, state.reset)
            state = state.after(statement)
            if state is None:
                return None
        return None

    def after(self, statement: tree.Program) -> "_Followed | None":
        """What is known after a statement; None if it has no run."""
        match statement:
            case tree.Test(formula):
                state: _Followed | None = self
                for part in conjuncts(formula):
                    state = state and state.where(part)
                return state
            case tree.Assign(name, term, False) if name == self.timer:
                return replace(self, reset=True) if number(term) == 0 else None
            case tree.Assign(name, term, False) if (value := number(term)) is not None:
                return replace(self, known={**self.known, name: value})
            case tree.Assign(name, term, False) if term != tree.Variable(name):
                return replace(self, known={n: v for n, v in self.known.items() if n != name})
            case tree.AssignAny(name, False):
                return replace(self, known={n: v for n, v in self.known.items() if n != name})
            case _:
                return self

    def where(self, test: tree.Formula) -> "_Followed | None":
        """What is known where a test holds too."""
        match test:
            case tree.Not(tree.Compare(op, left, right)):
                return self.where(tree.Compare(NEGATED[op], left, right))
            case tree.Truth(False):
                return None
            case tree.Compare(op, tree.Variable(name), term) if (value := number(term)) is not None:
                if name == self.timer:
                    return self._timed(op, value)
                return None if op == "=" and self.known.get(name, value) != value else self
            case _:
                return self

    def _timed(self, op: tree.Comparison, value: Fraction) -> "_Followed | None":
        """Where the timer compares so with a number."""
        if self.reset:
            return self if COMPARISONS[op](Fraction(0), value) else None
        least, most = self.least, self.most
        if op in (">=", ">", "="):
            least = max(least, value)
        if op in ("<=", "<", "="):
            most = value if most is None else min(most, value)
        return replace(self, least=least, most=most) if most is None or least <= most else None
