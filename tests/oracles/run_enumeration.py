"""What a step of a small program does, from the rules alone: where runs may stop, and what is violated.

A step is one run of the body. Safety is watched along a flow after which the path executes nothing, not even
a test; other paths are judged where they end. `flows` watches every flow, `step` none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product

from oracles.small_programs import (
    Assign,
    Atom,
    Both,
    Choice,
    Flow,
    Formula,
    If,
    Predicate,
    Problem,
    Statement,
    Term,
    Test,
    choices,
)
from oracles.truth_in_time import (
    ZERO,
    Failure,
    Instant,
    Motion,
    Poly,
    Tree,
    Truth,
    Undecided,
    along,
    constant,
    dyadic,
    first_failure,
    holds,
    negated,
    similar,
    truth,
)

NOW = Instant(ZERO, True)
ENDS = ("terminate", "truncate")


@dataclass(frozen=True)
class Rules:
    """The options that matter here."""

    tolerance: Fraction = Fraction(1, 10**9)
    safety_check: str = "continuous"
    on_blocked: str = "fallback"
    blocked_penalty: Fraction = ZERO
    dt: Fraction | None = None
    max_flow: Fraction = Fraction(1000)
    max_episode_steps: int = 1000
    dues_after_steps: bool = False
    """Whether `safety_check="step"` keeps obligations from being watched along flows too."""


@dataclass(frozen=True)
class State:
    """Values, and the names of those that doubles have rounded."""

    values: Mapping[str, Fraction]
    rough: frozenset[str] = frozenset()

    def still(self) -> Motion:
        return {name: constant(value, name in self.rough) for name, value in self.values.items()}

    def with_value(self, name: str, poly: Poly) -> "State":
        value = poly.coefficient(0)
        rough = self.rough | {name} if poly.rough or not dyadic(value) else self.rough - {name}
        return State({**self.values, name: value}, rough)


class Blocked(Exception):
    """A test or a domain is false."""


@dataclass
class Run:
    """One run of the body: where it is, how long it took, and what was violated on the way."""

    state: State
    duration: Fraction = ZERO
    violated: set[str] = field(default_factory=set[str])
    """@safety predicates and obligations."""
    arrived: set[str] = field(default_factory=set[str])
    """@progress predicates that held at an instant that was watched."""
    cut: bool = False


def satisfied(formula: Formula, state: State, tolerance: Fraction = ZERO) -> bool:
    return holds(truth(formula, state.still(), tolerance), NOW)


# Motion ------------------------------------------------------------------------


def moved(flow: Flow, state: State) -> Motion:
    """Everything as a polynomial of time, by integrating until nothing changes."""
    motion = dict(state.still())
    for _ in range(4):
        following = dict(motion)
        for name, rate in flow.equations:
            speed = along(rate, motion)
            integral = (state.values[name], *(c / (k + 1) for k, c in enumerate(speed.coefficients)))
            rough = name in state.rough or speed.rough
            following[name] = Poly(integral, rough)
        motion = following
    if any(poly.degree() > 2 for poly in motion.values()):
        raise Undecided("motion of a degree above two")
    return {name: Poly(poly.coefficients[:3], poly.rough) for name, poly in motion.items()}


def horizon(flow: Flow, motion: Motion, rules: Rules, loop: bool) -> Instant:
    """The latest end; that of a clock is known without rounding."""
    found: list[Instant] = []
    for part in flow.domain:
        match part:
            case Atom(Term(((one, name, 1),)), "<=", right) if one == 1 and name:
                left, limit = motion[name], along(right, motion)
                if dict(flow.equations).get(name) == Term(((Fraction(1), "", 0),)) and limit.degree() == 0:
                    gap = limit + left.times(Fraction(-1))
                    time = gap.coefficient(0)
                    found.append(Instant(time, not gap.rough and dyadic(time), (gap,)))
            case _:
                pass
    if rules.dt is not None:
        found.append(Instant(rules.dt, dyadic(rules.dt)))
    if found:
        return min(found, key=lambda i: i.time)
    if not loop:
        far = Instant(rules.max_flow, False)
        if first_failure(truth(Both(flow.domain), motion), far):
            return far
    return Instant(Fraction(1, 10), False)


def arrival(flow: Flow, motion: Motion, end: Instant, snap: bool) -> State:
    """The state at `end`; `snap` where the domain ended the flow there, at a bound that still holds."""
    values, rough = dict[str, Fraction](), set[str]()
    moving = dict(flow.equations)
    for name, poly in motion.items():
        values[name] = poly.at(end.time)
        if poly.rough or not dyadic(values[name]) or (name in moving and poly.degree() and not end.sharp):
            rough.add(name)
    for part in flow.domain:
        match part:
            case Atom(Term(((one, name, 1),)), "<=" | ">=", right) if one == 1 and name in moving:
                limit = along(right, motion)
                gap = limit + motion[name].times(Fraction(-1))
                clock = any(gap == zero for zero in end.of)
                met = clock or (snap and any(similar(gap, zero) for zero in end.of))
                if limit.degree() == 0 and met:
                    values[name] = limit.coefficient(0)
                    rough -= set() if limit.rough or not dyadic(values[name]) else {name}
            case _:
                pass
    return State(values, frozenset(rough))


def follow(flow: Flow, run: Run, problem: Problem, rules: Rules, watched: bool) -> None:
    motion = moved(flow, run.state)
    domain = truth(Both(flow.domain), motion)
    end, snap = horizon(flow, motion, rules, problem.loop), False
    if not holds(domain, NOW) or end.time < 0:
        raise Blocked
    failure = first_failure(domain, end)
    if failure and failure.instant.time <= end.time:
        snap = not failure.attained
        at = failure.instant
        end = Instant(at.time, at.time == 0, at.of if snap else ())
    if watched:
        cut = watch(motion, end, run, problem, rules)
        if cut is not None and cut.time < end.time:
            end, snap = Instant(cut.time, cut.time == 0), False
    run.state = arrival(flow, motion, end, snap)
    run.duration += end.time


# What is watched ---------------------------------------------------------------


def watch(motion: Motion, end: Instant, run: Run, problem: Problem, rules: Rules) -> Instant | None:
    """Notes what is violated up to the instant at which the flow is cut, which is returned."""
    failures = {p.name: f for p in problem.predicates if (f := failing(p, motion, end, run, rules))}
    cuts = [f for name, f in failures.items() if cutting(problem, name)]
    if cuts and run.cut:
        raise Undecided("a second cut in one step")
    cut = min(cuts, key=lambda f: (f.instant.time, not f.attained), default=None)
    for name, failure in failures.items():
        if cut is None or before(failure, cut):
            run.violated.add(name)
    run.cut |= cut is not None
    for p in problem.predicates:
        if p.due and arrives(p, motion, cut.instant if cut else end, rules):
            run.arrived.add(p.name)
    return cut.instant if cut else None


def before(failure: Failure, cut: Failure) -> bool:
    """Whether it is seen no later than the cut."""
    if failure is cut or failure.instant.time < cut.instant.time:
        if failure is not cut and cut.instant.time - failure.instant.time < Fraction(1, 10**8):
            raise Undecided("violations within the tolerance")
        return True
    if failure.instant.time == cut.instant.time:
        if failure.attained and cut.attained:
            return True
        raise Undecided("violations at one instant")
    if failure.instant.time - cut.instant.time < Fraction(1, 10**8):
        raise Undecided("violations within the tolerance")
    return False


def failing(p: Predicate, motion: Motion, end: Instant, run: Run, rules: Rules) -> Failure | None:
    """When a @safety predicate, or the obligation of a @progress predicate, is first violated."""
    condition = truth(p.condition, motion, rules.tolerance)
    if p.category == "safety":
        return first_failure(condition, end) if rules.safety_check != "step" else None
    if not p.due or p.name in run.arrived:
        return None
    failure = first_failure(obligation(p, motion, rules), end)
    first = first_failure(negated(condition), end)
    if failure is None or first is None or failure.instant.time < first.instant.time:
        return failure
    if first.instant.time == failure.instant.time:
        raise Undecided("arrival at the instant at which it is due")
    return None


def obligation(p: Predicate, motion: Motion, rules: Rules) -> Truth:
    """Nothing is due, which is exact, or the predicate holds, which is relaxed."""
    idle = Tree(True, tuple(truth(due, motion, positive=False) for due in p.due))
    return Tree(False, (idle, truth(p.condition, motion, rules.tolerance)))


def arrives(p: Predicate, motion: Motion, end: Instant, rules: Rules) -> bool:
    """Whether a predicate holds at an instant up to `end`."""
    return first_failure(negated(truth(p.condition, motion, rules.tolerance)), end) is not None


def cutting(problem: Problem, name: str) -> bool:
    """Whether a violation ends the flow: of @safety that ends the episode. Obligations cut nothing."""
    found = next(p for p in problem.predicates if p.name == name)
    return found.category == "safety" and found.on_failure is not None and found.on_failure.action in ENDS


# Runs --------------------------------------------------------------------------


def execute(problem: Problem, state: State, decisions: Sequence[int], rules: Rules) -> Run:
    """The run that takes these alternatives; raises Blocked."""
    run = Run(state)
    rest: list[Statement] = list(problem.body)
    while rest:
        statement = rest.pop(0)
        match statement:
            case Assign(name, value):
                run.state = run.state.with_value(name, along(value, run.state.still()))
            case Test(condition):
                if not satisfied(condition, run.state):
                    raise Blocked
            case Choice(number, alternatives):
                rest = [*alternatives[decisions[number]], *rest]
            case If(condition, then, otherwise):
                rest = [*(then if satisfied(condition, run.state) else otherwise), *rest]
            case Flow():
                after_steps = rules.safety_check == "step" and rules.dues_after_steps
                watched = rules.safety_check == "flows" or (not rest and not after_steps)
                follow(statement, run, problem, rules, watched)
    return run


def up_to_motion(problem: Problem, state: State, decisions: Sequence[int]) -> bool:
    """Whether a run passes every test up to its first flow, and that flow's domain holds."""
    rest: list[Statement] = list(problem.body)
    while rest:
        match rest.pop(0):
            case Assign(name, value):
                state = state.with_value(name, along(value, state.still()))
            case Test(condition):
                if not satisfied(condition, state):
                    return False
            case Choice(number, alternatives):
                rest = [*alternatives[decisions[number]], *rest]
            case If(condition, then, otherwise):
                rest = [*(then if satisfied(condition, state) else otherwise), *rest]
            case Flow(domain=domain):
                return satisfied(Both(domain), state)
    return True


def requests(problem: Problem) -> list[tuple[int, ...]]:
    """All ways to decide, in the order of the program."""
    sizes = [len(c.alternatives) for c in sorted(choices(problem.body), key=lambda c: c.number)]
    return list(product(*map(range, sizes)))


def deadlocked(problem: Problem, state: State) -> bool:
    return not any(up_to_motion(problem, state, request) for request in requests(problem))


def taken(problem: Problem, state: State, request: tuple[int, ...], rules: Rules) -> tuple[Run | None, bool]:
    """The run that is executed, if any, and whether the requested one is blocked."""
    try:
        return execute(problem, state, request, rules), False
    except Blocked:
        pass
    if rules.on_blocked != "fallback":
        return None, True
    others = sorted(requests(problem), key=lambda other: -agreement(request, other))
    for other in others:
        try:
            return execute(problem, state, other, rules), True
        except Blocked:
            pass
    return None, True


def agreement(one: Sequence[int], other: Sequence[int]) -> int:
    """With how many decisions both begin."""
    return next((k for k, (a, b) in enumerate(zip(one, other, strict=True)) if a != b), len(one))
