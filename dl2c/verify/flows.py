"""A differential equation in a symbolic execution: its solution where that is a polynomial of time, else
what is proved to stay true along it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import (
    atoms,
    conjunction,
    conjuncts,
    symbols,
    with_atoms,
)
from dl2c.ir.model import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    Compare,
    Formula,
    Symbol,
    Term,
)
from dl2c.parse import tree
from dl2c.source import Span
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.arithmetic.total import domains, is_total
from dl2c.verify.field import Field
from dl2c.verify.invariance import Invariance
from dl2c.verify.invention import invented
from dl2c.verify.motion import (
    Curves,
    Motion,
    curves_of,
    facts_that_move,
    facts_until_now,
    instant,
    motion_formula,
    on_the_way,
    replaced,
)
from dl2c.verify.samples import Samples, samples
from dl2c.verify.states import (
    Names,
    State,
    Unsupported,
    earlier_values,
    formula_in,
    loses_a_reading,
    term_in,
)

MAX_CUTS = 24
"""Formulas that are kept for one flow."""


SHARES = (1.0, 0.4, 0.15)
"""Of a question's time: for cuts of the text, for those of tactics and goals, for invented ones."""


FIRST = 0.15
"""Of that share, for a first try of all rules."""

SIMPLE = 6
"""Atoms of a fact."""


