"""Exact runs of programs from the states that a theorem is about: given ones, and random ones.

Comes in: the expanded formula of an entry. Goes out: a run that shows that it is false, or the first
violation of an invariant. Numbers are rational, loops have no limit, and flows last as long as their domain
lets them, which is checked at all instants. Shares nothing with how the package executes or proves models:
it uses their syntax, expanded.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from fractions import Fraction
from typing import Any, Protocol

from oracles.exact_motion import Flow, Moment, Stuck, after
from oracles.exact_numbers import Unclear, Undefined
from oracles.exact_values import State, evaluate, truth

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.parse.parser import parse_archive
from dl2c.resolve.bind import IN_HINTS, check, check_entry
from dl2c.resolve.expand import NONE, Expander, expanded_formula
from dl2c.resolve.infer import inferred
from dl2c.resolve.symbols import Symbols, collect, nodes
from dl2c.source import Source, Span

Decision = Any
"""True for the left of a choice and for one more iteration; the value of `x := *`; a flow."""
Rest = tuple[tree.Program, ...]


# Entries ------------------------------------------------------------------------


def expanded(entry: tree.Entry) -> tree.Formula:
    """The theorem of an entry without definitions. Raises `CompileError`."""
    found = inferred(entry)
    entry = tree.Entry(
        entry.kind,
        entry.name,
        entry.imports,
        (*entry.definitions, *found.constants),
        (*entry.variables, *found.variables),
        entry.problem,
    )
    symbols, mistakes = collect(entry)
    if mistakes := [*mistakes, *check_entry(entry, symbols)]:
        raise CompileError(mistakes)
    return _named(expanded_formula(entry.problem, symbols), symbols)


def _named(node: Any, symbols: Symbols) -> Any:
    """A part of a tree, constants `c()` written as names, invariants without definitions."""
    if isinstance(node, tree.FuncOf) and not node.args and node.name not in ("pi", "e"):
        return tree.Variable(node.name, span=node.span)
    if isinstance(node, tuple):
        return tuple(_named(part, symbols) for part in node)  # pyright: ignore[reportUnknownVariableType]
    if not is_dataclass(node) or isinstance(node, Span | type):
        return node
    if isinstance(node, tree.Loop):
        node = replace(node, invariants=tuple(_invariants(node, symbols)))
    return replace(node, **{f.name: _named(getattr(node, f.name), symbols) for f in fields(node) if f.init})


def _invariants(loop: tree.Loop, symbols: Symbols) -> Iterator[tree.Formula]:
    """Those that can be read, expanded."""
    for written in loop.invariants:
        expander = Expander(symbols)
        if any(check(written, symbols, IN_HINTS)):
            continue
        with suppress(CompileError):
            invariant = expander.formula(written, {}, NONE)
            if not expander.found:
                yield invariant


def theorem(text: str) -> tree.Formula:
    """The expanded theorem of the first entry of an archive."""
    archive, _ = parse_archive(Source("model.kyx", text))
    return expanded(archive.entries[0])


def names(formula: tree.Formula) -> list[str]:
    """All that a state has to give a value, for invariants of loops too."""
    found: set[str] = set()
    invariants = [i for n in nodes(formula) if isinstance(n, tree.Loop) for i in n.invariants]
    for node in (n for f in (formula, *invariants) for n in nodes(f)):
        match node:
            case tree.Variable(name) | tree.Assign(name) | tree.AssignAny(name) | tree.AtomicODE(name):
                found.add(name)
            case _:
                pass
    return sorted(found)


def premises(formula: tree.Formula) -> tuple[list[tree.Formula], tree.Formula]:
    """P and the rest of `P -> ...`, without quantifiers for all values around it."""
    found: list[tree.Formula] = []
    while isinstance(formula, tree.Imply | tree.Forall):
        if isinstance(formula, tree.Imply):
            found.append(formula.left)
            formula = formula.right
        else:
            formula = formula.child
    return found, formula


# Runs ---------------------------------------------------------------------------


class Guide(Protocol):
    """Who decides. `rest` is what runs after the statement that asks; `retries` is how many iterations of a
    loop may fail, and are then done without. Of as many iterations as there are `tries` the one with the
    least `margin` counts.
    """

    retries: int
    tries: int

    def margin(self, state: State) -> float: ...

    def left(self, choice: tree.Choice, state: State, rest: Rest) -> bool: ...

    def value(self, name: str, state: State, rest: Rest) -> Fraction: ...

    def again(self, loop: tree.Loop, state: State, iterations: int) -> bool: ...

    def flow(self, ode: tree.ODESystem, state: State, rest: Rest) -> Flow | Moment: ...


@dataclass
class Script:
    """Decisions that are given, one after another."""

    decisions: Sequence[Decision]
    position: int = 0
    retries: int = 0
    tries: int = 1

    def margin(self, state: State) -> float:
        return 0.0

    def _next(self, kinds: tuple[type, ...]) -> Any:
        if self.position == len(self.decisions) or not isinstance(
            found := self.decisions[self.position], kinds
        ):
            raise Stuck(f"no such decision at {self.position}")
        self.position += 1
        return found

    def left(self, choice: tree.Choice, state: State, rest: Rest) -> bool:
        return bool(self._next((bool,)))

    def value(self, name: str, state: State, rest: Rest) -> Fraction:
        return Fraction(self._next((Fraction,)))

    def again(self, loop: tree.Loop, state: State, iterations: int) -> bool:
        return bool(self._next((bool,)))

    def flow(self, ode: tree.ODESystem, state: State, rest: Rest) -> Flow | Moment:
        found: Flow | Moment = self._next((Flow, Moment))
        return found


@dataclass(frozen=True)
class Finding:
    """What a run violates: a `postcondition` at its end, an `invariant` of a loop at its head."""

    kind: str
    formula: tree.Formula
    state: State
    start: State
    decisions: tuple[Decision, ...]


@dataclass
class Runner:
    """One run. `log` are the decisions so far; `finding` is the first violation of an invariant."""

    guide: Guide
    start: State
    log: list[Decision] = field(default_factory=list[Decision])
    finding: Finding | None = None

    def run(self, program: tree.Program, state: State, rest: Rest = ()) -> State:
        """The state after the program. Raises `Stuck`, `Unclear`."""
        match program:
            case tree.Assign(name, term, False):
                try:
                    return {**state, name: evaluate(term, state)}
                except Undefined as problem:
                    raise Stuck(f"an undefined value: {problem}") from None
            case tree.AssignAny(name, False, dual=False):
                return {**state, name: self._decided(self.guide.value(name, state, rest))}
            case tree.Test(formula):
                if not truth(formula, state):
                    raise Stuck("a test fails")
                return state
            case tree.ODESystem(dual=False):
                return after(program, state, self._decided(self.guide.flow(program, state, rest)))
            case tree.Compose(left, right):
                return self.run(right, self.run(left, state, (right, *rest)), rest)
            case tree.Choice(left, right, dual=False):
                first = self._decided(self.guide.left(program, state, rest))
                return self.run(left if first else right, state, rest)
            case tree.Loop(dual=False):
                return self._loop(program, state, rest)
            case _:
                raise Unclear("a game, or a program without definition")

    def _decided(self, decision: Decision) -> Decision:
        self.log.append(decision)
        return decision

    def _loop(self, loop: tree.Loop, state: State, rest: Rest) -> State:
        iterations = failures = 0
        self._judge(loop, state)
        while self._decided(self.guide.again(loop, state, iterations)):
            found = self._iteration(loop, state, rest)
            if found is None:
                self.log.pop()  # a run that ends before this iteration, or goes on otherwise
                if (failures := failures + 1) > self.guide.retries:
                    self.log.append(False)
                    break
                continue
            state = found
            iterations += 1
            self._judge(loop, state)
        return state

    def _iteration(self, loop: tree.Loop, state: State, rest: Rest) -> State | None:
        """The state after the worst of some iterations; None where all fail and may."""
        decided = list(self.log)
        found: list[tuple[float, State, list[Decision]]] = []
        for _ in range(self.guide.tries):
            self.log[:] = decided
            try:
                later = self.run(loop.child, state, (loop, *rest))
            except (Stuck, Unclear):
                if not self.guide.retries:
                    raise
                continue
            found.append((self.guide.margin(later), later, list(self.log)))
        if not found:
            self.log[:] = decided
            return None
        _, later, self.log[:] = min(found, key=lambda one: one[0])
        return later

    def _judge(self, loop: tree.Loop, state: State) -> None:
        for formula in loop.invariants:
            try:
                held = self.finding is not None or truth(formula, state)
            except Unclear:
                continue
            if not held:
                self.finding = Finding("invariant", formula, state, self.start, tuple(self.log))

    def violates(self, formula: tree.Formula, state: State) -> tree.Formula | None:
        """The part of a theorem that is false in this state after a run of its programs, else None."""
        match formula:
            case tree.Imply(left, right):
                return self.violates(right, state) if truth(left, state) else None
            case tree.Forall(child=child) if _runs(child):
                return self.violates(child, state)
            case tree.Box(program, child) if not _game(program):
                return self.violates(child, self.run(program, state))
            case tree.And(left, right) if _runs(formula):
                return self._either(left, right, state)
            case _:
                return None if truth(formula, state) else formula

    def _either(self, left: tree.Formula, right: tree.Formula, state: State) -> tree.Formula | None:
        """The first side by the same decisions, then the other."""
        position = getattr(self.guide, "position", 0)
        problems: list[Exception] = []
        for side in (left, right):
            if isinstance(self.guide, Script):
                self.guide.position = position
            try:
                if (found := self.violates(side, state)) is not None:
                    return found
            except (Stuck, Unclear) as problem:
                problems.append(problem)
        if len(problems) == 2:
            raise problems[-1]
        return None


def _game(program: tree.Program) -> bool:
    return any(isinstance(n, tree.Dual) or getattr(n, "dual", False) for n in nodes(program))


def _runs(formula: tree.Formula) -> bool:
    return any(isinstance(n, tree.Modal) for n in nodes(formula))


def refutes(formula: tree.Formula, state: State, decisions: Sequence[Decision]) -> bool:
    """Whether a theorem is false in a state, by a run with all of these decisions. Raises `Unclear`.

    Names without a value are 0.
    """
    script = Script([Fraction(d) if type(d) is int else d for d in decisions])
    complete = {name: Fraction(state.get(name, 0)) for name in names(formula)}
    try:
        found = Runner(script, complete).violates(formula, complete)
    except Stuck:
        return False
    return found is not None and script.position == len(script.decisions)
