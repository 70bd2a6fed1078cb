"""Straight lines through a program, for the interpreter.

Between two cut points a run is a straight line of assignments, inputs and tests. Cut points are
flows, tests of while loops, the end, and the first branch after an input that the agent does not
give, whose value is drawn before the branch is taken. `lines` lists them in program order; a
deterministic branch contributes its tests.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias, assert_never

from dl2c.ir.liveness import statements
from dl2c.ir.model import Assign, AssignAny, Block, Choice, Evolve, If, Repeat, Role, Test, While

Straight: TypeAlias = Assign | AssignAny | Test | Evolve


@dataclass(frozen=True, slots=True)
class Made:
    """A discrete decision made on a line; `marked` where the alternative is marked `@fallback`."""

    key: str
    alternative: int
    marked: bool
    role: Role


@dataclass(frozen=True, slots=True)
class Line:
    """What is executed up to a cut point, a flow included, and what remains after it.

    A line that `enters` begins with an iteration of a while loop.
    """

    decisions: tuple[Made, ...]
    statements: tuple[Straight, ...]
    rest: Block
    enters: bool = False

    @property
    def flows(self) -> bool:
        return bool(self.statements) and isinstance(self.statements[-1], Evolve)


def lines(block: Block, taken: Mapping[str, int]) -> Iterator[Line]:
    """Every line from a cut point. Decisions in `taken` keep their outcome."""
    if block and isinstance(loop := block[0], While):
        into = (Test(loop.condition, span=loop.span), *loop.body, *block)
        for line in _lines(into, taken, False):
            yield replace(line, enters=True)
        yield from _lines((Test(loop.otherwise, span=loop.span), *block[1:]), taken, False)
    else:
        yield from _lines(block, taken, False)


def _lines(block: Block, taken: Mapping[str, int], drawn: bool) -> Iterator[Line]:
    """`drawn` after an input that the agent does not give."""
    if not block:
        yield Line((), (), ())
        return
    first, rest = block[0], block[1:]
    if isinstance(first, AssignAny):
        drawn |= first.role != "agent"
    match first:
        case While():
            yield Line((), (), block)
        case If() | Choice() | Repeat() if drawn:
            yield Line((), (), block)
        case Evolve():
            yield Line((), (first,), rest)
        case Assign() | AssignAny() | Test():
            for line in _lines(rest, taken, drawn):
                yield replace(line, statements=(first, *line.statements))
        case If(condition, otherwise, then, orelse):
            for guard, body in ((condition, then), (otherwise, orelse)):
                yield from _lines((Test(guard, span=first.span), *body, *rest), taken, False)
        case Choice(key=key, role=role) | Repeat(key=key, role=role):
            for k, alternative in enumerate(first.alternatives):
                if taken.get(key, k) != k:
                    continue
                made = () if key in taken else (Made(key, k, alternative.fallback, role),)
                for line in _lines((*alternative.body, *rest), {**taken, key: k}, False):
                    yield replace(line, decisions=(*made, *line.decisions))
        case _:
            assert_never(first)


def choices(block: Block) -> Iterator[Choice | Repeat]:
    """Every discrete decision of a program, in program order."""
    return (s for s in statements(block) if isinstance(s, Choice | Repeat))
