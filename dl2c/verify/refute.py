"""Counterexamples: exact runs of a theorem's program after which what it claims is false.

Runs with few iterations of loops are executed symbolically; a solver proposes a first state and decisions,
and `exact` confirms them. Where an equation has no polynomial solution, a first state may show by Lie
derivatives that what is claimed becomes false at once. Runs with many iterations are drawn at random from
first states that a solver proposes. What an obligation says of a loop's invariant is a claim about a program
too, which is refuted in the same way.
"""

import random
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjunction, negation, symbols
from dl2c.ir.model import ZERO, Compare, Formula, Number, Symbol, Truth
from dl2c.parse import tree
from dl2c.parse.printer import print_formula
from dl2c.resolve.shape import conjuncts, statements
from dl2c.resolve.symbols import nodes
from dl2c.smt.portfolio import Outcome
from dl2c.verify.arithmetic.exact import Blocked, Inexact, Run, Undefined, truth
from dl2c.verify.arithmetic.polynomials import NotPolynomial, TooLarge
from dl2c.verify.arithmetic.prover import OutOfTime, Prover
from dl2c.verify.execution import Execution, Goal, Kind, split
from dl2c.verify.field import Field
from dl2c.verify.flows import Flows
from dl2c.verify.invariance import Chains
from dl2c.verify.motion import Motion, motion_formula
from dl2c.verify.random_runs import LONGEST, RandomRun, claim_of
from dl2c.verify.report import Attempt, Counterexample, Obligation, Step
from dl2c.verify.states import Event, Names, State, Unsupported, evaluated, has_program
from dl2c.verify.theorem import Theorem, ending_in, obligation

SHARE = 0.3
"""Of the time of a question."""

WRONG = "J is wrong there"
"""Of a run from a state of a loop's invariant J that leads out of it, or to where the claim fails; or of one
from the beginning to the loop, outside of J."""

TOO_WEAK = "J is too weak there"
"""Of a run from a state of a loop's invariant J, of a step at most, after which a safety predicate fails."""

MAX_GOALS = 300
"""Ends of runs that are looked at, for each number of iterations."""

FIRST_STATES = 8
DRAWN = 60
"""Random runs from each."""


class Found(Exception):
    """A counterexample that is confirmed."""

    def __init__(self, run: Counterexample) -> None:
        super().__init__(run.violated)
        self.run = run


@dataclass(slots=True)
class _Short(Flows):
    """Solutions, and where there is none the state where the equation begins."""

    def follow(self, ode: tree.ODESystem, state: State, names: Names) -> Iterator[State]:
        motion = self.motion(ode, state, names)
        if motion is None:
            return
        curves = self.curves(motion)
        if len(curves) == len(motion.rates):
            yield from self.ended(motion, curves)
        else:
            begun = motion.state.where(Compare("=", motion.clock, ZERO))
            if begun is not None:
                yield begun.after(("duration", motion.clock))


@dataclass(slots=True)
class _Unrolled(Execution):
    """Runs in which every loop is executed at most `most` times, and what such runs leave at once."""

    most: int = 0
    starts: list[tuple[tree.ODESystem, tree.Formula, State]] = field(
        default_factory=list[tuple[tree.ODESystem, tree.Formula, State]]
    )
    first: State | None = None
    """Where the first program begins."""

    def prove(self, formula: tree.Formula, state: State) -> None:
        if isinstance(formula, tree.Box) and self.first is None:
            self.first = state
        if isinstance(formula, tree.Box) and not has_program(formula.child):
            begun = self._begun(statements(formula.program), state)
            self.starts += [(ode, formula.child, s) for ode, s in begun]
        Execution.prove(self, formula, state)

    def _begun(self, program: Sequence[tree.Program], state: State) -> Iterator[tuple[tree.ODESystem, State]]:
        """The equations with which runs may end, and the states where they begin."""
        *before, last = program
        if not isinstance(last, tree.Loop | tree.Choice | tree.ODESystem):
            return
        states = [state]
        for statement in before:
            states = [s for one in states for s in self.after(statement, one)]
        for s in states:
            match last:
                case tree.ODESystem():
                    yield last, s
                case tree.Loop(child):
                    yield from self._begun(statements(child), s.after(("again", 1)))
                case tree.Choice(left, right):
                    yield from self._begun(statements(left), s.after(("choice", 0)))
                    yield from self._begun(statements(right), s.after(("choice", 1)))

    def _loop(self, loop: tree.Loop, state: State) -> Iterator[State]:
        yield state.after(("again", 0))
        states = [state]
        for _ in range(self.most):
            states = [s for one in states for s in self.after(loop.child, one.after(("again", 1)))]
            for s in states:
                yield s.after(("again", 0))


