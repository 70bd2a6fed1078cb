"""What the annotated predicates say of a step: rewards and the end of the episode (semantics 6).

The reference of the compiled `model_judge`. Comes in: the state after a step, and what happened
on the way that this state does not show. Numbers are doubles or exact rationals.
"""

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

from dl2c.flows.watch import watches_of
from dl2c.ir.evaluate import Undefined, Valuation, Value, evaluate, literal, truth
from dl2c.ir.model import Model, Predicate, Rank, Trigger, rank


@dataclass(frozen=True, slots=True)
class Happened:
    """What a post-state does not show: the watches that failed or were met on the way, by number, and
    whether the step is the last that the time limit allows."""

    failed: frozenset[int] = frozenset()
    met: frozenset[int] = frozenset()
    late: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the annotated predicates say of a state. `ends` is the winning end action, if any."""

    reward: Value
    cost: int
    ends: str | None
    status: str
    reason: str
    undefined: bool


NOTHING = Happened()


def judge(model: Model, env: Valuation, exact: bool = False, happened: Happened = NOTHING) -> Outcome:
    """Evaluate every predicate on a post-state; of those that end the episode one wins."""
    reward: Value = literal(Fraction(0), exact)
    cost = 0
    undefined = False
    continued: list[tuple[Rank, Trigger]] = []
    firings: list[tuple[Rank, Trigger, str]] = []
    for k, predicate in enumerate(model.predicates):
        own = _watch_of(model, k)
        good = truth(predicate.relaxed, env, exact)
        if predicate.category == "safety":
            good = good and own not in happened.failed
            cost += not good
        for term in (predicate.reward if good else predicate.penalty, predicate.shape):
            if term is not None:
                try:
                    reward = reward + evaluate(term, env, exact)
                except Undefined:
                    undefined = True
        fails = _fails(predicate, good, env, exact, own, happened)
        for trigger, fires in ((predicate.on_success, good), (predicate.on_failure, fails)):
            if trigger is not None and fires and trigger.action == "continue":
                continued.append((rank(k, predicate, trigger), trigger))
            elif trigger is not None and fires:
                firings.append((rank(k, predicate, trigger), trigger, predicate.name))
    if not firings:
        status = min(continued, key=lambda firing: firing[0])[1].status if continued else "none"
        return Outcome(reward, cost, None, status, "", undefined)
    _, winner, name = min(firings, key=lambda firing: firing[0])
    return Outcome(reward, cost, winner.action, winner.status, name, undefined)


def shapes(model: Model, env: Valuation, exact: bool = False) -> Value:
    """The shapes of all predicates together, which is what a step without a run earns."""
    reward: Value = literal(Fraction(0), exact)
    for predicate in model.predicates:
        if predicate.shape is not None:
            with suppress(Undefined):
                reward = reward + evaluate(predicate.shape, env, exact)
    return reward


def _watch_of(model: Model, predicate: int) -> int | None:
    """The number of the watch of a predicate, if it has one."""
    found = [w for w, watch in enumerate(watches_of(model)) if watch.predicate == predicate]
    return found[0] if found else None


def _fails(
    predicate: Predicate, good: bool, env: Valuation, exact: bool, watch: int | None, happened: Happened
) -> bool:
    """Whether a predicate counts as failed: a progress predicate only when its obligation falls due."""
    if predicate.category != "progress":
        return not good
    if watch is not None and watch in happened.failed:
        return True
    if predicate.due is None:
        return not good and happened.late
    return not good and watch not in happened.met and truth(predicate.due, env, exact)
