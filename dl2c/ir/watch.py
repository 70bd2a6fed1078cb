"""What is watched along the flows of a step beside their domains (semantics 6).

A @safety predicate must hold at every instant of a flow, where safety is checked
continuously. The obligation `D -> P` of a @progress predicate P fails at the first instant
at which D holds, unless P held before, or holds then.
"""

from dataclasses import dataclass
from typing import Literal

from dl2c.ir.logic import conjunction, negation
from dl2c.ir.model import (
    FALSE,
    TRUE,
    Block,
    Choice,
    Evolve,
    Formula,
    If,
    Model,
    Repeat,
    Statement,
    While,
)


@dataclass(frozen=True, slots=True)
class Watch:
    """One condition: `stays` is watched until it fails.

    For a safety predicate that is its violation, and `cuts` says that the flow ends there. For
    an obligation D -> P `stays` is "neither D nor P"; where that fails, it was met if P (`goal`)
    holds, else it failed if D (`due`) does.

    A flow that keeps to `plainly` all along and ends in `at_end` changes nothing: the watch does not
    fail, and whether it was met does not matter.
    """

    predicate: int
    kind: Literal["safety", "obligation"]
    stays: Formula
    due: Formula
    goal: Formula
    plainly: Formula
    at_end: Formula
    cuts: bool


def watches_of(model: Model) -> tuple[Watch, ...]:
    """All watches of a model, in the order of its predicates."""
    last = not model.lead and flows_come_last(model.body)
    found: list[Watch] = []
    for k, predicate in enumerate(model.predicates):
        if predicate.category == "safety" and model.continuous:
            trigger = predicate.on_failure
            cuts = trigger is not None and trigger.action != "continue"
            stays = predicate.relaxed
            found.append(Watch(k, "safety", stays, TRUE, FALSE, predicate.formula, TRUE, cuts))
        elif predicate.category == "progress" and predicate.due is not None and predicate.due != TRUE:
            early = negation(predicate.due)
            stays = conjunction([early, negation(predicate.relaxed)])
            plainly, at_end = (early, early) if last else (stays, TRUE)
            goal = predicate.relaxed
            found.append(Watch(k, "obligation", stays, predicate.due, goal, plainly, at_end, False))
    return tuple(found)


def flows_come_last(block: Block) -> bool:
    """Whether nothing follows a flow in any run: an obligation that is not due when it ends is not judged."""
    return not any(_flows(s) for s in block[:-1]) and all(
        flows_come_last(part) for s in block[-1:] for part in _parts(s)
    )


def _flows(statement: Statement) -> bool:
    return isinstance(statement, Evolve) or any(_flows(s) for part in _parts(statement) for s in part)


def _parts(statement: Statement) -> tuple[Block, ...]:
    match statement:
        case If(_, _, then, orelse):
            return then, orelse
        case Choice(_, alternatives):
            return tuple(a.body for a in alternatives)
        case While(body=body) | Repeat(body=body):
            return (body + body,)
        case _:
            return ()