@dataclass(slots=True)
class Flows:
    """Follows differential equations. `effort` 0 goes by solutions and the text's own cuts, 1 tries hints and
    facts of the whole time too, 2 `wanted` formulas and other facts, 3 invents cuts. `guessed` are cuts of
    equations, by their places, used like the text's own. `rules` notes what was used.
    """

    prover: Prover
    effort: int = 0
    hints: Sequence[tree.Formula] = ()
    wanted: Sequence[tree.Formula] = ()
    guessed: Mapping[Span, Sequence[tree.Formula]] = field(default_factory=dict[Span, Sequence[tree.Formula]])
    rules: set[str] = field(default_factory=set[str])

    def follow(self, ode: tree.ODESystem, state: State, names: Names) -> Iterator[State]:
        """The states in which the equation may end, or more. Raises `Unsupported`."""
        motion = self.motion(ode, state, names)
        if motion is None:
            return
        curves = self.curves(motion)
        needed = len(curves) < len(motion.rates) or self.effort > 0 or self._given(ode)
        cuts = self._cuts(ode, motion, curves, names) if needed else ()
        yield from self.ended(motion, curves, cuts)

    def _given(self, ode: tree.ODESystem) -> tuple[tree.Formula, ...]:
        """The cuts that the text and guesses give."""
        return (*ode.invariants, *self.guessed.get(ode.span, ()))

    def ended(self, motion: Motion, curves: Curves, cuts: Sequence[Formula] = ()) -> Iterator[State]:
        """The state after any duration, of which the domain and cuts hold."""
        values = instant(motion, curves)
        facts = [*on_the_way(motion, curves), *(replaced(f, values) for f in (*cuts, motion.domain))]
        end = motion.state.where(*facts)
        if end is not None:
            store = {x: values.get(s, s) for x, s in motion.moved.items()}
            yield end.having(store).after(("duration", motion.clock))

    def curves(self, motion: Motion) -> Curves:
        """The coefficients of time of the symbols that move as polynomials of time."""
        return curves_of(motion, self._defined(motion))

    def _defined(self, motion: Motion) -> set[Symbol]:
        """The symbols whose rates are proved to have values wherever the domain holds."""
        context = [*motion.state.facts, motion.domain]
        return {
            s
            for s, rate in motion.rates.items()
            if is_total(rate)
            or self.prover.if_defined
            or self.prover.valid(context, conjunction(domains(rate)), SHARES[1])
        }

    def motion(self, ode: tree.ODESystem, state: State, names: Names) -> Motion | None:
        """What moves and how; None where the domain is false at the start."""
        if ode.dual:
            raise Unsupported("a duration of another player", ode.span)
        equations = [e for e in ode.equations if isinstance(e, tree.AtomicODE)]
        if len(equations) < len(ode.equations):
            raise Unsupported("a differential equation without definition", ode.span)
        still = {e.name for e in equations if isinstance(e.term, tree.Number) and not e.term.value}
        moved = {e.name: names.fresh(e.name) for e in equations if e.name not in still}
        scope = {**state.store, **{f"{x}'": ZERO for x in still}, **moved}
        along = replace(state, store=scope)
        clock = names.fresh("time")
        rates = {moved[e.name]: term_in(e.term, along) for e in equations if e.name in moved}
        rates[clock] = ONE
        start: dict[Symbol, Term] = {clock: ZERO} | {s: state.store[x] for x, s in moved.items()}
        expressed = self._domain(ode.domain, along, state)
        domain, begun = expressed or (TRUE, state)
        if begun is None:
            return None
        olds = earlier_values(state)
        return Motion(start, rates, domain, begun, scope, moved, olds, clock, expressed is not None)

    def _domain(
        self, domain: tree.Formula, along: State, state: State
    ) -> tuple[Formula, State | None] | None:
        """H over what moves, and the state where it begins; None where H cannot be expressed."""
        try:
            if not self.prover.if_defined and loses_a_reading(domain, state):
                return None
            return formula_in(domain, along), state.where(formula_in(domain, state))
        except (Unsupported, CompileError):
            return None

    def _cuts(self, ode: tree.ODESystem, motion: Motion, curves: Curves, names: Names) -> tuple[Formula, ...]:
        """Formulas that are proved to hold all along. Raises `Unsupported`."""
        if not self.prover.if_defined and not all(map(is_total, motion.start.values())):
            needed = list(domains(*motion.start.values()))
            if not self.prover.valid(motion.state.facts, conjunction(needed)):
                if len(curves) < len(motion.rates):
                    raise Unsupported("a differential equation that may begin without a value", ode.span)
                return ()
        search = _Search(self, motion, curves, names)
        for written in self._given(ode):
            search.each(motion_formula(written, motion), SHARES[0])
        if self.effort >= 1:
            for hint in self.hints:
                search.each(motion_formula(hint, motion), SHARES[1])
            for fact in facts_until_now(motion):
                search.each(fact, SHARES[1])
        goals = [g for w in self.wanted if (g := motion_formula(w, motion)) is not None]
        if self.effort >= 2:
            search.with_facts(facts_that_move(motion), goals, SHARES[1], whole=self.effort > 2)
        if self.effort >= 3:
            found = invented(search.vectors, motion.start, motion.clock, curves)
            search.until_no_more(found, goals, SHARES[2])
        self.rules |= search.rules
        return tuple(search.proved)


def _strict(formula: Formula) -> Formula:
    """The formula without the borders of inequalities."""
    return with_atoms(formula, lambda a: replace(a, op={"<=": "<", ">=": ">"}.get(a.op, a.op)))


