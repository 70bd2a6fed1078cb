"""The reference semantics: one step of a model, in plain Python.

Slow and direct on purpose. Compiled code must agree with it; it shares no code with path
enumeration or code generation. A step explores the runs of the body one by one, each a
straight line of assignments, tests and flows, executed on a copy of the state
(semantics 2 to 6). Numbers are doubles or exact rationals; the flow is an argument.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, TypeAlias, assert_never

from dl2c.ir.evaluate import Environment, Undefined, Value, evaluate, in_range, literal, truth
from dl2c.ir.exact import Motion
from dl2c.ir.inputs import Range, admissible
from dl2c.ir.judge import Happened, judge
from dl2c.ir.model import (
    Assign,
    AssignAny,
    Block,
    Choice,
    Evolve,
    If,
    Model,
    Symbol,
    Term,
    Test,
)
from dl2c.ir.watch import watches_of

FlowFunction: TypeAlias = Callable[[int, Environment, bool, Value, Sequence[int]], Motion]
"""Follow flow number k from an environment, in doubles or exactly, for a part (0 to 1) of its
longest duration, with an eye on the watches given (`follow` with the flow's plan)."""

Straight: TypeAlias = Assign | AssignAny | Test | Evolve
OnBlocked: TypeAlias = Literal["fallback", "truncate", "terminate"]


@dataclass(frozen=True, slots=True)
class Run:
    """One way through the body: its discrete decisions in order, and what it executes.

    `marks` says for each decision whether the alternative is marked `@fallback`.
    """

    decisions: tuple[tuple[str, int], ...]
    marks: tuple[bool, ...]
    line: tuple[Straight, ...]


@dataclass(frozen=True, slots=True)
class Settings:
    """The options that change what a step does."""

    on_blocked: OnBlocked = "fallback"
    blocked_penalty: float = 0.0
    limits: Mapping[str, tuple[Fraction, Fraction]] = field(
        default_factory=dict[str, tuple[Fraction, Fraction]]
    )


@dataclass(frozen=True, slots=True)
class Step:
    """What a step did. `state` holds the program variables; `mask` the enabled runs of the new state.

    `reason` is empty while the episode goes on; else a predicate's name, or blocked, deadlock,
    numerical, end. `values` are the inputs in effect, by key.
    """

    state: dict[str, Value]
    decisions: dict[str, int]
    values: dict[str, Value]
    blocked: bool
    duration: Value
    reward: Value
    cost: int
    terminated: bool
    truncated: bool
    status: str
    reason: str
    mask: tuple[bool, ...]


def runs(block: Block) -> Iterator[Run]:
    """Every run of a block, in program order; a deterministic branch contributes its tests."""
    if not block:
        yield Run((), (), ())
        return
    first, rest = block[0], block[1:]
    for head in _heads(first):
        for tail in runs(rest):
            yield Run(head.decisions + tail.decisions, head.marks + tail.marks, head.line + tail.line)


def _heads(statement: object) -> Iterator[Run]:
    match statement:
        case Assign() | AssignAny() | Test() | Evolve():
            yield Run((), (), (statement,))
        case If(condition, otherwise, then, orelse):
            for guard, body in ((condition, then), (otherwise, orelse)):
                for run in runs(body):
                    yield Run(run.decisions, run.marks, (Test(guard, span=statement.span), *run.line))
        case Choice(key, alternatives):
            for k, alternative in enumerate(alternatives):
                for run in runs(alternative.body):
                    yield Run(((key, k), *run.decisions), (alternative.fallback, *run.marks), run.line)
        case _:
            raise AssertionError(f"not a statement: {statement!r}")


class Blocked(Exception):
    """A test failed: this is no run."""


@dataclass(slots=True)
class Interpreter:
    """A model with its constants fixed, ready to step. `exact` chooses rationals over doubles."""

    model: Model
    constants: Mapping[str, Value]
    flow: FlowFunction
    exact: bool = False
    settings: Settings = field(default_factory=Settings)

    def environment(self, state: Mapping[str, Value | None]) -> dict[Symbol, Value | None]:
        env: dict[Symbol, Value | None] = {Symbol(c, "constant"): v for c, v in self.constants.items()}
        return env | {Symbol(x, "variable"): v for x, v in state.items()}

    def enabled(self, state: Mapping[str, Value]) -> tuple[bool, ...]:
        """For every run of the body: whether it passes every test up to its first flow (semantics 3)."""
        return tuple(self._ranges(run, state) is not None for run in runs(self.model.body))

    def step(
        self,
        state: Mapping[str, Value],
        choices: Mapping[str, int],
        inputs: Mapping[str, Value],
        late: bool = False,
    ) -> Step:
        """One step from a state in which some run is enabled; `late` where it is the last allowed."""
        ranked = self._ranked(state, choices)
        requested = self._requested(choices)
        blocked = True
        for run, ranges in ranked:
            if run not in requested and self.settings.on_blocked != "fallback":
                break
            try:
                done = self._execute(run, ranges, state, inputs)
            except Blocked:
                continue
            blocked = run not in requested
            return self._judged(state, run, done, blocked, choices, inputs, late)
        ending = self.settings.on_blocked if self.settings.on_blocked != "fallback" else "deadlock"
        return self._unmoved(state, ending, choices, inputs)

    def _requested(self, choices: Mapping[str, int]) -> list[Run]:
        return [r for r in runs(self.model.body) if all(choices[k] == a for k, a in r.decisions)]

    def _ranked(
        self, state: Mapping[str, Value], choices: Mapping[str, int]
    ) -> list[tuple[Run, dict[str, Range]]]:
        """The enabled runs, the requested one first, then by longest agreement, mark and program order."""
        ranked: list[tuple[tuple[int, int, int], Run, dict[str, Range]]] = []
        for order, run in enumerate(runs(self.model.body)):
            ranges = self._ranges(run, state)
            if ranges is None:
                continue
            agreed = 0
            while (
                agreed < len(run.decisions) and choices[run.decisions[agreed][0]] == run.decisions[agreed][1]
            ):
                agreed += 1
            whole = agreed == len(run.decisions)
            marked = whole or run.marks[agreed]
            ranked.append(((-(10**6 if whole else agreed), -int(marked), order), run, ranges))
        ranked.sort(key=lambda item: item[0])
        return [(run, ranges) for _, run, ranges in ranked]

    def _ranges(self, run: Run, state: Mapping[str, Value]) -> dict[str, Range] | None:
        """The admissible range of each input up to the first flow; None where the run is not enabled."""
        return admissible(
            _first_part(self.model, run), self.environment(state), self.settings.limits, self.exact
        )

    def _execute(
        self, run: Run, ranges: Mapping[str, Range], state: Mapping[str, Value], inputs: Mapping[str, Value]
    ) -> "_Done":
        """Execute a run. Raises `Blocked`."""
        env = self.environment(state)
        values: dict[str, Value] = {}
        duration: Value = literal(Fraction(0), self.exact)
        failed: set[int] = set()
        met: set[int] = set()
        watches = range(len(watches_of(self.model)))
        for statement in run.line:
            match statement:
                case Assign(variable, term):
                    env[Symbol(variable, "variable")] = self._assigned(term, env)
                case AssignAny(variable, key):
                    values[key] = ranges[key].nearest(inputs[key]) if key in ranges else inputs[key]
                    env[Symbol(variable, "variable")] = values[key]
                case Test(formula):
                    if not truth(formula, env, self.exact):
                        raise Blocked
                case Evolve(flow):
                    if not truth(self.model.flows[flow].domain, env, self.exact):
                        raise Blocked
                    if not all(in_range(v) for s, v in env.items() if s.kind == "variable"):
                        return _Done(None, values, duration)
                    part = self._part(flow, inputs, values)
                    waiting = [w for w in watches if w not in failed and w not in met]
                    try:
                        motion = self.flow(flow, env, self.exact, part, waiting)
                    except Undefined:
                        return _Done(None, values, duration)
                    failed |= set(motion.failed)
                    met |= set(motion.met)
                    env |= {Symbol(x, "variable"): v for x, v in motion.values.items()}
                    duration = duration + motion.duration
                case _:
                    assert_never(statement)
        final = {v.name: env[Symbol(v.name, "variable")] for v in self.model.variables}
        whole = {x: v for x, v in final.items() if v is not None and in_range(v)}
        return _Done(
            whole if len(whole) == len(final) else None, values, duration, frozenset(failed), frozenset(met)
        )

    def _part(self, flow: int, inputs: Mapping[str, Value], values: dict[str, Value]) -> Value:
        """The part of its longest duration that a flow takes; noted among the values in effect."""
        one = literal(Fraction(1), self.exact)
        if self.model.duration == "max":
            return one
        key = f"duration_{flow}"
        part = Range(one * 0, one).nearest(inputs[key])
        values[key] = part
        return part

    def _assigned(self, term: Term, env: Environment) -> Value | None:
        try:
            return evaluate(term, env, self.exact)
        except Undefined:
            return None

    def _judged(
        self,
        state: Mapping[str, Value],
        run: Run,
        done: "_Done",
        blocked: bool,
        choices: Mapping[str, int],
        inputs: Mapping[str, Value],
        late: bool,
    ) -> Step:
        """Reward and ending of a completed run (semantics 6)."""
        numerical = done.state is None
        after = dict(state) if done.state is None else done.state
        events = Happened(late=late) if numerical else Happened(done.failed, done.met, late)
        outcome = judge(self.model, self.environment(after), self.exact, events)
        reward, reason, status, ends = outcome.reward, outcome.reason, outcome.status, outcome.ends
        mask = self.enabled(after)
        if numerical:
            ends, status, reason = "truncate", "none", "numerical"
        elif ends is None:
            if outcome.undefined:
                ends, reason = "truncate", "numerical"
            elif not self.model.loops:
                ends, reason = "terminate", "end"
            elif not any(mask):
                ends, reason = "truncate", "deadlock"
            status = status if ends is None else "none"
        if blocked:
            reward = reward + literal(Fraction(self.settings.blocked_penalty), self.exact)
        return Step(
            state=after,
            decisions={**choices, **dict(run.decisions)},
            values={**inputs, **done.values},
            blocked=blocked,
            duration=literal(Fraction(0), self.exact) if numerical else done.duration,
            reward=reward,
            cost=outcome.cost,
            terminated=ends == "terminate",
            truncated=ends == "truncate",
            status=status,
            reason=reason,
            mask=mask,
        )

    def _unmoved(
        self, state: Mapping[str, Value], ending: str, choices: Mapping[str, int], inputs: Mapping[str, Value]
    ) -> Step:
        """The requested run blocked and nothing else was run: the state stays (semantics 3)."""
        outcome = judge(self.model, self.environment(state), self.exact)
        penalty = literal(Fraction(self.settings.blocked_penalty), self.exact)
        return Step(
            state=dict(state),
            decisions=dict(choices),
            values=dict(inputs),
            blocked=True,
            duration=literal(Fraction(0), self.exact),
            reward=outcome.reward + penalty,
            cost=outcome.cost,
            terminated=ending == "terminate",
            truncated=ending != "terminate",
            status="none",
            reason="deadlock" if ending == "deadlock" else "blocked",
            mask=self.enabled(state),
        )


@dataclass(frozen=True, slots=True)
class _Done:
    """The end of a run; `state` None where a value became undefined or a flow failed."""

    state: dict[str, Value] | None
    values: dict[str, Value]
    duration: Value
    failed: frozenset[int] = frozenset()
    met: frozenset[int] = frozenset()


def _first_part(model: Model, run: Run) -> tuple[Straight, ...]:
    """A run up to its first flow, whose domain counts as a test."""
    for k, statement in enumerate(run.line):
        if isinstance(statement, Evolve):
            domain = model.flows[statement.flow].domain
            return (*run.line[:k], Test(domain, span=statement.span))
    return run.line