@dataclass(slots=True)
class _Noted(Run):
    """Notes the state in which it passes `head`, and how many decisions were taken before. `until` is an
    equation: the run that takes all decisions stops where it begins, and notes the state there in `stopped`.
    """

    head: tree.Program | None = None
    until: tree.ODESystem | None = None
    begun: tuple[dict[str, Fraction], int] = field(default_factory=lambda: ({}, 0))
    stopped: dict[str, Fraction] | None = None
    steps: list[Step] = field(default_factory=list[Step])
    since: int | None = None
    """How many decisions were taken where the last iteration of an outermost loop began; None outside."""

    def __post_init__(self) -> None:
        self.begun = dict(self.values), 0

    def iterate(self, body: tree.Program) -> None:
        if self.since is not None:
            self.follow(body)
            return
        self.since = len(self.taken)
        self.follow(body)
        self.steps.append(Step(tuple(self.taken[self.since :]), dict(self.values)))
        self.since = None

    def follow(self, program: tree.Program) -> None:
        if program is self.head:
            self.begun = dict(self.values), len(self.taken)
        if program is self.until and len(self.taken) == len(self.decisions):
            assert isinstance(program, tree.ODESystem)
            if truth(program.domain, self.values):
                self.stopped = dict(self.values)
            raise Blocked
        Run.follow(self, program)

    def shows(self, formula: tree.Formula) -> bool:
        """Whether it is a run that shows that a formula is false."""
        with suppress(Inexact, Blocked, Undefined):
            return self.violates(formula)
        return False

    def found(self, violated: str, loops: bool) -> "Found":
        """The counterexample that it is, of a program with loops or without."""
        state, before = self.begun
        steps, end = list(self.steps), dict(self.values) if self.stopped is None else None
        if self.since is not None or not loops:
            steps.append(Step(tuple(self.taken[self.since or 0 :]), end))
        return Found(Counterexample(state, tuple(self.taken[before:]), violated, tuple(steps)))


