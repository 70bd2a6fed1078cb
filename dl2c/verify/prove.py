"""Prove or refute the theorem of a model (`dl2c verify`).

First with what the text gives, then with candidates of its tactics and goals, then with invented ones.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjunction, limits_of
from dl2c.ir.model import FALSE, TRUE, Bound, Formula
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.printer import print_formula
from dl2c.resolve.shape import statements
from dl2c.resolve.symbols import nodes
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source, Span
from dl2c.verify.arithmetic.prover import OutOfTime, Prover
from dl2c.verify.execution import Execution, Goal, split
from dl2c.verify.flows import Flows
from dl2c.verify.refute import Refutation, examined
from dl2c.verify.report import (
    Answer,
    Attempt,
    Counterexample,
    Invariants,
    Obligation,
    Report,
    better,
    joined,
    safe_with,
    versions,
)
from dl2c.verify.stability.guesses import guesses
from dl2c.verify.states import Event, Names, State, Unsupported, partial
from dl2c.verify.theorem import (
    Theorem,
    candidates,
    conclusions,
    loops_of,
    parts_of,
    theorem_in,
    with_consequent,
)

FINAL = ("proved", "refuted", "not checked")
"""Answers that no further search makes better: with the last all that is checked is proved."""

UNDECIDED = ("unknown", "refuted")
"""Answers for a theorem that may be another one within bounds."""

EFFORTS = (0, 1, 2, 3)
"""Of flows: see `Flows`."""

PACES = (0.12, 1.0)
"""Of the time of a question: first everything is tried in haste."""

PATIENT = 0.5
"""Of that time: for what the text says, before anything else is tried."""

PATIENCE = (0.3, 0.6)
"""Of the time that is left: for that, with the first efforts."""

SEARCH = 0.25
"""Of the time that is left: for the first search for a counterexample."""

CHANCE, LAST_CHANCE = 0.03, 0.3
"""The same for random runs, at first and at last."""

EXAMINATION = 0.15
"""Of the time that is left: for whether invariants that are not proved are wrong."""

VACUITY = 0.1
"""Of the time of a question: for whether any state is meant."""

MOST_ENDS = 20
"""Of runs of a body that are asked whether there are any."""

MAX_POOL = 40
"""Candidates for the invariant of one loop."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Seconds for one question and for everything; processes; whether all solvers are asked; a folder for
    the questions."""

    each: float = 10.0
    total: float = 60.0
    jobs: int = 2
    agree: bool = False
    keep: Path | None = None


DEFAULT = Limits()


def prove(
    source: Source, options: Options, limits: Limits = DEFAULT, told: Callable[[str], None] = lambda _: None
) -> Report:
    """What is known of the theorem of a model. Raises `CompileError` for a mistake in the model."""
    return prove_theorem(theorem_in(source, options), limits, told)


def prove_theorem(
    theorem: Theorem,
    limits: Limits = DEFAULT,
    told: Callable[[str], None] = lambda _: None,
    solvers: Portfolio | None = None,
) -> Report:
    """What is known of a claim; `solvers` are used and kept, else some are started."""
    begun = time.monotonic()
    own = nullcontext(solvers) if solvers is not None else Portfolio(limits.jobs, agree=limits.agree)
    with own as portfolio:
        prover = Prover(portfolio, limits.each, begun + limits.total, told=told)
        if limits.keep is not None:
            limits.keep.mkdir(parents=True, exist_ok=True)
            prover.keep = limits.keep
        with prover.share(0.6 if theorem.bounds else 0.8 if partial(theorem.formula) else 1.0):
            attempt = Proof(theorem, prover).best()
        if attempt.answer == "unknown" and partial(theorem.formula) and not prover.interrupted:
            attempt = _if_defined(theorem, prover, attempt)
        within = _within_bounds(theorem, prover) if attempt.answer in UNDECIDED else attempt.answer
    cuts = {n.span for n in nodes(theorem.formula) if isinstance(n, tree.ODESystem)}
    return Report(
        theorem.name,
        attempt.answer,
        within,
        tuple(attempt.obligations),
        tuple(print_formula(f) for s, parts in attempt.invariants.items() if s not in cuts for f in parts),
        attempt.invented,
        time.monotonic() - begun,
        prover.asked,
        tuple(s for s in prover.solvers if s),
        versions(prover.solvers),
        attempt.counterexample,
        attempt.warnings,
        prover.interrupted,
    )


def _if_defined(theorem: Theorem, prover: Prover, attempt: Attempt) -> Attempt:
    """The better attempt where terms without values make atoms false, and only that is assumed of them."""
    prover.if_defined = True
    try:
        with prover.share(0.5):
            other = Proof(theorem, prover).best(refute=False)
    finally:
        prover.if_defined = False
    if other.answer != "proved":
        return attempt
    changed = [
        replace(o, answer="proved-if-defined") if o.answer == "proved" else o for o in other.obligations
    ]
    return replace(other, obligations=changed)


def _within_bounds(theorem: Theorem, prover: Prover) -> Answer:
    """The answer where every name that has a bound begins inside of it."""
    sides = [
        side
        for name, (low, high) in theorem.bounds.items()
        for side in limits_of(theorem.scope[name], Bound(low, high))
    ]
    if not sides or prover.interrupted:
        return "unknown"
    return Proof(theorem, prover, conjunction(sides)).best().answer


@dataclass(slots=True)
class Proof:
    """The search for a proof of one theorem."""

    theorem: Theorem
    prover: Prover
    within: Formula = TRUE
    loops: list[tree.Loop] = field(default_factory=list[tree.Loop])

    def __post_init__(self) -> None:
        self.loops = list(loops_of(self.theorem.formula))

    @property
    def one_step(self) -> bool:
        """Whether the program is one step: no loop stands outside of all other statements."""
        boxes = [n for n in nodes(self.theorem.formula) if isinstance(n, tree.Box)]
        return not any(isinstance(s, tree.Loop) for box in boxes for s in statements(box.program))

    def best(self, refute: bool = True) -> Attempt:
        """The best attempt within the time; without looking for counterexamples unless `refute`."""
        found: Attempt | None = None
        try:
            for step in self._steps(refute):
                if step is not None and (found is None or better(step, found)):
                    found = step
                if found is not None and found.answer in FINAL:
                    return self._with_safety(found) if refute else found
        except OutOfTime:
            pass
        except KeyboardInterrupt:
            self.prover.interrupted = True
        place = self.theorem.formula.span
        return found or Attempt({}, [Obligation("program", 0, place, "unknown", reason="out of time")])

    def _steps(self, refute: bool) -> Iterator[Attempt | None]:
        """One attempt after the other, the most promising first."""
        written = {loop.span: parts_of(loop.invariants) for loop in self.loops}
        hopeful = all(written.values())
        for pace in PACES:
            self.prover.pace = pace
            one = self.attempt(written, EFFORTS[0]) if hopeful else None
            yield one
            if refute and pace == PACES[0]:
                yield self._refuted(lambda r: r.search((0, 1, 2)), SEARCH)
                yield self._refuted(Refutation.at_random, CHANCE)
            if one is not None and refute:
                yield (one := self._examined(one))
                hopeful = not any(o.wrong_invariant for o in one.obligations)
            yield from self._efforts(written, EFFORTS[1:]) if hopeful else ()
            yield from self._found(written)
        if refute:
            yield self._refuted(lambda r: r.at_random(seed=1), LAST_CHANCE)
            yield self._refuted(lambda r: r.search((3, 6, 13)))

    def _found(self, written: Invariants) -> Iterator[Attempt | None]:
        """Attempts with invariants of loops that the text does not give."""
        for guess in guesses(self.theorem):
            hasty = self.prover.pace == PACES[0]
            found = self._patient(guess, 0, PATIENCE[0]) if hasty else self.attempt(guess, 0)
            yield found and replace(found, invented=True)
        if not self.loops:
            return
        for hint in self.theorem.hints.loops:
            hinted = {span: parts or parts_of((hint,)) for span, parts in written.items()}
            for found in self._efforts(hinted) if hinted != written else ():
                yield found and replace(found, invented=True)
        yield from self._weakened(written)

    def _efforts(self, invariants: Invariants, efforts: Sequence[int] = EFFORTS) -> Iterator[Attempt | None]:
        """Attempts with more and more effort; as long as there is haste, after patient ones."""
        if self.prover.pace == PACES[0]:
            yield from (self._patient(invariants, *spent) for spent in zip(EFFORTS, PATIENCE, strict=False))
        yield from (self.attempt(invariants, effort) for effort in efforts)

    def _patient(self, written: Invariants, effort: int, part: float) -> Attempt | None:
        """By what the text says, in a part of the time, with more for each question, if all is proved so."""
        before, self.prover.pace = self.prover.pace, PATIENT
        try:
            with self.prover.share(part):
                found = self.attempt(written, effort, whole=False)
        except OutOfTime:
            return None
        finally:
            self.prover.pace = before
        return found if found.answer in FINAL else None

    def _refuted(
        self, search: Callable[[Refutation], Counterexample | None], part: float = 1.0
    ) -> Attempt | None:
        """The theorem refuted by a run that a search finds in a part of the time."""
        begun = time.monotonic()
        try:
            with self.prover.share(part):
                run = search(Refutation(self.theorem, self.prover, self.within))
        except OutOfTime:
            return None
        if run is None:
            return None
        place = self.theorem.formula.span
        one = Obligation("program", 0, place, "refuted", time.monotonic() - begun, counterexample=run)
        return Attempt({}, [one])

    def _with_safety(self, attempt: Attempt) -> Attempt:
        """The attempt with more answers about safety predicates, if some are not known."""
        if attempt.answer != "proved" or attempt.invented or self.within != TRUE:
            return attempt
        self.prover.pace = PACES[-1]
        attempt = self._examined(attempt)
        with suppress(OutOfTime), self.prover.share(SEARCH):
            for effort in EFFORTS:
                if all(o.answer != "unknown" for o in attempt.obligations):
                    break
                other = self.attempt(attempt.invariants, effort)
                proved = {o.title: o for o in other.obligations if o.answer == "proved"}
                known = [proved.get(o.title, o) if o.answer == "unknown" else o for o in attempt.obligations]
                attempt = replace(attempt, obligations=known)
        return attempt

    def _examined(self, attempt: Attempt) -> Attempt:
        """The attempt, its obligations refuted where an exact run does so, which bounds do not limit."""
        if self.within != TRUE:
            return attempt
        with self.prover.share(EXAMINATION):
            return examined(attempt, self.theorem, self.prover)

    def _weakened(self, written: Invariants) -> Iterator[Attempt]:
        """Houdini: all that may be an invariant, without what is not kept, until the rest is."""
        pool = candidates(self.theorem)
        invariants = {
            span: tuple(dict.fromkeys((*parts, *pool)))[:MAX_POOL] for span, parts in written.items()
        }
        for effort in EFFORTS:
            current: Invariants = invariants
            while True:
                attempt = self.attempt(current, effort)
                yield replace(attempt, invented=True)
                kept = {
                    span: tuple(p for k, p in enumerate(parts) if (span, k) not in attempt.lost)
                    for span, parts in current.items()
                }
                if kept == current:
                    break
                current = kept

    def attempt(self, invariants: Invariants, effort: int, whole: bool = True) -> Attempt:
        """The answers with these invariants; unless `whole`, up to the first goal that is not proved."""
        execution = self._executed(invariants, effort)
        found: dict[tuple[str, int, str], Obligation] = {}
        lost: set[tuple[Span, int]] = set()
        left: set[tuple[Event, ...]] = set()
        broken = {gap.loop for gap in execution.gaps if gap.kind == "step"}
        for goal in (part for g in execution.goals for part in split(g)):
            key = goal.kind, goal.loop, goal.predicate
            if goal.ending and safe_with(found.get(key), goal.state.trail in left or goal.loop in broken):
                continue
            one = self._answered(goal)
            if one.answer != "proved" and goal.kind in ("initially", "step"):
                lost.add((execution.loops[goal.loop - 1].span, goal.part))
                left.add(goal.state.trail)
            found[key] = joined(found[key], one) if key in found else one
            if not whole and one.answer != "proved":
                break
        for gap in execution.gaps:
            key = gap.kind, gap.loop, gap.predicate
            answer: Answer = "unknown" if gap.checked else "not checked"
            one = Obligation(
                gap.kind, gap.loop, gap.place, answer, reason=gap.reason, predicate=gap.predicate
            )
            found[key] = joined(found[key], one) if key in found else one
        rules = tuple(sorted(execution.flows.rules))
        nothing = Obligation("program", 0, self.theorem.formula.span, "proved")
        answers = [replace(o, rules=rules) for o in found.values() or (nothing,)]
        warnings = tuple(self._vacuous(execution))
        return Attempt(invariants, answers, execution.loops, lost=lost, warnings=warnings)

    def _answered(self, goal: Goal) -> Obligation:
        """Whether a goal is proved. Raises `OutOfTime`."""
        begun = time.monotonic()
        self.prover.told(f"{goal.kind} {goal.loop or ''}".strip())
        outcome = self.prover.decide(goal.state.facts, goal.formula)
        return Obligation(
            goal.kind,
            goal.loop,
            goal.place,
            "proved" if outcome.verdict == "unsat" else "unknown",
            time.monotonic() - begun,
            solvers=(outcome.solver,) if outcome.solver else (),
            predicate=goal.predicate,
        )

    def _vacuous(self, execution: Execution) -> Iterator[str]:
        """What is proved for want of states: assumptions or invariants that no state satisfies, and steps of
        which no run comes to its end.
        """
        for what, place, state in execution.reached:
            if self.prover.valid(state.facts, FALSE, VACUITY):
                yield f"vacuous-{what}: no state satisfies the {what} at {place.place}"
        for number in range(1, len(execution.loops) + 1):
            ends = [g.state for g in execution.goals if (g.kind, g.loop) == ("step", number)]
            if ends and all(self.prover.valid(s.facts, FALSE, VACUITY) for s in ends[:MOST_ENDS]):
                yield f"vacuous-step: no run of the body of loop {number} comes to its end"

    def _executed(self, invariants: Invariants, effort: int) -> Execution:
        safety = self.theorem.safety
        wanted = [p for parts in invariants.values() for part in parts for p in with_consequent(part)]
        wanted += [*conclusions(self.theorem.formula), *(f for _, f in safety if self.one_step)]
        execution = Execution(
            Flows(self.prover, effort, self.theorem.hints.flows, wanted, invariants),
            Names(),
            invariants,
            safety,
            self.prover.if_defined,
            remembering=effort == EFFORTS[-1],
            one_step=self.one_step,
        )
        state = State(self.theorem.scope).where(self.within)
        try:
            if state is not None:
                execution.prove(self.theorem.formula, state)
        except Unsupported as missing:
            execution.stop(missing.span, str(missing))
        except CompileError as refused:
            d = refused.diagnostics[0]
            execution.stop(d.span, d.title)
        return execution
