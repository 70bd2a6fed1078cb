"""What the tests on a path leave to its inputs, and messages about tests for which that is not known.

Comes in: the tests of a path over the state at its point, and the inputs that it meets. A test may
join inputs that are decided one after the other; one that looks back at an input while the later of
the two has its value from earlier in the step is refused.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from dl2c.diagnostics import Diagnostic
from dl2c.ir.logic import atoms, conjuncts, symbols
from dl2c.ir.model import FALSE, Formula
from dl2c.paths import errors
from dl2c.paths.admission import Admission, Obstacle, Unknown, Unresolved, admissions
from dl2c.paths.path import Input


@dataclass(frozen=True, slots=True)
class Meeting:
    """The inputs that a path from a point to a target meets, in order."""

    point: int
    inputs: tuple[str, ...]
    target: int


@dataclass(frozen=True, slots=True)
class Order:
    """When inputs are met: those that a step may have met before a point, and for each input those
    that every path meets before it.
    """

    before: Mapping[int, frozenset[str]]
    always: Mapping[str, frozenset[str]]


def order_of(meetings: Iterable[Meeting]) -> Order:
    """When inputs are met on the paths of a step."""
    listed = list(meetings)
    before: dict[int, frozenset[str]] = {}
    changed = True
    while changed:
        changed = False
        for m in listed:
            known = before.get(m.target, frozenset())
            reached = known | before.get(m.point, frozenset()) | {*m.inputs}
            if reached != known:
                before[m.target], changed = reached, True
    always: dict[str, frozenset[str]] = {}
    for m in listed:
        for k, key in enumerate(m.inputs):
            always[key] = always.get(key, frozenset(m.inputs)) & {*m.inputs[:k]}
    return Order(before, always)


def admitted(
    tests: Formula,
    meeting: Meeting,
    inputs: tuple[Input, ...],
    order: Order,
    found: list[Diagnostic],
) -> tuple[Formula, tuple[Admission, ...]]:
    """Tests that no input decides, and for every input met what may be given to it. Tests that cannot be
    resolved go to `found`.
    """
    numbers = {i.key: k for k, i in enumerate(inputs)}
    own = [inputs[numbers[key]] for key in meeting.inputs]
    early = order.before.get(meeting.point, frozenset[str]())
    try:
        guard, made = admissions(tests, [Unknown(i.symbol, i.low, i.high) for i in own])
        late = [
            a.following
            for k, a in enumerate(made)
            if a.following is not None
            and own[a.following].key in early
            and own[k].key not in order.always[own[a.following].key]
        ]
        if late:
            raise Unresolved(_joining(tests, own, k) for k in late)
    except Unresolved as refused:
        found += [_diagnostic(p, [i.variable for i in own]) for p in refused.obstacles]
        return FALSE, ()
    return guard, tuple(replace(a, input=numbers[own[a.input].key]) for a in made)


def _joining(tests: Formula, own: list[Input], last: int) -> Obstacle:
    """The first test that joins an input with an earlier one."""
    places = {i.symbol: k for k, i in enumerate(own)}
    used = [(p, sorted(places[s] for s in symbols(p) if s in places)) for p in conjuncts(tests)]
    return next(Obstacle("reused", p, tuple(k)) for p, k in used if last in k and len(k) > 1)


def _diagnostic(problem: Obstacle, variables: list[str]) -> Diagnostic:
    first, *_, last = (a.span for a in (*atoms(problem.part), *atoms(problem.part)))
    span = first.to(last) if first.source is last.source else first
    names = tuple(variables[k] for k in problem.inputs)
    match problem.kind:
        case "degree":
            return errors.high_degree(names[-1], span)
        case "joint":
            return errors.joint_test(names, span)
        case "many":
            return errors.many_inputs(names, span)
        case "reused":
            return errors.reused_input(names, span)
        case _:
            assert_never(problem.kind)
