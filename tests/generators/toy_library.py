"""A library without C: what the environments need of one, for any mix of decisions.

The state is one variable x and one constant k. A step adds the choices, the inputs and k/100 to x;
alternative 1 of a choice is disabled above 5. Reaching 10 is a success, going below -5 a failure.
"""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dl2c.native.describe import options_as_data
from dl2c.native.errors import ResetFailed
from dl2c.native.manifest import (
    ChoiceSpec,
    InputSpec,
    Manifest,
    PredicateSpec,
    Quantity,
    SceneSpec,
    TheoremSpec,
)
from dl2c.native.results import Results, Widths
from dl2c.options import Options

OPTIONS: dict[str, Any] = options_as_data(Options()) | {
    "action_format": "auto",
    "action_map": "project",
    "on_blocked": "fallback",
    "blocked_penalty": 0.0,
    "max_episode_steps": 20,
    "stall_limit": 0,
    "obs_dtype": "float32",
    "observation_bounds": "declared",
}


def toy_manifest(counts: tuple[int, ...] = (3,), inputs: int = 0, **options: Any) -> Manifest:
    runs = tuple(tuple(int(k) for k in run) for run in np.ndindex(*counts))
    return Manifest(
        name="toy",
        source="toy.kyx",
        dl2c_version="0",
        abi_version=6,
        stream_version=4,
        key="",
        variables=(Quantity("x", -10.0, 20.0, unit="m"),),
        constants=(Quantity("k", 0.0, 0.3),),
        observations=(Quantity("x", -10.0, 20.0), Quantity("k", 0.1, 0.3)),
        choices=tuple(ChoiceSpec(f"choice_{i}", tuple("abcdefgh"[:n])) for i, n in enumerate(counts)),
        inputs=tuple(InputSpec(f"assign_u{i}", f"u{i}", -1.5, 2.0) for i in range(inputs)),
        drawn_choices=(),
        drawn_inputs=(),
        runs=runs,
        run_texts=tuple(map(str, runs)),
        predicates=(PredicateSpec("goal", "progress"), PredicateSpec("safe", "safety")),
        flows=(),
        certificate="sampled",
        sampler={},
        options=OPTIONS | options,
        notes=(),
        platform={},
        conditions=(),
        theorem=TheoremSpec("toy", "", "not checked"),
        scene=SceneSpec((), {}, ()),
    )


def use_toy(patch: pytest.MonkeyPatch, counts: tuple[int, ...] = (3,), inputs: int = 0) -> None:
    """Make every model that is opened this one."""
    patch.setattr(
        "dl2c.env.opening.build",
        lambda _, given, progress=None, inspect=False: SimpleNamespace(
            library=ToyLibrary(toy_manifest(counts, inputs, **given))
        ),
    )


@dataclass(frozen=True)
class ToyLibrary:
    manifest: Manifest

    def batch(self, n: int, *, autoreset: str = "disabled", max_steps: int = 20, **_: Any) -> "ToyBatch":
        return ToyBatch(self.manifest, n, autoreset, max_steps)


class ToyBatch(Results):
    def __init__(self, manifest: Manifest, n: int, autoreset: str, max_steps: int) -> None:
        counts = [len(c.alternatives) for c in manifest.choices]
        super().__init__(n, Widths(len(counts), len(manifest.inputs), 0, 0, sum(counts)))
        self._counts, self._autoreset, self._max_steps = counts, autoreset, max_steps
        self._x, self._k = np.zeros(n), np.zeros(n)
        self._seed, self._episode = [0] * n, [0] * n
        self._steps, self._ended = np.zeros(n, int), np.zeros(n, bool)
        self.choices = np.zeros((n, len(counts)), np.int32)
        self.inputs = np.zeros((n, len(manifest.inputs)))
        self.obs, self.final_obs = np.zeros((2, n, 2), manifest.options["obs_dtype"])

    def reset(self, mask: Any = None, seeds: Any = None) -> None:
        for i in range(self._n):
            if mask is None or mask[i]:
                if seeds is not None:
                    self._seed[i], self._episode[i] = int(seeds[i]), 0
                self._begin(i)

    def reset_to(self, i: int, seed: int | None, x: Any, p: Any) -> None:
        if not 0 <= p[0] <= 0.3:
            raise ResetFailed("the state violates the precondition")
        if seed is not None:
            self._seed[i], self._episode[i] = seed, 0
        self._begin(i)
        self._x[i], self._k[i] = x[0], p[0]
        self._look(i)

    def decides(self) -> Any:
        return np.ones(self._n, np.bool_)

    def _begin(self, i: int) -> None:
        rng = np.random.default_rng([self._seed[i], self._episode[i]])
        self._episode[i] += 1
        self._x[i], self._k[i] = rng.uniform(0, 1), rng.uniform(0.1, 0.3)
        self._steps[i], self._ended[i], self.began[i] = 0, False, True
        self._look(i)

    def _look(self, i: int) -> None:
        self.obs[i] = self._x[i], self._k[i]
        column = 0
        for count in self._counts:
            self.mask[i, column : column + count] = [j != 1 or self._x[i] <= 5 for j in range(count)]
            column += count

    def check_open(self) -> None:
        pass

    def native_step(self) -> Any:
        return self.step

    def step_in_c(self, *_: Any) -> None:
        return None

    def check(self, status: int) -> None:
        raise AssertionError(status)

    def step(self) -> None:
        self.began[:] = False
        for i in range(self._n):
            if self._ended[i] and self._autoreset == "next_step":
                self._begin(i)
                self.rewards[i] = self.terminated[i] = self.truncated[i] = 0
            else:
                self._advance(i)

    def _advance(self, i: int) -> None:
        high = self._x[i] > 5
        self.blocked[i] = any(high and c == 1 for c in self.choices[i])
        self.executed_choices[i] = [0 if high and c == 1 else c for c in self.choices[i]]
        self.executed_inputs[i] = np.clip(self.inputs[i], -1.5, 2)
        self._x[i] += self.executed_choices[i].sum() + self.executed_inputs[i].sum() + self._k[i] / 100
        self._steps[i] += 1
        self.duration[i], self.time[i] = 0.1, self._steps[i] / 10
        goal, unsafe = self._x[i] >= 10, self._x[i] < -5
        late = not (goal or unsafe) and self._steps[i] >= self._max_steps
        self.rewards[i], self.cost[i] = self._x[i], unsafe
        self.terminated[i], self.truncated[i], self.postcondition[i] = goal or unsafe, late, not unsafe
        self.status[i] = 1 if goal else 2 if unsafe else 0
        self.reason[i] = 16 if goal else 17 if unsafe else 7 if late else 0
        self._look(i)
        self._ended[i] = goal or unsafe or late
        if self._ended[i]:
            self.mask[i] = 1
            self.final_obs[i] = self.obs[i]
            if self._autoreset == "same_step":
                self._begin(i)

    def get_state(self, i: int) -> tuple[Any, Any]:
        return self._x[i : i + 1].copy(), self._k[i : i + 1].copy()

    def set_state(self, i: int, x: Any, p: Any) -> None:
        self._x[i], self._k[i] = x[0], p[0]

    def close(self) -> None:
        pass
