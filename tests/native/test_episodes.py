"""Episodes that begin together, in lanes, are those that begin one by one."""

from typing import Any

import numpy as np
import pytest

import dl2c
from dl2c.env.opening import batch_options, open_library, source_of
from dl2c.source import Source

PARABOLA = """
ProgramVariables
  /* @var: bound=[-1:1] */ Real x;
  /* @var: bound=[-2:2] */ Real y;
  Real z;
End.
Problem
  y = x^2 & x != 0.5 -> [{ z := x + y; }*]true
End.
"""
"""Points are kept by how much of the curve they stand for."""

SHELL = "\n".join(
    [
        "ProgramVariables",
        *(f"  /* @var: bound=[-1:1] */ Real x{k};" for k in range(8)),
        "End.",
        "Problem",
        f"  {' + '.join(f'x{k}^2' for k in range(8))} <= 0.04 -> [{{ x0 := x1; }}*]true",
        "End.",
    ]
)
"""Most lanes are given up, because nearly all draws miss a small ball."""

MODELS = {
    "waypoint": source_of("example:waypoint"),
    "bouncing ball": source_of("example:bouncing_ball"),
    "parabola": Source("parabola.kyx", PARABOLA),
    "shell": Source("shell.kyx", SHELL),
}

N = 70
"""One block of episodes, and too few others for lanes."""


def requests(batch: Any, step: int, first: int) -> None:
    rng = np.random.default_rng(step)
    choices = rng.integers(0, 4, (N, *batch.choices.shape[1:]))
    inputs = rng.uniform(-5, 5, (N, *batch.inputs.shape[1:]))
    batch.choices[:] = choices[first : first + len(batch.choices)]
    batch.inputs[:] = inputs[first : first + len(batch.inputs)]


def trace(source: Source, n: int, first: int, mode: str) -> list[list[Any]]:
    """Every buffer, state and constant after every step of episodes of two steps, by environment."""
    library = open_library(source, {"max_episode_steps": 2})
    batch = library.batch(n, autoreset=mode, **batch_options(library.manifest))
    batch.reset(seeds=np.arange(first, first + n, dtype=np.uint64))
    seen: list[list[Any]] = []
    for step in range(7):
        requests(batch, step, first)
        batch.step()
        states = [np.concatenate(batch.get_state(i)).tobytes() for i in range(n)]
        seen.append([(states[i], *(array[i].tobytes() for array in batch.arrays())) for i in range(n)])
    return seen


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
@pytest.mark.parametrize("name", MODELS)
def test_episodes_do_not_depend_on_what_begins_with_them(name: str, mode: str) -> None:
    together = trace(MODELS[name], N, 0, mode)
    for i in (0, 1, 33, 63, 64, 69):
        assert [row[0] for row in trace(MODELS[name], 1, i, mode)] == [row[i] for row in together]


def test_observations_that_others_write_to_are_written_whole() -> None:
    options: dict[str, Any] = {"max_episode_steps": 5}
    envs = [dl2c.make_vec("example:waypoint", N, copy=copy, **options) for copy in (True, False)]
    for env in envs:
        env.reset(seed=3)
    for step in range(12):
        actions = np.full(N, step % 4)
        kept, shared = (env.step(actions)[0] for env in envs)
        assert np.array_equal(kept, shared)
        shared[:] = np.nan
