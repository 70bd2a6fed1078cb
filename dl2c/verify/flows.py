"""A differential equation in a symbolic execution: its solution where that is a polynomial of time, else
what is proved to stay true along it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from dl2c.diagnostics import CompileError
from dl2c.flows.solution import NotPolynomial, solve
from dl2c.ir.logic import (
    conjunction,
    conjuncts,
    disjunction,
    mapped,
    number,
    substituted,
    symbols,
    with_atoms,
    with_sides,
)
from dl2c.ir.model import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    Add,
    Compare,
    Flow,
    Formula,
    Mul,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
)
from dl2c.ir.polynomial import polynomial
from dl2c.parse import tree
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.arithmetic.total import domains, is_total
from dl2c.verify.field import Field
from dl2c.verify.invariance import Invariance
from dl2c.verify.invention import invented
from dl2c.verify.samples import Samples, samples
from dl2c.verify.states import (
    Names,
    State,
    Unsupported,
    earlier_values,
    formula_in,
    has_one_reading,
    term_in,
    without_old,
)

MAX_CUTS = 24
"""Formulas that are kept for one flow."""

MAX_FACTS = 16
"""Facts about the start of a flow that are tried as cuts."""

SHARES = (1.0, 0.4, 0.15)
"""Of a question's time: for cuts of the text, for those of tactics and goals, for invented ones."""

Curves: TypeAlias = Mapping[Symbol, tuple[Term, ...]]
"""Coefficients of time."""


FIRST = 0.15
"""Of that share, for a first try of all rules."""


@dataclass(frozen=True, slots=True)
class Motion:
    """One ODE from one state: `start` has the first value of each symbol that moves, `domain` is H over these
    symbols, `rates` are theirs, `clock` is the time since the beginning, one of them; `state` is where it
    begins, H included."""

    start: Mapping[Symbol, Term]
    rates: Mapping[Symbol, Term]
    domain: Formula
    state: State
    scope: Mapping[str, Term]
    moved: Mapping[str, Symbol]
    olds: Mapping[str, Term]
    clock: Symbol

    def initially(self, formula: Formula) -> Formula:
        """A formula about the symbols, where the motion begins."""
        return replaced(formula, self.start)


def replaced(formula: Formula, values: Mapping[Symbol, Term]) -> Formula:
    """A formula with symbols replaced; atoms between numbers are decided."""
    return mapped(formula, lambda t: substituted(t, values))