@dataclass(slots=True)
class _Search:
    """Candidates for one motion: `proved` are those that hold all along."""

    flows: Flows
    motion: Motion
    curves: Curves
    names: Names
    proved: list[Formula] = field(default_factory=list[Formula])
    rules: set[str] = field(default_factory=set[str])
    samples: Samples | None = None
    vectors: Field = field(init=False)

    def __post_init__(self) -> None:
        self.vectors = Field(dict(self.motion.rates), self.names, self._nonzero_in_rate)
        self.vectors.nonzero = self._nonzero

    def _nonzero_in_rate(self, divisor: Term) -> bool:
        """The same for a divisor of a rate: an equation whose terms are defined is followed only where it is
        not zero.
        """
        return self.flows.prover.if_defined or self._nonzero(divisor)

    def _nonzero(self, divisor: Term) -> bool:
        """Whether a divisor is never zero while the domain holds."""
        context = [*self.motion.state.facts, self.motion.domain]
        return self.flows.prover.valid(context, Compare("!=", divisor, ZERO))

    @property
    def context(self) -> list[Formula]:
        """What holds at every instant."""
        known = [*self.motion.state.facts, Compare(">=", self.motion.clock, ZERO)]
        return [*known, *conjuncts(self.motion.domain), *self.proved]

    def _follows(self, formula: Formula, share: float) -> bool:
        """Whether a formula holds at every instant by the solution and by what is proved already."""
        values = instant(self.motion, self.curves)
        known = [replaced(f, values) for f in self.context]
        known += on_the_way(self.motion, self.curves)
        return self.flows.prover.valid(known, replaced(formula, values), share)

    def each(self, formula: Formula | None, share: float) -> None:
        """Try a formula as a whole; where that fails, its conjuncts."""
        if formula is None or self._tried(formula, share) or len(parts := conjuncts(formula)) < 2:
            return
        for part in parts:
            self._tried(part, share)

    def with_facts(
        self, facts: Sequence[Formula], goals: Sequence[Formula], share: float, whole: bool
    ) -> None:
        """Try simple facts, which may help goals, then these, then other facts; unless `whole`, these only as
        long as some goal is not proved.
        """
        simple = [f for f in facts if len(list(atoms(f))) <= SIMPLE]
        for some in (simple, [f for f in facts if f not in simple]):
            if not whole and goals and all(self._is_known(g) for g in goals):
                return
            before = len(self.proved)
            for fact in some:
                self.each(fact, share)
            if some is simple or len(self.proved) > before:
                for goal in goals:
                    self.each(goal, share)

    def _is_known(self, formula: Formula) -> bool:
        """Whether nothing is left to prove of it."""
        still = not symbols(formula) & self.motion.rates.keys()
        return still or all(part in self.proved for part in conjuncts(formula))

    def until_no_more(self, candidates: Sequence[Formula], goals: Sequence[Formula], share: float) -> None:
        """Try candidates again and again, as each may help others, until all goals are proved."""
        left = [c for c in candidates if not self._fails(c)]
        progress = True
        while left and progress and len(self.proved) < MAX_CUTS:
            progress = False
            for candidate in list(left):
                if self._tried(candidate, share):
                    progress = True
                    left.remove(candidate)
                    if goals and all(self._tried(g, share) for g in goals):
                        return

    def _fails(self, formula: Formula) -> bool:
        """Whether a formula is false on one of a few motions that are looked at."""
        if self.samples is None:
            m = self.motion
            inside = [_strict(f) for f in (*m.state.facts, m.initially(m.domain))]
            for facts in (inside, m.state.facts):
                example = self.flows.prover.decide(facts, FALSE, SHARES[1]).values
                if example:
                    self.samples = samples(facts, example, m.start, m.rates, m.domain)
                    break
            else:
                self.samples = Samples(())
        return self.samples.reject(formula)

    def _has_values(self, formula: Formula, share: float) -> bool:
        """Whether all terms have values at every instant. Rules take that for granted: they keep one of
        `p > 0 | p <= 0` whatever p is, and neither is true where it has no value.
        """
        return is_total(formula) or self.flows.prover.valid(
            self.context, conjunction(domains(formula)), share
        )

    def _tried(self, formula: Formula, share: float) -> bool:
        if formula == TRUE or formula in self.proved or not (symbols(formula) & self.motion.rates.keys()):
            return True
        if self._fails(formula):
            return False
        prover = self.flows.prover
        initial = self.motion.initially(formula)
        if not prover.valid(self.motion.state.facts, initial, share) or not self._has_values(formula, share):
            return False
        for part in (share * FIRST, share):
            known = instant(self.motion, self.curves)
            one = Invariance(self.vectors, self.motion.domain, prover, known, part)
            if self._follows(formula, part) or one.keeps(formula, self.context):
                break
        else:
            return False
        self.proved += conjuncts(formula)
        self.rules |= one.rules
        return True
