"""Doubts about a program that can be executed: decisions that may not be what their author meant."""

from collections.abc import Iterator
from typing import assert_never

from dl2c.diagnostics import Diagnostic, warning
from dl2c.ir.model import Assign, AssignAny, Block, Choice, Evolve, If, Model, Repeat, Test, While
from dl2c.source import Span


def program_warnings(model: Model) -> tuple[Diagnostic, ...]:
    """Warnings about the decisions of a model, each once."""
    found = _doubts((*model.prefix, *model.lead, *model.body), looped=False)
    return tuple({d.span: d for d in found}.values())


def _doubts(block: Block, looped: bool) -> Iterator[Diagnostic]:
    for statement in block:
        match statement:
            case AssignAny():
                if looped:
                    yield _made_once(statement.span)
            case Choice(_, alternatives, role):
                if looped:
                    yield _made_once(statement.span)
                if role == "agent" and all(_moves(a.body) for a in alternatives):
                    yield _moves_world(statement.span)
                for alternative in alternatives:
                    yield from _doubts(alternative.body, looped)
            case If(_, _, then, orelse):
                yield from _doubts((*then, *orelse), looped)
            case Repeat(_, body):
                if looped:
                    yield _made_once(statement.span)
                yield from _doubts(body, looped=True)
            case While(body=body):
                yield from _doubts(body, looped=True)
            case Assign() | Test() | Evolve():
                pass
            case _:
                assert_never(statement)


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
