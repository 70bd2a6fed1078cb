"""Episodes of a small model in both forms: the reference interpreter and the compiled environment.

`Both` makes the environment of a model as a user does and an interpreter beside it. Every step is
taken in both; they must agree to the last bit. What surrounds the interpreter (the time limit) is
added here. Models are compiled without optimisation, which does not change a bit.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

import dl2c
from dl2c.configuration import resolve_options
from dl2c.env.opening import source_of
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import watches_along
from dl2c.interp.follow import follow
from dl2c.interp.step import Interpreter
from dl2c.interp.transition import Request, Start, Step
from dl2c.pipeline import step_model


@dataclass(frozen=True)
class Seen:
    """What a user sees of one step. `success` is None while the episode goes on."""

    state: dict[str, float]
    reward: float
    cost: int
    terminated: bool
    truncated: bool
    status: str
    reason: str
    duration: float
    postcondition: bool
    success: bool | None

    @property
    def ended(self) -> bool:
        return self.terminated or self.truncated

    @property
    def ending(self) -> tuple[str, str, str]:
        """How the episode stands: terminated, truncated or "", then status and reason."""
        flag = "terminated" if self.terminated else "truncated" if self.truncated else ""
        return flag, self.status, self.reason


class Both:
    """One model in both forms; `options` as for `dl2c.make`."""

    def __init__(self, model: str, **options: Any) -> None:
        with quick_builds():
            self.env = dl2c.make(model, **options)
        self.limit = self.env.manifest.options["max_episode_steps"] or math.inf
        self.model, self.paths = step_model(source_of(model), resolve_options(options))
        flows = enumerate(self.model.flows)
        plans = [plan_flow(flow, watches_along(self.model, k)) for k, flow in flows]
        assert all(isinstance(p, FlowPlan) and p.kernel == "exact" for p in plans)
        self.plans = [p for p in plans if isinstance(p, FlowPlan)]
        self.steps = 0

    def begin(self, **state: float) -> None:
        """An episode from this state; what is not named is 0."""
        names = [q.name for q in (*self.env.manifest.variables, *self.env.manifest.constants)]
        fixed = {q.name: q.value for q in self.env.manifest.constants if q.value is not None}
        self.env.reset(options={"state": {name: state.get(name, fixed.get(name, 0.0)) for name in names}})
        self.steps = 0

    def step(self, action: Any = 0) -> Seen:
        """One step of the episode in both forms."""
        before = self.env.state
        asked = np.array(action) if np.ndim(action) else action
        observation, reward, terminated, truncated, info = self.env.step(asked)
        assert observation.shape == self.env.observation_space.shape
        assert not (terminated and truncated)
        after = {v.name: self.env.state[v.name] for v in self.model.variables}
        seen = Seen(
            after,
            reward,
            info["cost"],
            terminated,
            truncated,
            info["status"],
            info["reason"],
            info["duration"],
            info["postcondition"],
            info.get("is_success"),
        )
        self.steps += 1
        assert seen == self._interpreted(before, action)
        return seen

    def first(self, action: Any = 0, **state: float) -> Seen:
        """The first step from a state."""
        self.begin(**state)
        return self.step(action)

    def _interpreted(self, before: dict[str, float], action: Any) -> Seen:
        constants = {c.name: before[c.name] for c in self.model.constants}
        state = {v.name: before[v.name] for v in self.model.variables}

        def flow(k: int, env: Any, exact: bool, part: Any, waiting: Any) -> Any:
            return follow(self.plans[k], env, exact, part, waiting)

        keys = [d.key for d in self.paths.decisions]
        made: list[int] = np.broadcast_to(action, len(keys)).tolist()
        choices = dict(zip(keys, made, strict=True))
        late = self.steps >= self.limit
        interpreter = Interpreter(self.model, constants, flow)
        step = interpreter.step(Start(state), Request(choices), late=late)
        return _seen(step, late)


def _seen(step: Step, late: bool) -> Seen:
    """The interpreter's step as a user sees it."""
    over = late and not (step.terminated or step.truncated)
    ended = over or step.terminated or step.truncated
    status = "none" if over else step.status
    return Seen(
        {name: float(value) for name, value in step.state.items()},
        float(step.reward),
        step.cost,
        step.terminated,
        step.truncated or over,
        status,
        "time_limit" if over else step.reason,
        float(step.duration),
        step.postcondition,
        status == "success" if ended else None,
    )


@contextmanager
def quick_builds() -> Iterator[None]:
    """The compiler does not optimise."""
    flags = os.environ.get("CFLAGS")
    os.environ["CFLAGS"] = "-O0"
    try:
        yield
    finally:
        if flags is None:
            del os.environ["CFLAGS"]
        else:
            os.environ["CFLAGS"] = flags


def theorem(definitions: str, body: str, post: str = "true", above: str = "", variables: str = "") -> str:
    """A model with variables x, v, a, t and those given, all in [-100, 100], and no assumptions."""
    names = ["x", "v", "a", "t", *variables.split()]
    declared = "\n".join(f"  /* @var: bound=[-100:100] */\n  Real {name};" for name in names)
    return (
        f'Theorem "Rule"\nDefinitions\n{definitions}\nEnd.\nProgramVariables\n{declared}\nEnd.\n'
        f"{above}\nProblem\n  x = x -> [{{ {body} }}*] ({post})\nEnd.\nEnd.\n"
    )