@dataclass(slots=True)
class Flows:
    """Follows differential equations. `effort` 0 goes by solutions and the text's own cuts, 1 tries hints and
    facts of the whole time too, 2 `wanted` formulas and other facts, 3 invents cuts. `rules` notes what was
    used.
    """

    prover: Prover
    effort: int = 0
    hints: Sequence[tree.Formula] = ()
    wanted: Sequence[tree.Formula] = ()
    rules: set[str] = field(default_factory=set[str])

    def follow(self, ode: tree.ODESystem, state: State, names: Names) -> Iterator[State]:
        """The states in which the equation may end, or more. Raises `Unsupported`."""
        motion = self.motion(ode, state, names)
        if motion is None:
            return
        curves = self.curves(motion)
        needed = len(curves) < len(motion.rates) or self.effort > 0 or ode.invariants
        cuts = self._cuts(ode, motion, curves, names) if needed else ()
        yield from self.ended(motion, curves, cuts)

    def ended(self, motion: Motion, curves: Curves, cuts: Sequence[Formula] = ()) -> Iterator[State]:
        """The state after any duration, of which the domain and cuts hold."""
        values = instant(motion, curves)
        facts = [*_on_the_way(motion, curves), *(replaced(f, values) for f in (*cuts, motion.domain))]
        end = motion.state.where(*facts)
        if end is not None:
            store = {x: values.get(s, s) for x, s in motion.moved.items()}
            yield end.having(store).after(("duration", motion.clock))

    def curves(self, motion: Motion) -> Curves:
        """The coefficients of time of the symbols that move as polynomials of time."""
        return _curves(motion, self._defined(motion))

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
        scope = {**state.store, **moved}
        along = replace(state, store=scope)
        clock = names.fresh("time")
        rates = {moved[e.name]: term_in(e.term, along) for e in equations if e.name in moved}
        rates[clock] = ONE
        start: dict[Symbol, Term] = {clock: ZERO} | {s: state.store[x] for x, s in moved.items()}
        domain, begun = self._domain(ode.domain, along, state)
        if begun is None:
            return None
        olds = earlier_values(state)
        return Motion(start, rates, domain, begun, scope, moved, olds, clock)

    def _domain(self, domain: tree.Formula, along: State, state: State) -> tuple[Formula, State | None]:
        """H over what moves, and the state where it begins; `true` where H cannot be expressed."""
        try:
            if not self.prover.if_defined and has_one_reading(domain, state):
                return TRUE, state
            return formula_in(domain, along), state.where(formula_in(domain, state))
        except (Unsupported, CompileError):
            return TRUE, state

    def _cuts(self, ode: tree.ODESystem, motion: Motion, curves: Curves, names: Names) -> tuple[Formula, ...]:
        """Formulas that are proved to hold all along. Raises `Unsupported`."""
        if not self.prover.if_defined and not all(map(is_total, motion.start.values())):
            needed = list(domains(*motion.start.values()))
            if not self.prover.valid(motion.state.facts, conjunction(needed)):
                if len(curves) < len(motion.rates):
                    raise Unsupported("a differential equation that may begin without a value", ode.span)
                return ()
        search = _Search(self, motion, curves, names)
        for written in ode.invariants:
            search.each(motion_formula(written, motion), SHARES[0])
        if self.effort >= 1:
            for hint in self.hints:
                search.each(motion_formula(hint, motion), SHARES[1])
            for fact in _facts_until_now(motion):
                search.each(fact, SHARES[1])
        goals = [g for w in self.wanted if (g := motion_formula(w, motion)) is not None]
        if self.effort >= 2:
            for candidate in (*goals, *_facts_that_move(motion)):
                search.each(candidate, SHARES[1])
        if self.effort >= 3:
            search.until_no_more(invented(search.vectors, motion.start, motion.clock), goals, SHARES[2])
        self.rules |= search.rules
        return tuple(search.proved)


def _strict(formula: Formula) -> Formula:
    """The formula without the borders of inequalities."""
    return with_atoms(formula, lambda a: replace(a, op={"<=": "<", ">=": ">"}.get(a.op, a.op)))


def _facts_that_move(motion: Motion) -> list[Formula]:
    """What is known of the state where the motion begins, said of all its states; the last first."""
    moving = {value: s for s, value in motion.start.items() if isinstance(value, Symbol)}
    found = [with_sides(f, lambda t: substituted(t, moving)) for f in reversed(motion.state.facts)]
    return [f for f in found if symbols(f) & motion.rates.keys()][:MAX_FACTS]


def _facts_until_now(motion: Motion) -> list[Formula]:
    """What is known of the whole time that the domain allows, said of the time that has passed.

    Where the domain says `t <= ep`, guards speak of ep, the worst case. Of t they say what holds at every
    instant, which is often a step of the proof.
    """
    found: dict[Formula, None] = {}
    for clock, limit in _time_limits(motion):
        for fact in motion.state.facts:
            names = symbols(fact)
            if limit in names and len(names) > 2:
                found.setdefault(with_sides(fact, lambda t, now={limit: clock}: substituted(t, now)))
    return list(found)[-MAX_FACTS:]


def _time_limits(motion: Motion) -> Iterator[tuple[Symbol, Symbol]]:
    """Clocks of the motion, each with a constant that it may not exceed."""
    for atom in conjuncts(motion.domain):
        match atom:
            case Compare("<=" | "<", Symbol() as clock, Symbol() as limit) | Compare(
                ">=" | ">", Symbol() as limit, Symbol() as clock
            ) if motion.rates.get(clock) == ONE and limit not in motion.rates:
                yield clock, limit
            case _:
                pass


