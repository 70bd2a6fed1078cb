"""Doubts about a program that can be executed: decisions that may not be what their author meant."""

from collections.abc import Iterator

from dl2c.diagnostics import Diagnostic, warning
from dl2c.ir.liveness import parts_of
from dl2c.ir.model import AssignAny, Block, Choice, Evolve, Model, Repeat, Test, While
from dl2c.source import Span


def program_warnings(model: Model) -> tuple[Diagnostic, ...]:
    """Warnings about the decisions of a model, each once."""
    found = _doubts((*model.prefix, *model.lead, *model.body), looped=False)
    return tuple({d.span: d for d in found}.values())


def _doubts(block: Block, looped: bool) -> Iterator[Diagnostic]:
    for statement in block:
        if looped and isinstance(statement, AssignAny | Choice | Repeat):
            yield _made_once(statement.span)
        by_agent = isinstance(statement, Choice) and statement.role == "agent"
        if by_agent and all(map(_moves, parts_of(statement))):
            yield _moves_world(statement.span)
        for part in parts_of(statement):
            yield from _doubts(part, looped or isinstance(statement, Repeat | While))


def _moves(block: Block) -> bool:
    """Whether a program only tests and flows."""
    return any(isinstance(s, Evolve) for s in block) and all(isinstance(s, Test | Evolve) for s in block)


def _made_once(span: Span) -> Diagnostic:
    return warning(
        "decision-in-loop",
        "a decision inside a loop is made once in a step",
        span,
        "every iteration uses the same outcome",
        "make it before the loop if that is what you mean, or let every step be one iteration",
    )


def _moves_world(span: Span) -> Diagnostic:
    return warning(
        "agent-moves-world",
        "the agent chooses how the world moves",
        span,
        "its alternatives only test and evolve",
        "`/* @choice: role=env */` before it lets chance choose among those possible",
    )
