"""Questions of the rules, answered by solvers within limits of time."""

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from dl2c.ir.logic import conjuncts, negation, symbols
from dl2c.ir.model import FALSE, TRUE, Compare, Formula, Or, Symbol
from dl2c.ir.printer import print_formula
from dl2c.smt.lines import script
from dl2c.smt.portfolio import UNDECIDED, Outcome, Portfolio, Solver
from dl2c.verify.arithmetic.cases import Signs, cases_of, disjunctions
from dl2c.verify.arithmetic.products import scripts
from dl2c.verify.arithmetic.quotients import cleared, positive_symbols
from dl2c.verify.arithmetic.squares import implied, with_known
from dl2c.verify.arithmetic.total import is_total, needed, totalised, without_cases
from dl2c.verify.states import connected

PROVED = Outcome("unsat", "")
"""What needs no solver."""

QUICK = 0.4
"""Seconds after which products of facts are tried."""

LINEAR = 1.5
"""Seconds for one question of linear arithmetic."""

LAST = 1.0
"""Seconds for the comparisons of a case."""

MOST_TRIED = 5
"""Disjunctions that are tried alone before they are combined."""

MOST_FACTORS = 4
"""Of products of facts."""

MOST_CONDITIONS, BRIEF = 4, 0.3
"""Under which terms of the facts have values, and seconds for each."""

TOO_SHORT = 0.6
"""Seconds in which nothing but solvers is worth while."""

MOST_SPLITS = 6
"""Disjunctions among facts that are taken apart, one inside the other."""

MAX_TEXT = 400_000
"""Characters of a question."""


class OutOfTime(Exception):
    """The time of the whole proof is over."""


@dataclass(slots=True)
class Prover:
    """Asks `portfolio`, each question at most `each` seconds, until `deadline` on the monotonic clock.

    `pace` is the part of that time that questions get at present. With `if_defined`, hypotheses hold only
    where their terms are defined. `keep` is a folder for questions, `told` hears what is worked on, `asked`
    counts questions, `solvers` who answered how many.
    """

    portfolio: Portfolio
    each: float
    deadline: float
    pace: float = 1.0
    if_defined: bool = False
    keep: Path | None = None
    told: Callable[[str], None] = lambda _: None
    asked: int = 0
    interrupted: bool = False
    solvers: dict[str, int] = field(default_factory=dict[str, int])
    answers: dict[tuple[str, float], Outcome] = field(default_factory=dict[tuple[str, float], Outcome])

    @property
    def left(self) -> float:
        """Seconds that are left."""
        return self.deadline - time.monotonic()

    def in_time(self) -> float:
        """Seconds that are left, more than none. Raises `OutOfTime`."""
        if (left := self.left) <= 0:
            raise OutOfTime
        return left

    @contextmanager
    def share(self, part: float) -> Generator[None]:
        """Work within a part of the time that is left; at its end raises `OutOfTime` as at the very end."""
        whole = self.deadline
        self.deadline = time.monotonic() + self.left * part
        try:
            yield
        finally:
            self.deadline = whole

    def valid(self, facts: Sequence[Formula], goal: Formula, share: float = 1.0) -> bool:
        """Whether the facts imply the goal. Raises `OutOfTime`."""
        return all(self.decide(facts, g, share).verdict == "unsat" for g in conjuncts(goal))

    def decide(self, facts: Sequence[Formula], goal: Formula, share: float = 1.0) -> Outcome:
        """Whether the facts imply a goal, "unsat", or a state in which they hold and it does not, "sat".

        Gets `share` of the seconds of a question. Raises `OutOfTime`.
        """
        if goal == TRUE or goal in facts or FALSE in facts:
            return PROVED
        near = connected(facts, goal)
        if goal == FALSE or len(near) == len(facts):
            return self._asked(facts, goal, share)
        found = self._asked(near, goal, share)
        if found.verdict == "unsat":
            return found
        rest = self._asked([f for f in facts if f not in near], FALSE, share)
        if "sat" == found.verdict == rest.verdict:
            return Outcome("sat", found.solver, {**found.values, **rest.values})
        return rest if rest.verdict == "unsat" else UNDECIDED

    def _asked(self, facts: Sequence[Formula], goal: Formula, share: float) -> Outcome:
        text, names = script(*self._posed(facts, goal))
        if len(text) > MAX_TEXT:
            return UNDECIDED
        seconds = min(self.each * share * self.pace, self.in_time())
        known = self.answers.get((text, 0.0)) or self.answers.get((text, share * self.pace))
        if known is None:
            known = self._decided(text, names, facts, goal, seconds)
            self.asked += 1
            self.solvers[known.solver] = self.solvers.get(known.solver, 0) + 1
            self.answers[text, 0.0 if known.verdict != "unknown" else share * self.pace] = known
            if self.keep is not None:
                self._write(text, facts, goal, known)
        return known

    def _posed(self, facts: Sequence[Formula], goal: Formula) -> tuple[list[Formula], Formula]:
        """A question as polynomials."""
        positive = positive_symbols(facts)
        plain = [cleared(f, positive) for f in facts]
        given, wanted = totalised(plain, cleared(goal, positive), self.if_defined)
        return with_known([*given, *implied([*given, negation(wanted)])], wanted)

    def _decided(
        self, text: str, names: Sequence[str], facts: Sequence[Formula], goal: Formula, seconds: float
    ) -> Outcome:
        """A short time for all solvers, who get the question as `text`, then with more facts, then for
        products and cases, then the rest.
        """
        until = time.monotonic() + seconds
        quick = QUICK if seconds > TOO_SHORT else seconds
        found = self.portfolio.ask(text, quick, names)
        if found.verdict != "unknown" or quick == seconds:
            return found
        if conditions := self._conditions(facts, until):
            facts = [*facts, *conditions]
            text, names = script(*self._posed(facts, goal))
            found = self.portfolio.ask(text, QUICK, names)
            if found.verdict != "unknown" or time.monotonic() > until:
                return found
        positive = positive_symbols(facts)

        def total(atom: Compare) -> bool:
            return is_total(cleared(atom, positive))

        in_cases, wanted = self._posed([without_cases(f, total) for f in facts], without_cases(goal, total))
        known = [c for f in (*in_cases, negation(wanted)) for c in conjuncts(f)]
        search = _Cases(self.portfolio, Signs(sorted(symbols(*known), key=str)), symbols(wanted), until)
        found = search.decided(known, MOST_SPLITS)
        if found.verdict != "unknown" or time.monotonic() > until:
            return found
        return self.portfolio.ask(text, until - time.monotonic(), names)

    def _conditions(self, facts: Sequence[Formula], until: float) -> list[Formula]:
        """Those under which terms of the facts have values, as far as a short time shows that the facts imply
        them. Solvers find that hard to see on the way to something else.
        """
        positive = positive_symbols(facts)
        wanted = [c for c in dict.fromkeys(needed(*(cleared(f, positive) for f in facts))) if c not in facts]
        found: list[Formula] = []
        for condition in wanted[:MOST_CONDITIONS]:
            if time.monotonic() > until:
                break
            text, names = script(*self._posed([*facts, *found], condition))
            if self.portfolio.ask(text, BRIEF, names).verdict == "unsat":
                found.append(condition)
        return found

    def _write(self, text: str, facts: Sequence[Formula], goal: Formula, outcome: Outcome) -> None:
        """The question as a file, below the dL that it stands for."""
        assert self.keep is not None
        place = next((f.span.place for f in (goal, *facts) if isinstance(f, Compare) and f.span.text), "")
        said = [print_formula(f) for f in facts] + ["implies", print_formula(goal)]
        head = [f"; {place}", *(f"; {line}" for s in said for line in s.splitlines())]
        verdict = f"(set-info :status {outcome.verdict})"
        lines = [*head, verdict, text.rstrip(), "(check-sat)", ""]
        (self.keep / f"{self.asked:05}.smt2").write_text("\n".join(lines), encoding="utf-8")


