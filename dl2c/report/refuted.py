"""A run that refutes a theorem, as an episode of the model's environment: for `dl2c replay`.

An environment executes some of a model's runs: from states that doubles hold, within limits of inputs and of
time, and with tolerances. So the exact run is tried out, step by step: of the actions that ask for its
decisions, the one that leads to its next state. What counts is where the environment really comes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, product
from typing import Any

from dl2c.diagnostics import CompileError
from dl2c.env.single import Dl2cEnv
from dl2c.env.snapshot import Snapshot
from dl2c.native.errors import NativeError, ResetFailed
from dl2c.options import UnknownOption
from dl2c.report.episode import Episode, Start, begin, difference, play, replay
from dl2c.report.falsify import violation
from dl2c.source import Source
from dl2c.verify.report import Counterexample, Step

NEAR = 1e-6
"""How far a state may be from that of the exact run, relative to 1 and to its size."""

MOST = 512
"""Actions that are tried in one step."""

MOMENTS = (1.0, 0.5, 0.1, 0.01)
"""Parts of the longest duration that are tried where the run goes on for some moment."""

Action = dict[str, Any] | int


class CannotFollow(Exception):
    """The environment does not come where the run comes; the message says why."""


def followed(source: Source, given: Mapping[str, Any], run: Counterexample) -> Episode:
    """The episode in which the postcondition fails as in the run, replayed once already.

    Options that are not given are chosen so that the environment can follow. Raises `CannotFollow`.
    """
    if not run.steps:
        raise CannotFollow("the run ends before the first step")
    reason = ""
    for chosen in _choices(given, run):
        env = opened(source, chosen)
        try:
            episode = _Follower(env, run).episode()
            return checked(episode, lambda again: violation(again, "postcondition", ()) > 0)
        except CannotFollow as failure:
            reason = str(failure)
        finally:
            env.close()
    raise CannotFollow(reason)


def _choices(given: Mapping[str, Any], run: Counterexample) -> Iterator[dict[str, Any]]:
    """The options as given; then such that durations are decided too."""
    form = {"action_format": "dict", "action_map": "project", "on_blocked": "truncate"}
    yield {**given, **form, "monitor_every_step": False}
    durations = [value for step in run.steps for name, value in step.decisions if name == "duration"]
    longest = {"dt": max(durations)} if any(durations) and all(s.state for s in run.steps) else {}
    yield {"duration": "agent", **longest, **given, **form, "monitor_every_step": False}


def opened(source: Source, options: Mapping[str, Any]) -> Dl2cEnv:
    """The environment that is to follow. Raises `CannotFollow` where there is none."""
    try:
        return Dl2cEnv(source, **options)
    except CompileError as refused:
        raise CannotFollow(refused.diagnostics[0].title) from None
    except (NativeError, UnknownOption) as refused:
        raise CannotFollow(str(refused)) from None


def begun(env: Dl2cEnv, state: Mapping[str, float | Fraction]) -> Start:
    """How the episode begins in a state, of which the environment needs what it does not fix. It has begun
    then. Raises `CannotFollow`.
    """
    free = [q.name for q in (*env.manifest.variables, *env.manifest.constants) if q.value is None]
    start = Start(0, 0, {name: float(state[name]) for name in free if name in state})
    try:
        begin(env, start)
    except (ResetFailed, ValueError) as refused:
        raise CannotFollow(f"the environment does not begin there: {refused}") from None
    return start


def checked(episode: Episode, violates: Callable[[Episode], bool]) -> Episode:
    """The episode, which violates what it is about. Raises `CannotFollow` for one that is another when it is
    replayed.
    """
    again = replay(episode)
    if difference(episode, again) or not violates(again):
        raise CannotFollow("the episode is not the same when it is replayed")
    return episode


@dataclass(frozen=True, slots=True)
class _Follower:
    """Looks for the actions of an environment that follow a run."""

    env: Dl2cEnv
    run: Counterexample

    def episode(self) -> Episode:
        """Raises `CannotFollow`."""
        start = begun(self.env, self.run.state)
        actions: list[Action] = []
        for number, step in enumerate(self.run.steps, 1):
            actions.append(self._next(number, step, number == len(self.run.steps)))
        episode = play(self.env, start, actions)
        if not violation(episode, "postcondition", ()):
            raise CannotFollow("the postcondition holds within the environment's tolerance")
        return episode

    def _next(self, number: int, step: Step, last: bool) -> Action:
        """An action that leads to the next state of the run; at its end one that violates the postcondition,
        if possible in the state where the run ends. The environment has then taken it. Raises `CannotFollow`.
        """
        before, ended = self.env.save(), False
        violating: Action | None = None
        for action in islice(self._actions(step, before), MOST):
            self.env.restore(before)
            _, _, terminated, truncated, info = self.env.step(action)
            near = not info["blocked"] and _near(self.env.state, step.state)
            if last and not info["blocked"] and not info["postcondition"]:
                violating = action
                if near:
                    break
            elif not last and near and not (terminated or truncated):
                return action
            ended |= near and (terminated or truncated)
        if violating is not None:
            return violating
        if ended and not last:
            raise CannotFollow(f"the episode ends with step {number}, before the run does")
        what = "violates the postcondition" if last else "leads where the run comes"
        raise CannotFollow(f"within bounds, durations and tolerance no action of step {number} {what}")

    def _actions(self, step: Step, before: Snapshot) -> Iterator[Action]:
        """The actions that may ask for a step's decisions."""
        manifest = self.env.manifest
        if not manifest.choices and not manifest.inputs:
            yield 0
            return
        inputs = [i for i in manifest.inputs if not i.key.startswith("duration")]
        asked = [[c.key for c in manifest.choices], [i.key for i in inputs]]
        ranges: list[Sequence[Any]] = [range(len(c.alternatives)) for c in manifest.choices]
        for i in inputs:
            values = [float(v) for name, v in step.decisions if name == f"{i.variable} := *"]
            ranges.append([[v] for v in dict.fromkeys(values)] or [[min(max(0.0, i.low), i.high)]])
        for chosen in product(*ranges):
            yield from self._lasting(dict(zip((*asked[0], *asked[1]), chosen, strict=True)), step, before)

    def _lasting(self, action: dict[str, Any], step: Step, before: Snapshot) -> Iterator[Action]:
        """An action with the parts of the longest durations that make flows last as they do in the run."""
        keys = [i.key for i in self.env.manifest.inputs if i.key.startswith("duration")]
        durations = [value for name, value in step.decisions if name == "duration"]
        whole = {**action, **{key: [0.0] for key in keys}}
        rest = list(durations)
        for key in keys:
            shortest, longest = (self._duration(whole | {key: [part]}, before) for part in (0.0, 1.0))
            if longest > shortest and rest:
                whole[key] = [float(min(Fraction(1), rest.pop(0) / Fraction(longest - shortest)))]
            elif longest > shortest:
                yield from ({**whole, key: [part]} for part in MOMENTS)
        yield whole

    def _duration(self, action: Action, before: Snapshot) -> float:
        """How long a step lasts."""
        self.env.restore(before)
        return float(self.env.step(action)[4]["duration"])


def _near(state: Mapping[str, float], wanted: Mapping[str, Fraction] | None) -> bool:
    """Whether a state is that of the run, if that has one."""
    return wanted is None or all(
        abs(value - float(wanted[name])) <= NEAR * (1 + abs(value))
        for name, value in state.items()
        if name in wanted
    )
