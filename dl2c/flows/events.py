"""What happens along a stretch of a flow: where its conditions first fail.

Formulas are over the signs of margins. In doubles these are the operations of cgen/runtime/events.h.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dl2c.flows.kernel import FlowPlan
from dl2c.ir.evaluate import Value, literal
from dl2c.ir.logic import holds, true_where
from dl2c.ir.model import Formula, Term

Signs = Sequence[int]


@dataclass(frozen=True, slots=True)
class Crossing:
    """A place in [0,1] where a margin is zero: its sign is 0 at `at` and `after` just after."""

    at: Value
    margin: int
    after: int


@dataclass(frozen=True, slots=True)
class Exit:
    """Where a formula first fails, with the signs at and just after that place; at 1 if it does not.

    With `holds` it is still true at `at` and fails just after.
    """

    found: bool
    holds: bool
    at: Value
    sign_at: tuple[int, ...]
    sign_after: tuple[int, ...]


@dataclass(slots=True)
class Events:
    """Signs of all margins over a stretch of time: at its start, just after, and where they change."""

    at_start: list[int]
    after_start: list[int]
    crossings: list[Crossing]


def first_exit(events: Events, condition: Callable[[Signs], bool], exact: bool = False) -> Exit:
    """When a formula that (normally) holds first fails; `condition` evaluates it on signs.

    What comes just after 1 is not looked at.
    """
    zero, one = literal(Fraction(0), exact), literal(Fraction(1), exact)
    crossed = events.crossings
    now, after = tuple(events.at_start), tuple(events.after_start)
    if not condition(now):
        return Exit(True, False, zero, now, after)
    if not condition(after):
        return Exit(True, True, zero, now, after)
    k = 0
    while k < len(crossed):
        at = crossed[k].at
        on, beyond = list(after), list(after)
        while k < len(crossed) and crossed[k].at == at:
            on[crossed[k].margin] = 0
            beyond[crossed[k].margin] = crossed[k].after
            k += 1
        now, after = tuple(on), tuple(beyond)
        if not condition(now):
            return Exit(True, False, at, now, after)
        if at == 1:
            return Exit(False, True, at, now, after)
        if not condition(after):
            return Exit(True, True, at, now, after)
    return Exit(False, True, one, after, after)


def holds_over(formula: Formula, margins: Sequence[Term], signs: Signs) -> bool:
    """The truth of a formula over margins whose signs are given."""
    return true_where(formula, lambda atom: holds(atom.op, signs[margins.index(atom.left)], 0))


def exit_of(formula: Formula, margins: Sequence[Term], events: Events, exact: bool = False) -> Exit:
    """When a formula over margins first fails."""
    return first_exit(events, lambda signs: holds_over(formula, margins, signs), exact)


def watched(
    plan: FlowPlan, waiting: Sequence[int], events: Events, limit: Value, exact: bool = False
) -> tuple[Value | None, tuple[int, ...], tuple[int, ...]]:
    """What the watches say of a stretch on which the domain lets the flow go as far as `limit`: where a
    violation cuts it, which watches failed and which were met."""
    exits = {w: exit_of(plan.watches[w].stays, plan.margins, events, exact) for w in waiting}
    reached = {w: e for w, e in exits.items() if _reached(e, limit, False)}
    stop = min((e.at for w, e in reached.items() if plan.watches[w].cuts), default=None)
    failed: list[int] = []
    met: list[int] = []
    for w, found in reached.items():
        watch = plan.watches[w]
        if stop is not None and not _reached(found, stop, watch.cuts):
            continue
        signs = found.sign_after if found.holds else found.sign_at
        if holds_over(watch.goal, plan.margins, signs):
            met.append(w)
        elif holds_over(watch.due, plan.margins, signs):
            failed.append(w)
    return stop, tuple(failed), tuple(met)


def _reached(found: Exit, stop: Value, included: bool) -> bool:
    """Whether a flow that ends at `stop` got as far as a failure."""
    return found.found and (found.at < stop or (found.at == stop and (included or not found.holds)))