def motion_formula(written: tree.Formula, motion: Motion) -> Formula | None:
    """A formula of the text over what moves, `old(x)` being where it began; None where there is no such."""
    try:
        opened = without_old(written)
        scope = {**motion.scope, **motion.olds, **_speeds(motion)}
        return formula_in(opened, replace(motion.state, store=scope))
    except (Unsupported, CompileError, KeyError):
        return None


def _speeds(motion: Motion) -> dict[str, Term]:
    """The rates of all names; of what does not move 0."""
    still = {f"{x}'": ZERO for x in motion.scope}
    return still | {f"{x}'": motion.rates[s] for x, s in motion.moved.items()}


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
        known += _on_the_way(self.motion, self.curves)
        return self.flows.prover.valid(known, replaced(formula, values), share)

    def each(self, formula: Formula | None, share: float) -> None:
        """Try a formula as a whole; where that fails, its conjuncts."""
        if formula is None or self._tried(formula, share) or len(parts := conjuncts(formula)) < 2:
            return
        for part in parts:
            self._tried(part, share)

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


def _curves(motion: Motion, defined: set[Symbol]) -> dict[Symbol, tuple[Term, ...]]:
    """The coefficients of time of every symbol whose motion is a polynomial."""
    left = dict(motion.rates)
    _without(left, motion, motion.rates.keys() - defined)
    while left:
        equations = tuple((s.name, rate) for s, rate in left.items())
        found = solve(Flow(equations, TRUE, TRUE, (), None))
        if not isinstance(found, NotPolynomial):
            return {s: tuple(substituted(c, motion.start) for c in found.variables[s.name]) for s in left}
        _without(left, motion, {s for s in left if s.name == found.variable})
    return {}


def _without(left: dict[Symbol, Term], motion: Motion, lost: set[Symbol]) -> None:
    """Leave out symbols, and those whose rates depend on any that is left out."""
    while lost:
        for s in lost:
            left.pop(s, None)
        lost = {s for s, rate in left.items() if symbols(rate) & (motion.rates.keys() - left.keys())}


def instant(motion: Motion, curves: Curves) -> dict[Symbol, Term]:
    """The values of what moves as polynomials of time, in terms of the clock."""
    return {s: _at(c, motion.clock) for s, c in curves.items() if s != motion.clock}


def _at(coefficients: Sequence[Term], time: Term) -> Term:
    """The value of a polynomial of time."""
    result: Term = coefficients[0]
    for k, c in enumerate(coefficients[1:], 1):
        if c != ZERO:
            result = Add(result, Mul(c, Pow(time, k) if k > 1 else time))
    return result


def _on_the_way(motion: Motion, curves: Curves) -> Iterator[Formula]:
    """That time does not run back, and what the domain says between start and end: for conjuncts of degree 2
    in time, at their vertex."""
    duration = motion.clock
    yield Compare(">=", duration, ZERO)
    along = {s: tuple(c) for s, c in curves.items()}
    for atom in conjuncts(motion.domain):
        if not isinstance(atom, Compare) or symbols(atom) & (motion.rates.keys() - curves.keys()):
            continue
        sides = (atom.right, atom.left) if atom.op in ("<", "<=") else (atom.left, atom.right)
        margin = polynomial(Sub(*sides), along)
        if margin is None or not is_total(*margin):
            continue
        if atom.op == "=":
            still = Compare("=", duration, ZERO)
            yield from (disjunction([still, Compare("=", c, ZERO)]) for c in margin[1:])
        elif atom.op != "!=" and len(margin) == 3:
            yield _vertex(margin, duration, ">" if atom.op in ("<", ">") else ">=")


def _vertex(margin: Sequence[Term], duration: Symbol, op: str) -> Or:
    """c0 + c1 t + c2 t^2 is not negative where it is least, if that is on the way."""
    c0, c1, c2 = margin
    two, four = number(2), number(4)
    least = Sub(Mul(four, Mul(c0, c2)), Pow(c1, 2))
    return Or(
        (
            Compare("<=", c2, ZERO),
            Compare(">=", c1, ZERO),
            Compare("<=", Add(Mul(two, Mul(c2, duration)), c1), ZERO),
            Compare(">" if op == ">" else ">=", least, ZERO),
        )
    )