@dataclass(slots=True)
class _Cases:
    """Decides whether facts contradict each other by linear arithmetic over products, in each case of the
    disjunctions among them. `about` are the symbols of the goal."""

    portfolio: Portfolio
    signs: Signs
    about: set[Symbol]
    until: float

    def decided(self, facts: Sequence[Formula], depth: int) -> Outcome:
        """Unsatisfiable, or satisfied by a state, or unknown."""
        known = self.signs.settled(facts)
        if known is None:
            return PROVED
        if time.monotonic() > self.until:
            return UNDECIDED
        found = self._compared(known)
        splits = disjunctions(known, self.about)
        if found.verdict == "unsat" or not splits:
            return found
        for split in splits[:MOST_TRIED]:
            if self._alone(known, split):
                return Outcome("unsat", found.solver)
        for case in cases_of(known, splits[0]) if depth else ():
            found = self.decided(case, depth - 1)
            if found.verdict != "unsat":
                return found
        return found if depth else UNDECIDED

    def _alone(self, known: Sequence[Formula], split: Or) -> bool:
        """Whether the comparisons contradict every case of one disjunction."""
        plain = [f for f in known if isinstance(f, Compare)]
        for case in cases_of([*plain, split], split):
            settled = self.signs.settled(case)
            if settled is not None and self._compared(settled).verdict != "unsat":
                return False
        return True

    def _compared(self, known: Sequence[Formula]) -> Outcome:
        """Of the comparisons alone."""
        for linear in scripts(known, self.about, MOST_FACTORS, self.until):
            if self._ask(linear, LINEAR, "z3").verdict == "unsat":
                return Outcome("unsat", "z3 linear")
        plain = [f for f in known if isinstance(f, Compare)]
        text, names = script(plain, FALSE)
        return self._ask(text, LAST, None, names)

    def _ask(self, text: str, most: float, only: Solver | None, names: Sequence[str] = ()) -> Outcome:
        left = min(most, self.until - time.monotonic())
        return self.portfolio.ask(text, left, names, only=only) if left > 0 else UNDECIDED
