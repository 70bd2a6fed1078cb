# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
"""The environment of any model in plain Python, as text for `pure`, like `support`. Never imported.

What is declared first is written for each model, as are `_request` and `_executed`.
"""

from collections.abc import Callable
from dataclasses import asdict, fields, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from dl2c.emit.python.support import Failed, Flow, follow

State = Any
Judgement = Any
CHOICES: Any = None
LARGEST = 1e100
LOOPS = True
NO_INPUTS: Any = None
OBSERVED: Any = None
PATHS: Any = None
initial_state: Any = None
judged: Any = None
postcondition: Any = None
precondition: Any = None
unmoved: Any = None


class Path(NamedTuple):
    """A way through the controller.

    `run` makes its tests and assignments and puts admissible inputs in place of those wanted; None
    where it is blocked. `taken` are its discrete decisions, `fallback` those marked @fallback.
    """

    run: Callable[[State, dict[str, float]], State | None]
    taken: dict[str, int]
    fallback: tuple[str, ...]
    flow: Flow | None


def preference(path: Path, choices: dict[str, int]) -> list[int]:
    """Paths are tried by agreement with the request, then marked ones, then in program order."""
    rank, left = [], False
    for key, taken in path.taken.items():
        agrees = choices[key] == taken
        if left:
            rank.append(taken)
        else:
            rank.append(0 if agrees else 1 if key in path.fallback else 2 + taken)
            left = not agrees
    return rank


class SupportEnv(gym.Env):
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, in `options["state"]` if that is given."""
        super().reset(seed=seed)
        if options and "state" in options:
            self.state = State(**options["state"])
            if not precondition(self.state):
                raise ValueError("the state does not satisfy the precondition")
        else:
            self.state = self._drawn()
        self._steps, self._stalled, self._time, self._running = 0, 0, 0.0, True
        return self._observe()[0], self._with_mask({})

    def _drawn(self) -> State:
        for _ in range(1_000_000):
            s = replace(initial_state(self.np_random), **self.constants)
            if precondition(s) and any(path.run(s, dict(NO_INPUTS)) for path in PATHS):
                return s
        raise RuntimeError("no initial state was found")

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One run of the loop's body."""
        if not self._running:
            raise gym.error.ResetNeeded("call reset() before step()")
        choices, inputs = self._request(action)
        self._steps += 1
        late = self._steps == self.max_episode_steps
        path, moved, values = self._chosen(choices, inputs)
        blocked = any(choices[key] != taken for key, taken in path.taken.items())
        duration, failed, met, reason = 0.0, set(), set(), "blocked"
        if not blocked or self.on_blocked == "fallback":
            choices, inputs = {**choices, **path.taken}, values
            duration, failed, met, reason = self._move(path.flow, moved)
        verdict = judged(self.state, failed, met, late)
        if reason:
            verdict = unmoved(self.state)
        self._time += duration
        self._stalled = 0 if duration > 0 else self._stalled + 1
        terminated, truncated, status, reason = self._ending(verdict, reason, late)
        self._running = not (terminated or truncated)
        observation, saturated = self._observe()
        info = {
            "status": status,
            "reason": reason,
            "cost": verdict.cost,
            "blocked": blocked,
            "executed_action": self._executed(choices, inputs),
            "duration": duration,
            "time": self._time,
            "postcondition": postcondition(self.state) or bool(reason and not LOOPS),
            "saturated": saturated,
        }
        if not self._running:
            info["is_success"] = status == "success"
        reward = verdict.reward + (self.blocked_penalty if blocked else 0.0)
        return observation, reward, terminated, truncated, self._with_mask(info)

    def _move(
        self, flow: Flow | None, s: State
    ) -> tuple[float, set[str], set[str], str]:
        """Moves the state; says how long that took, what failed or was met, and what went wrong."""
        duration, failed, met = 0.0, set(), set()
        try:
            if flow is not None:
                s, duration, failed, met = follow(flow, s)
        except Failed:
            return 0.0, set(), set(), "solver"
        except (ArithmeticError, ValueError):
            return 0.0, set(), set(), "numerical"
        if not all(abs(x) <= LARGEST for x in asdict(s).values()):
            return 0.0, set(), set(), "numerical"
        self.state = s
        return duration, failed, met, ""

    def _chosen(
        self, choices: dict[str, int], inputs: dict[str, float]
    ) -> tuple[Path, State, dict[str, float]]:
        """The path nearest to the request that is not blocked, and what it leads to."""
        for path in sorted(PATHS, key=lambda path: preference(path, choices)):
            values = dict(inputs)
            moved = path.run(self.state, values)
            if moved is not None:
                return path, moved, values
        raise AssertionError("a state without a run ends the episode")

    def _ending(
        self, verdict: Judgement, reason: str, late: bool
    ) -> tuple[bool, bool, str, str]:
        """Terminated, truncated, status and reason: what comes first is more important."""
        if reason == "blocked":
            terminated = self.on_blocked == "terminate"
            return terminated, not terminated, "none", reason
        if reason:
            return False, True, "none", reason
        if verdict.ends:
            terminated = verdict.ends == "terminate"
            return terminated, not terminated, verdict.status, verdict.reason
        if verdict.undefined:
            return False, True, "none", "numerical"
        if not LOOPS:
            return True, False, "none", "end"
        if not any(path.run(self.state, dict(NO_INPUTS)) for path in PATHS):
            return False, True, "none", "deadlock"
        if self.stall_limit and self._stalled >= self.stall_limit:
            return False, True, "none", "stalled"
        if late:
            return False, True, "none", "time_limit"
        return False, False, verdict.status, ""

    def _observe(self) -> tuple[Any, bool]:
        """The observation, and whether the space's limits cut something off."""
        box = self.observation_space
        values = np.array([getattr(self.state, name) for name in OBSERVED])
        largest = np.finfo(box.dtype).max
        low, high = np.maximum(box.low, -largest), np.minimum(box.high, largest)
        with np.errstate(over="ignore"):
            exact = values.astype(box.dtype)
        seen = np.clip(exact, low, high)
        return seen, bool((seen != exact).any())

    def _with_mask(self, info: dict[str, Any]) -> dict[str, Any]:
        if not CHOICES:
            return info
        return info | {"action_mask": self.action_masks().astype(np.int8)}

    def action_masks(self) -> Any:
        """Which alternatives have a run, one entry per alternative, as MaskablePPO asks."""
        taken = [p.taken for p in PATHS if p.run(self.state, dict(NO_INPUTS))]
        mask = []
        for key, count in CHOICES.items():
            met = {t[key] for t in taken if key in t and self._running}
            mask += [not met or k in met for k in range(count)]
        return np.array(mask, dtype=bool)

    def render(self) -> str | None:
        """Time and state on one line."""
        if self.render_mode != "ansi":
            return None
        values = [
            f"{f.name}={getattr(self.state, f.name):.6g}" for f in fields(self.state)
        ]
        return "  ".join([f"time={self._time:.6g}", *values])
