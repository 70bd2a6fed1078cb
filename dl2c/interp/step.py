"""The reference semantics: one step of a model, in plain Python.

Slow and direct on purpose. Compiled code must agree with it; it shares no code with path
enumeration or code generation. A step goes through the runs of the body in the order in which
they are preferred, each a sequence of straight lines executed on a copy of the state, until one
is complete (semantics 2 to 6). Numbers are doubles or exact rationals; the flow is an argument.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.flows.exact import Motion
from dl2c.flows.watch import watches_of
from dl2c.interp.inputs import Inputs, nearest
from dl2c.interp.judge import Happened, judge, shapes
from dl2c.interp.lines import Line, Straight, choices, lines
from dl2c.interp.straight import Plan, passable, planned
from dl2c.interp.transition import Draws, Failure, Openings, Request, Settings, Start, Step, Trial
from dl2c.ir.evaluate import Undefined, Valuation, Value, in_range, literal, truth, value_of
from dl2c.ir.model import TRUE, Assign, AssignAny, Block, Evolve, Model, Symbol, Test

FlowFunction: TypeAlias = Callable[[int, Valuation, bool, Value, Sequence[int]], Motion]
"""Follow flow number k from an environment, in doubles or exactly, for a part (0 to 1) of its
longest duration, and watch the conditions given (`follow` with the flow's plan)."""


@dataclass(slots=True)
class Interpreter:
    """A model with its constants fixed, ready to step. `exact` chooses rationals over doubles."""

    model: Model
    constants: Mapping[str, Value]
    flow: FlowFunction
    exact: bool = False
    settings: Settings = field(default_factory=Settings)
    plans: dict[tuple[Straight, ...], Plan] = field(default_factory=dict[tuple[Straight, ...], Plan])
    """What was found out about lines."""

    def environment(self, state: Mapping[str, Value | None]) -> dict[Symbol, Value | None]:
        env: dict[Symbol, Value | None] = {Symbol(c, "constant"): v for c, v in self.constants.items()}
        return env | {Symbol(x, "variable"): v for x, v in state.items()}

    def openings(self, start: Start) -> Openings:
        """What is enabled where a step starts (semantics 3)."""
        runs = list(self._enabled(self.model.body, self._trial(start)))
        mask: dict[str, tuple[bool, ...]] = {}
        for choice in choices((*self.model.lead, *self.model.body)):
            if choice.role == "agent":
                met = {taken[choice.key] for taken in runs if choice.key in taken}
                mask[choice.key] = tuple(not met or k in met for k in range(len(choice.alternatives)))
        return Openings(bool(runs), mask)

    def prefix(self, state: Mapping[str, Value], draws: Draws) -> dict[str, Value] | None:
        """The state that the program before the loop leads to; None where it is blocked."""
        trial = replace(self._trial(Start(state)), met=frozenset(self._watches))
        done = self._complete(self.model.prefix, trial, Request(draws=draws))
        return None if done is None or done.failure else self._state(done.env)

    def lead(self, state: Mapping[str, Value], draws: Draws) -> Start | None:
        """Executes the leading statements of a step; None where they or the step after them are blocked."""
        if not self.model.lead:
            return Start(state)
        done = self._complete(self.model.lead, self._trial(Start(state)), Request(draws=draws), self._opens)
        return None if done is None or done.failure else Start(self._state(done.env), done.taken, done.values)

    def _opens(self, done: Trial) -> bool:
        return any(True for _ in self._enabled(self.model.body, done))

    def step(
        self, start: Start, request: Request, following: Draws | None = None, late: bool = False
    ) -> Step:
        """One step from where some run is enabled; `following` are the draws for the next, `late` says
        that the time limit ends the episode.
        """
        done = self._complete(self.model.body, self._trial(start), request)
        if done is None:
            reason = "deadlock" if self.settings.on_blocked == "fallback" else "blocked"
            return self._unmoved(start, self.settings.on_blocked, reason, request)
        return self._judged(start, done, request, following or {}, late)

    def _trial(self, start: Start) -> Trial:
        return Trial(
            self.environment(start.state), start.taken, start.values, literal(Fraction(0), self.exact)
        )

    def _state(self, env: Valuation) -> dict[str, Value]:
        values = {v.name: env[v.symbol] for v in self.model.variables}
        return {x: v for x, v in values.items() if v is not None}

    # Runs -----------------------------------------------------------------------

    def _complete(
        self,
        block: Block,
        trial: Trial,
        request: Request,
        accepted: Callable[[Trial], bool] = lambda done: True,
    ) -> Trial | None:
        """The first run from a cut point to the end, or to a failure, in the order of preference."""
        while True:
            enabled = [
                (line, inputs)
                for line in lines(block, trial.taken)
                if (inputs := self._inputs(line, trial)) is not None
            ]
            width = max((len(line.decisions) for line, _ in enabled), default=0)
            enabled.sort(key=lambda item: self._rank(item[0], trial, request, width))
            for line, inputs in enabled:
                left = trial.left or any(
                    d.role == "agent" and request.choices[d.key] != d.alternative for d in line.decisions
                )
                if left and self.settings.on_blocked != "fallback":
                    return None
                moved = self._execute(line, inputs, replace(trial, left=left), request)
                if moved.failure or not line.rest:
                    if moved.failure or accepted(moved):
                        return moved
                elif len(enabled) == 1:
                    block, trial = line.rest, moved
                    break
                elif (done := self._complete(line.rest, moved, request, accepted)) is not None:
                    return done
            else:
                return None

    def _enabled(self, block: Block, trial: Trial, ventured: bool = False) -> Iterator[Mapping[str, int]]:
        """The decisions of every run that passes all tests up to its first flow, or may do so: a run
        is not followed beyond a while loop that an input may have decided, nor without end. Deep masks
        follow it beyond flows, where chance has not `ventured` to decide something on the way.
        """
        while True:
            found = [(line, self._inputs(line, trial)) for line in lines(block, trial.taken)]
            open_lines = [(line, inputs) for line, inputs in found if inputs is not None]
            for line, inputs in open_lines:
                taken = {**trial.taken, **{d.key: d.alternative for d in line.decisions}}
                chance = ventured or any(d.role != "agent" for d in line.decisions)
                if self._surely(line, trial, chance):
                    yield taken
                    continue
                moved = self._execute(line, inputs, trial, Request())
                if moved.failure:
                    yield taken
                elif len(open_lines) == 1:
                    block, trial, ventured = line.rest, moved, chance
                    break
                else:
                    yield from self._enabled(line.rest, moved, chance)
            else:
                return

    def _surely(self, line: Line, trial: Trial, chance: bool) -> bool:
        """Whether an enabled line counts as a run that masks need not follow."""
        new = any(isinstance(s, AssignAny) and s.key not in trial.values for s in line.statements)
        deep = self.model.mask_depth == "step" and self.model.duration != "agent" and not chance
        drawn = any(isinstance(s, Evolve) and self.model.flows[s.flow].drawn for s in line.statements)
        return new or not line.rest or (line.flows and not (deep and not drawn))

    def _rank(self, line: Line, trial: Trial, request: Request, width: int) -> list[float]:
        """Lines are tried by agreement with the request, decision by decision, then marked ones
        first, then in program order; where the run has left the request only that counts.
        """
        left = trial.left
        rank: list[float] = []
        for made in line.decisions:
            if made.role != "agent":
                rank.append(request.draws[made.key][made.alternative])
            elif left or request.choices[made.key] == made.alternative:
                rank.append(made.alternative if left else 0)
            else:
                rank.append(1 if made.marked else 2 + made.alternative)
                left = True
        return [*rank, *[0.0] * (width - len(rank))]

    def _inputs(self, line: Line, trial: Trial) -> Inputs | None:
        """The inputs of a line, whose last statement may be a flow with its domain as a test; None where
        it is not enabled.
        """
        statements = tuple(
            Test(self.model.flows[s.flow].domain, span=s.span) if isinstance(s, Evolve) else s
            for s in line.statements
        )
        if not passable(statements, trial.env, self.exact):
            return None
        if statements not in self.plans:
            self.plans[statements] = planned(statements, self.settings.limits)
        met = {Symbol(key, "input"): value for key, value in trial.values.items()}
        inputs = Inputs(self.plans[statements], frozenset(met), {**trial.env, **met}, self.exact)
        return inputs if inputs.open() else None

    def _execute(self, line: Line, inputs: Inputs, trial: Trial, request: Request) -> Trial:
        """Execute an enabled line: values of its inputs are given so that every test passes."""
        if line.enters and trial.entered == self.model.max_loop:
            return replace(trial, failure="diverged")
        env = dict(trial.env)
        values = dict(trial.values)
        duration, failed, met = trial.duration, trial.failed, trial.met

        def so_far(failure: Failure = "") -> Trial:
            taken = {**trial.taken, **{d.key: d.alternative for d in line.decisions}}
            entered = trial.entered + line.enters
            return Trial(env, taken, values, duration, trial.left, entered, failure, failed, met)

        for statement in line.statements:
            match statement:
                case Assign(variable, term):
                    env[Symbol(variable, "variable")] = value_of(term, env, self.exact)
                case AssignAny(variable, key):
                    if key not in values:
                        values[key] = self._value(statement, inputs, request)
                    env[Symbol(variable, "variable")] = values[key]
                case Test():
                    pass
                case Evolve(flow):
                    if not all(in_range(v) for s, v in env.items() if s.kind == "variable"):
                        return so_far("numerical")
                    watched = self.model.everywhere or not line.rest
                    waiting = [w for w in self._watches if watched and w not in failed | met]
                    motion = self._moved(flow, env, self._part(flow, values, request), waiting)
                    if motion is None:
                        return so_far("numerical")
                    failed, met = failed | {*motion.failed}, met | {*motion.met}
                    env |= {Symbol(x, "variable"): v for x, v in motion.values.items()}
                    duration = duration + motion.duration
                case _:
                    assert_never(statement)
        whole = all(v is not None and in_range(v) for s, v in env.items() if s.kind == "variable")
        return so_far("" if whole else "numerical")

    def _moved(self, flow: int, env: Valuation, part: Value, waiting: Sequence[int]) -> Motion | None:
        """Where a flow leads; None where a value is undefined."""
        try:
            return self.flow(flow, env, self.exact, part, waiting)
        except Undefined:
            return None

    @property
    def _watches(self) -> range:
        return range(len(watches_of(self.model)))

    def _part(self, flow: int, values: dict[str, Value], request: Request) -> Value:
        """The part of its longest duration that a flow takes: all, or what chance or the agent decides."""
        one = literal(Fraction(1), self.exact)
        if f"flow_{flow}" in request.draws:
            return one - literal(Fraction(request.draws[f"flow_{flow}"][0]), self.exact)
        if self.model.duration != "agent":
            return one
        key = f"duration_{flow}"
        if key not in values:
            _, values[key] = nearest([(one * 0, one)], request.inputs[key])
        return values[key]

    def _value(self, statement: AssignAny, inputs: Inputs, request: Request) -> Value:
        """The value of an input that is met for the first time."""
        key = statement.key
        if statement.role == "agent":
            return inputs.nearest(key, request.inputs[key])
        (part,) = request.draws[key]
        return inputs.spread(key, literal(Fraction(part), self.exact))

    # Endings --------------------------------------------------------------------

    def _judged(self, start: Start, done: Trial, request: Request, following: Draws, late: bool) -> Step:
        """Reward and ending of a run that is complete, or failed (semantics 6)."""
        if done.failure:
            return self._unmoved(start, "truncate", done.failure, request, done)
        after = self._state(done.env)
        env = self.environment(after)
        outcome = judge(self.model, env, self.exact, Happened(done.failed, done.met, late))
        reward, reason, status, ends = outcome.reward, outcome.reason, outcome.status, outcome.ends
        upcoming = self.lead(after, following) if self.model.loops else Start(after)
        openings = self.openings(upcoming) if upcoming else Openings(False, {})
        if ends is None:
            if outcome.undefined:
                ends, reason = "truncate", "numerical"
            elif not self.model.loops:
                ends, reason = "terminate", "end"
            elif not openings.open:
                ends, reason = "truncate", "deadlock"
            status = status if ends is None else "none"
        return Step(
            judged=after,
            start=upcoming or Start(after),
            decisions={**request.choices, **done.taken},
            values={**request.inputs, **done.values},
            blocked=done.left,
            duration=done.duration,
            reward=reward + self._penalty(done.left),
            cost=outcome.cost,
            terminated=ends == "terminate",
            truncated=ends == "truncate",
            status=status,
            reason=reason,
            postcondition=truth(self.model.postcondition or TRUE, env, self.exact),
            openings=openings,
        )

    def _unmoved(
        self, start: Start, ends: str, reason: str, request: Request, failed: Trial | None = None
    ) -> Step:
        """Nothing was run to its end: the state stays, and no predicate fires (semantics 3 and 6)."""
        env, loops = self.environment(start.state), self.model.loops
        reward = shapes(self.model, env, self.exact) if loops else literal(Fraction(0), self.exact)
        blocked = failed is None or failed.left
        return Step(
            judged=start.state,
            start=start,
            decisions={**request.choices, **(failed or start).taken},
            values={**request.inputs, **(failed or start).values},
            blocked=blocked,
            duration=literal(Fraction(0), self.exact),
            reward=reward + self._penalty(blocked),
            cost=0,
            terminated=ends == "terminate",
            truncated=ends != "terminate",
            status="none",
            reason=reason,
            postcondition=not loops or truth(self.model.postcondition or TRUE, env, self.exact),
            openings=self.openings(start),
        )

    def _penalty(self, blocked: bool) -> Value:
        return literal(Fraction(self.settings.blocked_penalty if blocked else 0), self.exact)
