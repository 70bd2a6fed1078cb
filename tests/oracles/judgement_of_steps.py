"""What a step is said to be: reward, cost, status, reason and end, from the run that it executed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from oracles.run_enumeration import NOW, Rules, Run, State, deadlocked, obligation, satisfied, taken
from oracles.small_programs import Atom, Both, Either, Ending, Formula, Negation, Predicate, Problem, Term
from oracles.truth_in_time import ZERO, Motion, Undecided, along, holds

CATEGORIES = ("safety", "progress", "stability")
STATUSES = ("failure", "success", "none")
POSTCONDITION = Ending("terminate", "failure")


@dataclass(frozen=True)
class Outcome:
    """None in `reason`, `status` or `reward` where the rules leave it open."""

    state: State
    duration: Fraction
    blocked: bool
    reward: Fraction
    cost: int
    status: str | None
    reason: str | None
    terminated: bool
    truncated: bool

    def ended(self) -> bool:
        return self.terminated or self.truncated


def distance(formula: Formula, motion: Motion, positive: bool = True) -> Fraction:
    """How far inside a formula a state is; negative outside."""
    match formula:
        case Both(parts) | Either(parts):
            least = isinstance(formula, Both) == positive
            return (min if least else max)(distance(part, motion, positive) for part in parts)
        case Negation(of):
            return distance(of, motion, not positive)
        case Atom(left, op, right):
            gap = along(right, motion).coefficient(0) - along(left, motion).coefficient(0)
            if op in ("=", "!="):
                return abs(gap) if (op == "!=") == positive else -abs(gap)
            return gap if (op in ("<", "<=")) == positive else -gap


def worth(said: Term | str | None, problem: Problem, state: State) -> Fraction:
    match said:
        case None:
            return ZERO
        case str():
            named = next(p for p in problem.predicates if p.name == said)
            return distance(named.condition, state.still())
        case _:
            return along(said, state.still()).coefficient(0)


@dataclass(frozen=True)
class Firing:
    ending: Ending
    category: str
    place: int
    name: str

    def rank(self) -> tuple[int, int, int]:
        return STATUSES.index(self.ending.status), CATEGORIES.index(self.category), self.place


def due_failed(p: Predicate, run: Run, rules: Rules, last_step: bool, held: bool) -> bool:
    """Whether `on_failure` of a @progress predicate counts."""
    if not p.due:
        return last_step and not held
    if p.name in run.violated:
        return True
    if p.name in run.arrived:
        return False
    return not holds(obligation(p, run.state.still(), rules), NOW)


def firings(
    problem: Problem, run: Run, held: Mapping[str, bool], rules: Rules, last_step: bool
) -> list[Firing]:
    found: list[Firing] = []
    for place, p in enumerate(problem.predicates):
        failed = not held[p.name]
        if p.category == "progress" and p.on_failure:
            failed = due_failed(p, run, rules, last_step, held[p.name])
        if p.on_failure and failed:
            found.append(Firing(p.on_failure, p.category, place, p.name))
        if p.on_success and held[p.name]:
            found.append(Firing(p.on_success, p.category, place, p.name))
    return sorted(found, key=Firing.rank)


def step(problem: Problem, state: State, request: tuple[int, ...], rules: Rules, number: int) -> Outcome:
    """The `number`th step of an episode, counted from 1."""
    if not problem.predicates:
        problem = unannotated(problem)
    run, blocked = taken(problem, state, request, rules)
    penalty = rules.blocked_penalty if blocked else ZERO
    if run is None:
        return nothing_done(problem, state, rules, penalty)
    latched = {p.name for p in problem.predicates if p.category == "safety"} & run.violated
    held = {
        p.name: p.name not in latched and satisfied(p.condition, run.state, rules.tolerance)
        for p in problem.predicates
    }
    reward = penalty
    for p in problem.predicates:
        reward += worth(p.reward if held[p.name] else p.penalty, problem, run.state)
        reward += worth(p.shape, problem, run.state)
    cost = sum(p.category == "safety" and not held[p.name] for p in problem.predicates)
    last = problem.loop and number == rules.max_episode_steps
    fired = firings(problem, run, held, rules, last)
    status, reason, flag = end_of_step(problem, run.state, fired, last)
    return Outcome(
        run.state,
        run.duration,
        blocked,
        reward,
        cost,
        status,
        reason,
        flag == "terminate",
        flag == "truncate",
    )


def end_of_step(
    problem: Problem, state: State, fired: list[Firing], last: bool
) -> tuple[str | None, str | None, str]:
    """Status, reason, and the action that ends the episode or nothing."""
    winner = next((f for f in fired if f.ending.action != "continue"), None)
    if winner:
        return winner.ending.status, winner.name, winner.ending.action
    written = fired[0].ending.status if fired else "none"
    settled = "none" if written == "none" else None
    if not problem.loop:
        return settled, "end", "terminate"
    if deadlocked(problem, state):
        return settled, None if last else "deadlock", "truncate"
    if last:
        return "none", "time_limit", "truncate"
    return written, "", ""


def nothing_done(problem: Problem, state: State, rules: Rules, penalty: Fraction) -> Outcome:
    """No predicate fires. Where no other run was found either, nothing has one: a deadlock."""
    shapes = sum((worth(p.shape, problem, state) for p in problem.predicates), ZERO) if problem.loop else ZERO
    terminate, asked = rules.on_blocked == "terminate", rules.on_blocked != "fallback"
    reason = "blocked" if asked else "deadlock"
    return Outcome(state, ZERO, True, shapes + penalty, 0, "none", reason, terminate, not terminate)


def unannotated(problem: Problem) -> Problem:
    """The postcondition is a predicate like any other."""
    one = Term(((Fraction(-1), "", 0),))
    claim = Predicate("postcondition", "safety", problem.extra, penalty=one, on_failure=POSTCONDITION)
    return Problem(problem.variables, problem.body, problem.loop, (claim,))


def agreed(problem: Problem, state: State, request: tuple[int, ...], rules: Rules, number: int) -> Outcome:
    """The outcome, if it does not depend on whether obligations are watched where safety is not."""
    outcome = step(problem, state, request, rules, number)
    if rules.safety_check == "step" and any(p.due for p in problem.predicates):
        other = step(problem, state, request, replace(rules, dues_after_steps=True), number)
        if outcome != other:
            raise Undecided("obligations where safety is judged after steps")
    return outcome