@dataclass(slots=True)
class Refutation:
    """The search for a counterexample to one theorem, from states of which `within` holds too. What is found
    begins where runs pass `head`.
    """

    theorem: Theorem
    prover: Prover
    within: Formula = Truth(True)
    head: tree.Program | None = None

    def search(self, iterations: Sequence[int] = (0, 1, 2)) -> Counterexample | None:
        """A confirmed counterexample with so many iterations of loops, at most. Raises `OutOfTime`."""
        try:
            for most in iterations if self._loops else iterations[:1]:
                self._runs(most)
        except Found as found:
            return found.run
        return None

    def at_random(self, seed: int = 0) -> Counterexample | None:
        """A confirmed counterexample among random runs, of those from one first state the shortest. Raises
        `OutOfTime`.
        """
        chance, claim = random.Random(seed), claim_of(self.theorem.formula)
        if claim is None:
            return None
        for values in self._first_states(chance):
            found, most = None, LONGEST
            for _ in range(DRAWN):
                run = RandomRun(self._first(values), (), [], self.prover.in_time, claim, chance, most)
                if run.succeeds() and (shown := self._confirmed(run, values)):
                    found, most = shown, run.iterations - 1
            if found is not None:
                return found
        return None

    def _first_states(self, chance: random.Random) -> Iterator[Mapping[str, Fraction]]:
        """States where the program may begin, here and there."""
        execution = _Unrolled(_Short(self.prover), Names(), {}, if_defined=True)
        state = State(self.theorem.scope).where(self.within)
        if state is None:
            return
        with suppress(Unsupported, CompileError):
            execution.prove(self.theorem.formula, state)
        if execution.first is None:
            return
        facts = execution.first.facts
        names = sorted(symbols(*facts), key=str)
        without: Formula = Truth(False)
        for _ in range(FIRST_STATES):
            for values in _rational(self.prover.decide(facts, without, SHARE)):
                yield values
                if names:
                    name = chance.choice(names)
                    limit = values.get(name.name, Fraction(0)) + chance.choice((-10, -1, 1, 10))
                    without = Compare(chance.choice(("<", ">")), name, Number(limit))

    def _confirmed(self, run: RandomRun, values: Mapping[str, Fraction]) -> Counterexample | None:
        """The counterexample that a random run is, where taking its decisions again shows it."""
        events: list[tuple[Event, Fraction]] = [((kind, 0), value) for kind, value in run.drawn]
        again = self._noted(values, events)
        if not again.shows(self.theorem.formula) or run.violated is None:
            return None
        parts = [p for p in conjuncts(run.violated) if truth(tree.Not(p), again.values)]
        return again.found(" ".join(print_formula(parts[0] if parts else run.violated).split()), True).run

    @property
    def _loops(self) -> bool:
        return any(isinstance(n, tree.Loop) for n in nodes(self.theorem.formula))

    def _runs(self, most: int) -> None:
        names = Names()
        execution = _Unrolled(_Short(self.prover), names, {}, if_defined=True, most=most)
        state = State(self.theorem.scope).where(self.within)
        if state is None:
            return
        with suppress(Unsupported, CompileError):
            execution.prove(self.theorem.formula, state)
        for goal in [part for g in execution.goals for part in split(g)][:MAX_GOALS]:
            self._goal(goal)
        if most == 0:
            for ode, child, before in execution.starts[:MAX_GOALS]:
                self._leaving(ode, child, before, names)

    def _run(self, state: State, values: Mapping[str, Fraction]) -> _Noted:
        """The run of a state's trail."""
        return self._noted(values, _decisions(state.trail, values))

    def _noted(self, values: Mapping[str, Fraction], events: Sequence[tuple[Event, Fraction]]) -> _Noted:
        return _Noted(self._first(values), events, [], self.prover.in_time, self.head)

    def _goal(self, goal: Goal) -> None:
        """Raises `Found` if the goal fails in a run that is confirmed."""
        outcome = self.prover.decide(goal.state.facts, goal.formula, SHARE)
        for values in _rational(outcome):
            run = self._run(goal.state, values)
            if run.shows(self.theorem.formula):
                raise run.found(_claim_of(goal), self._loops)

    def _leaving(self, ode: tree.ODESystem, child: tree.Formula, state: State, names: Names) -> None:
        """Raises `Found` if a motion makes `child` false as soon as it begins."""
        flows = _Short(self.prover)
        try:
            motion = flows.motion(ode, state, names)
            if motion is None or not motion.bounded or (wanted := motion_formula(child, motion)) is None:
                return
            gone = _leaves(motion, wanted, names)
        except (Unsupported, CompileError, NotPolynomial, TooLarge):
            return
        outcome = self.prover.decide(motion.state.facts, negation(motion.initially(gone)), SHARE)
        for values in _rational(outcome):
            run = self._run(state, values)
            run.until = ode
            run.shows(self.theorem.formula)
            known = {Symbol(n, k): Number(v) for n, v in values.items() for k in ("variable", "constant")}
            if run.stopped is not None and evaluated(motion.initially(gone), known) == Truth(True):
                said = f"{' '.join(print_formula(child).split())}, as soon as the equation is followed"
                raise run.found(said, self._loops)

    def _first(self, values: Mapping[str, Fraction]) -> dict[str, Fraction]:
        """The first state: what the solver does not mention is 0."""
        return {
            name: term.value if isinstance(term, Number) else values.get(name, Fraction(0))
            for name, term in sorted(self.theorem.scope.items())
            if not name.endswith("()")
        }


