"""What is watched along the flows of a step beside their domains (semantics 6).

A @safety predicate must hold at every instant of a flow, where safety is checked
continuously. The obligation `D -> P` of a @progress predicate P fails at the first instant
at which D holds, unless P held before, or holds then.
"""

from dataclasses import dataclass
from typing import Literal

from dl2c.ir.logic import conjunction, negation
from dl2c.ir.model import FALSE, TRUE, Formula, Model


@dataclass(frozen=True, slots=True)
class Watch:
    """One condition: `stays` is watched until it fails.

    For a safety predicate that is its violation, and `cuts` says that the flow ends there. For
    an obligation D -> P `stays` is "neither D nor P"; where that fails, it was met if P (`goal`)
    holds, else it failed if D (`due`) does. `plainly` is a simpler condition that implies `stays`.
    """

    predicate: int
    kind: Literal["safety", "obligation"]
    stays: Formula
    due: Formula
    goal: Formula
    plainly: Formula
    cuts: bool


def watches_of(model: Model) -> tuple[Watch, ...]:
    """All watches of a model, in the order of its predicates."""
    found: list[Watch] = []
    for k, predicate in enumerate(model.predicates):
        if predicate.category == "safety" and model.continuous:
            trigger = predicate.on_failure
            cuts = trigger is not None and trigger.action != "continue"
            found.append(Watch(k, "safety", predicate.relaxed, TRUE, FALSE, predicate.formula, cuts))
        elif predicate.category == "progress" and predicate.due is not None and predicate.due != TRUE:
            stays = conjunction([negation(predicate.due), negation(predicate.relaxed)])
            found.append(Watch(k, "obligation", stays, predicate.due, predicate.relaxed, stays, False))
    return tuple(found)
