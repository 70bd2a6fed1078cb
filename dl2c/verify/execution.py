"""Symbolic execution of a theorem: from a formula with programs to goals about single states.

By the axioms of dL: each execution of `:=*` or `++` is fresh, a flow lasts as long as it likes, loops run
as often as they like and go by invariants. Goals collect in the order of the text; the caller decides them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, assert_never

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjuncts, size, symbols
from dl2c.ir.model import ZERO, Compare, Div, Formula, Mul, Symbol
from dl2c.parse import tree
from dl2c.resolve.shape import written_variables
from dl2c.resolve.symbols import nodes
from dl2c.source import Span
from dl2c.verify.arithmetic.cases import clauses
from dl2c.verify.arithmetic.total import is_total
from dl2c.verify.exact_ends import ExactEnds
from dl2c.verify.flows import Flows
from dl2c.verify.instances import assuming, instantiated
from dl2c.verify.states import (
    Names,
    State,
    Unsupported,
    earlier_values,
    formula_in,
    has_differential,
    has_program,
    has_values,
    loses_a_reading,
    quantified,
    term_in,
    without_old,
)

Kind: TypeAlias = Literal["initially", "step", "finally", "program", "safety"]

MAX_VALUE = 200
"""Numbers, symbols and operations in a value that is written out wherever it is used."""

MAX_CLAUSES = 8
"""Of a goal that is proved clause by clause: solvers find these easier than the whole."""

MAX_STATES = 4000
"""Ends of runs that are looked at."""


@dataclass(frozen=True, slots=True)
class Goal:
    """`facts` imply `formula` at the end of the runs of `trail`. `part` is which conjunct of an invariant it
    is. `loop` counts the loops of the theorem from 1 in the order in which runs meet them; 0 is none.
    `predicate` names that of a "safety" goal, which is about the beginning of a step unless it is `ending`.
    """

    kind: Kind
    loop: int
    place: Span
    state: State
    formula: Formula
    part: int = 0
    predicate: str = ""
    ending: bool = False


@dataclass(frozen=True, slots=True)
class Gap:
    """A part of the theorem that is not proved by any goal, and why."""

    kind: Kind
    loop: int
    place: Span
    reason: str
    checked: bool = True
    predicate: str = ""


@dataclass(slots=True)
class Execution:
    """`invariants` are the conjuncts of each loop's, by the loop's place; a loop without is a gap. By the
    place of an existential quantifier around programs they have an equation that gives it a value. Facts
    about values that a loop has overwritten are forgotten unless `remembering`. `reached` are the states
    from which programs are said to run. A step, after which `safety` predicates are to hold, is a run of
    the body of an outermost loop; of the whole program if that is `one_step`.
    """

    flows: Flows
    names: Names
    invariants: Mapping[Span, Sequence[tree.Formula]]
    safety: Sequence[tuple[str, tree.Formula]] = ()
    if_defined: bool = False
    remembering: bool = False
    one_step: bool = False
    goals: list[Goal] = field(default_factory=list[Goal])
    gaps: list[Gap] = field(default_factory=list[Gap])
    loops: list[tree.Loop] = field(default_factory=list[tree.Loop])
    reached: list[tuple[str, Span, State]] = field(default_factory=list[tuple[str, Span, State]])
    inside: tuple[Kind, int] = ("program", 0)
    states: int = 0

    def prove(self, formula: tree.Formula, state: State) -> None:
        """Collect the goals that together say that a formula holds in a state."""
        match formula:
            case _ if not has_program(formula):
                self._condition(formula, state)
            case tree.Imply(left, right):
                for assumed in self.assume(left, state):
                    self.prove(right, assumed)
            case tree.And(left, right):
                self.prove(left, state)
                self.prove(right, state)
            case tree.Or(left, right) if not has_program(left):
                self._either(left, right, state)
            case tree.Or(left, right) if not has_program(right):
                self._either(right, left, state)
            case tree.Equiv(left, right):
                self.prove(tree.Imply(left, right), state)
                self.prove(tree.Imply(right, left), state)
            case tree.Not(tree.Not(child)):
                self.prove(child, state)
            case tree.Not(tree.Diamond(program, child)):
                self.prove(tree.Box(program, tree.Not(child)), state)
            case tree.Forall(name, child):
                value = self.names.fresh(name)
                self.prove(child, state.having({name: value}).after(("value", value)))
            case tree.Exists() if formula.span in self.invariants:
                self._witnessed(formula, self.invariants[formula.span], state)
            case tree.Box(program, child):
                if not self.reached:
                    self.reached.append(("assumptions", formula.span, state))
                for end in self.after(program, state):
                    self.prove(child, end)
                    if self.one_step and not has_program(child):
                        self._safe(end)
            case tree.Diamond(_, _, span=span):
                self._gap(span, "that some run succeeds is not checked", checked=False)
            case _:
                self._gap(formula.span, "a program in a place for which there is no rule")

    def _witnessed(self, formula: tree.Exists, chosen: Sequence[tree.Formula], state: State) -> None:
        """By the rule existsR: what holds of one value holds of some. A quotient is a value where its divisor
        is not 0, which is a goal too.
        """
        (equation,) = chosen
        assert isinstance(equation, tree.Compare) and equation.op == "="
        kind, loop = self.inside
        match term := term_in(equation.right, state):
            case Div(above, below) if is_total(above, below):
                self.goals.append(Goal(kind, loop, formula.span, state, Compare("!=", below, ZERO)))
                value = self.names.fresh(formula.variable)
                known = state.where(Compare("=", Mul(value, below), above))
                assert known is not None, "a new symbol has some value"
                self.prove(formula.child, known.having({formula.variable: value}))
            case _ if is_total(term):
                self.prove(formula.child, state.having({formula.variable: term}))
            case _:
                self._gap(formula.span, "a witness that may be undefined")

    def _either(self, condition: tree.Formula, other: tree.Formula, state: State) -> None:
        """One of two formulas holds. Where a condition has an undefined term neither it nor its negation may
        be true, so that nothing is assumed of it.
        """
        known = has_values(condition, state)
        self.prove(tree.Imply(tree.Not(condition), other) if known else other, state)

    def _condition(self, formula: tree.Formula, state: State) -> None:
        kind, loop = self.inside
        try:
            self._check_reading(formula, state)
            known = instantiated(state)
            if known is not None:
                self.goals.append(Goal(kind, loop, formula.span, known, formula_in(formula, known)))
        except Unsupported as missing:
            self._gap(missing.span, str(missing))
        except CompileError as refused:
            self._gap(formula.span, refused.diagnostics[0].title)

    def _check_reading(self, formula: tree.Formula, state: State) -> None:
        """Quantifiers are eliminated under one reading of undefined terms."""
        if not self.if_defined and loses_a_reading(formula, state):
            raise Unsupported("a quantifier over terms that may be undefined", formula.span)

    def _gap(self, span: Span, reason: str, checked: bool = True) -> None:
        self.gaps.append(Gap(*self.inside, span, reason, checked))

    def assume(self, formula: tree.Formula, state: State) -> Iterator[State]:
        """The states in which a formula holds too; more than these where it cannot be expressed."""
        match formula:
            case tree.And(left, right):
                for one in self.assume(left, state):
                    yield from self.assume(right, one)
            case tree.Exists(name, child):
                inner = state.having({name: self.names.fresh(name)})
                for assumed in self.assume(child, inner):
                    yield replace(assumed, store=state.store)
            case _:
                try:
                    self._check_reading(formula, state)
                    known = state.where(formula_in(formula, state))
                except (Unsupported, CompileError):
                    known = state
                if known is not None:
                    yield self._whatever(formula, known)

    def _whatever(self, formula: tree.Formula, state: State) -> State:
        """The state that keeps a formula with leading quantifiers, or about all runs, for values that are
        known."""
        inner, bound = state, set[Symbol]()
        while isinstance(formula, tree.Forall):
            value = self.names.fresh(formula.variable)
            inner, formula = inner.having({formula.variable: value}), formula.child
            bound.add(value)
        try:
            if isinstance(formula, tree.Box):
                for opened, clause in ExactEnds(self.flows, self.names).clauses(formula, inner):
                    state = assuming(frozenset(bound) | opened, clause, state)
            elif bound and not quantified(formula) and not has_program(formula):
                state = assuming(frozenset(bound), formula_in(formula, inner), state)
        except (Unsupported, CompileError):
            return state
        return state

    def after(self, program: tree.Program, state: State) -> Iterator[State]:
        """The states in which a program may end. Raises `OutOfTime`, `Unsupported` beyond `MAX_STATES`."""
        self.flows.prover.in_time()
        self.states += 1
        if self.states > MAX_STATES:
            raise Unsupported("too many runs", program.span)
        match program:
            case tree.Assign(name, term, False):
                yield self._assigned(name, term, state)
            case tree.AssignAny(name, False):
                value = self.names.fresh(name)
                yield state.having({name: value}).after(("value", value))
            case tree.Assign(span=span) | tree.AssignAny(span=span):
                raise Unsupported("an assignment to a differential", span)
            case tree.Test(formula):
                yield from self.assume(formula, state)
            case tree.Compose(left, right):
                for middle in self.after(left, state):
                    yield from self.after(right, middle)
            case tree.Choice(left, right):
                yield from self.after(left, state.after(("choice", 0)))
                yield from self.after(right, state.after(("choice", 1)))
            case tree.ODESystem():
                known = instantiated(state)
                if known is not None:
                    yield from self.flows.follow(program, known, self.names)
            case tree.Loop():
                yield from self._loop(program, state)
            case tree.Dual(_, span=span):
                raise Unsupported("a hybrid game", span)
            case tree.ProgramConst(_, span=span):
                raise Unsupported("a program without definition", span)
            case _:
                assert_never(program)

    def _assigned(self, name: str, term: tree.Term, state: State) -> State:
        """With a value; one that is long gets a symbol of its own, so that values do not grow without end."""
        value = term_in(term, state)
        if size(value) <= MAX_VALUE:
            return state.having({name: value})
        if not is_total(value):
            raise Unsupported("a long value that may be undefined", term.span)
        symbol = self.names.fresh(name)
        known = state.where(Compare("=", symbol, value))
        assert known is not None, "a new symbol has some value"
        return known.having({name: symbol})

    def _loop(self, loop: tree.Loop, state: State) -> Iterator[State]:
        """By the rule of loop invariants: whatever the loop writes has any values of which the invariant
        holds, where `old(x)` is x before the loop."""
        if loop not in self.loops:
            self.loops.append(loop)
        number = self.loops.index(loop) + 1
        parts = self.invariants.get(loop.span)
        if parts is None:
            self._gap(loop.span, "no invariant of this loop is known")
            parts = ()
        before = state
        if any(isinstance(n, tree.FuncOf) and n.name == "old" for p in parts for n in nodes(p)):
            state = state.having(earlier_values(state))
            parts = [p if has_differential(p) else without_old(p) for p in parts]
        outer = self.inside
        self._invariant("initially", number, parts, state)
        any_state = state.having({x: self.names.fresh(x) for x in sorted(written_variables((loop,)))})
        some = replace(any_state, trail=())
        if not self.remembering:
            known = symbols(*(Compare("=", t, t) for t in some.store.values()))
            some = replace(some, facts=tuple(f for f in some.facts if symbols(f) <= known))
        for inside in self._assumed(parts, some):
            self.inside = ("step", number)
            self.reached.append(("invariant", loop.span, inside))
            self._safe(inside)
            for end in self.after(loop.child, inside):
                self._invariant("step", number, parts, end)
                if outer[0] in ("program", "finally") and not self.one_step:
                    self._safe(end, ending=True)
        self.inside = ("finally", number) if outer[0] in ("program", "finally") else outer
        for end in self._assumed(parts, some):
            yield end.recalling(before)
        self.inside = outer

    def _assumed(self, parts: Sequence[tree.Formula], state: State) -> Iterator[State]:
        states = [state]
        for part in parts:
            states = [s for before in states for s in self.assume(part, before)]
        yield from states

    def _invariant(self, kind: Kind, loop: int, parts: Sequence[tree.Formula], state: State) -> None:
        outer = self.inside
        self.inside = kind, loop
        for number, part in enumerate(parts):
            begun = len(self.goals)
            self._condition(part, state)
            self.goals[begun:] = [replace(g, part=number) for g in self.goals[begun:]]
        self.inside = outer

    def _safe(self, state: State, ending: bool = False) -> None:
        """Safety predicates hold in a state. A flow lasts as long as it likes: where a run ends with one,
        this is about all of its instants.
        """
        outer = self.inside
        self.inside = "safety", outer[1]
        for name, formula in self.safety:
            goals, gaps = len(self.goals), len(self.gaps)
            self._condition(formula, state)
            self.goals[goals:] = [replace(g, predicate=name, ending=ending) for g in self.goals[goals:]]
            self.gaps[gaps:] = [replace(g, predicate=name) for g in self.gaps[gaps:]]
        self.inside = outer

    def stop(self, span: Span, reason: str) -> None:
        """Note that runs are not followed further, so that nothing is known of their ends."""
        kind, loop = self.inside
        self._gap(span, reason)
        if kind in ("program", "step"):
            self.gaps += [Gap("safety", loop, span, reason, predicate=name) for name, _ in self.safety]


def split(goal: Goal) -> Iterator[Goal]:
    """A goal for each conjunct, and for each clause of one that has few; one that is true is left."""
    for part in conjuncts(goal.formula) or (goal.formula,):
        for clause in clauses(part, MAX_CLAUSES) or (part,):
            yield replace(goal, formula=clause)