def _leaves(motion: Motion, wanted: Formula, names: Names) -> Formula:
    """That a motion stays in its domain for a while, where `wanted` is false. Raises `NotPolynomial`."""
    field_ = Field(dict(motion.rates), names, lambda _: False)
    if not field_.smooth:
        raise NotPolynomial("rates")
    against = field_.formula(negation(wanted))
    domain = field_.formula(motion.domain)
    if field_.known:
        raise NotPolynomial("functions, whose values no rational state gives")
    chains = Chains(field_, field_.ring(against, domain))
    return conjunction([chains.entered(domain, 1, over=False), chains.entered(against, 1, over=False)])


def _rational(outcome: Outcome) -> Iterator[Mapping[str, Fraction]]:
    """The values of a solution, irrational ones replaced by simple numbers nearby."""
    if outcome.verdict != "sat" or outcome.solver == "cvc5":
        return
    exact = {n: v for n, v in outcome.values.items() if isinstance(v, Fraction)}
    if len(exact) == len(outcome.values):
        yield exact
        return
    for size in (10, 1000, 10**6):
        near = {
            n: Fraction(v.rstrip("?")).limit_denominator(size)
            for n, v in outcome.values.items()
            if isinstance(v, str)
        }
        yield {**exact, **near}


def _decisions(trail: Sequence[Event], values: Mapping[str, Fraction]) -> list[tuple[Event, Fraction]]:
    return [
        (
            event,
            values.get(event[1].name, Fraction(0)) if isinstance(event[1], Symbol) else Fraction(event[1]),
        )
        for event in trail
    ]


def _claim_of(goal: Goal) -> str:
    """The claim that fails, as the text has it."""
    return " ".join(goal.place.text.split()) or "the claim"


def examined(attempt: Attempt, theorem: Theorem, prover: Prover) -> Attempt:
    """The attempt, its obligations about loops and safety predicates refuted where an exact run does so."""
    found = list(attempt.obligations)
    with suppress(OutOfTime):
        for k, one in enumerate(found):
            if one.answer == "unknown" and (one.loop or one.kind == "safety"):
                found[k] = _examined(one, attempt, theorem, prover)
    return replace(attempt, obligations=found)


def _examined(one: Obligation, attempt: Attempt, theorem: Theorem, prover: Prover) -> Obligation:
    begun = time.monotonic()
    for claim, head in _claims(one, attempt, theorem):
        run = Refutation(claim, prover, head=head).search()
        if run is not None:
            seconds = one.seconds + time.monotonic() - begun
            reason = "" if head is None else TOO_WEAK if one.kind == "safety" else WRONG
            return replace(one, answer="refuted", seconds=seconds, reason=reason, counterexample=run)
    return one


def _claims(
    one: Obligation, attempt: Attempt, theorem: Theorem
) -> Iterator[tuple[Theorem, tree.Program | None]]:
    """Claims that are true if an obligation holds, each with where runs that refute it begin."""
    predicates = [f for name, f in theorem.safety if name == one.predicate]
    if not one.loop:
        yield replace(theorem, formula=ending_in(theorem.formula, predicates[0])), None
        return
    loop = attempt.loops[one.loop - 1]
    parts = attempt.invariants.get(loop.span, ())
    lost = [p for k, p in enumerate(parts) if (loop.span, k) in attempt.lost]
    kinds: tuple[Kind, ...] = ("safety", "step") if one.kind == "safety" else (one.kind,)
    for kind in kinds:
        claim = obligation(theorem, loop, kind, parts, predicates or lost)
        if claim is not None:
            yield claim
