"""Several threads of one batch: the same bits as one, whatever becomes of them."""

import os
import signal
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import dl2c
from dl2c.env.opening import batch_options, open_library, source_of
from dl2c.native.errors import ResetFailed

MODELS = {
    "exact": "example:waypoint",
    "environment": "example:static_safety",
    "cvodes": "example:dubins",
    "series": "example:pendulum",
}


def trace(model: str, threads: int, n: int, steps: int, mode: str) -> list[bytes]:
    """Every buffer after every step of random requests."""
    library = open_library(source_of(model), {})
    batch = library.batch(n, autoreset=mode, threads=threads, **batch_options(library.manifest))
    rng = np.random.default_rng(5)
    batch.reset(seeds=rng.integers(0, 2**63, n, np.uint64))
    seen: list[bytes] = []
    for _ in range(steps):
        batch.choices[:] = rng.integers(0, 4, batch.choices.shape)
        batch.inputs[:] = rng.uniform(-5, 5, batch.inputs.shape)
        batch.step()
        seen.append(b"".join(array.tobytes() for array in batch.arrays()))
    mask = rng.random(n) < 0.5
    batch.reset(mask)
    seen.append(batch.obs.tobytes())
    return seen


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
@pytest.mark.parametrize("kind", MODELS)
def test_threads_do_not_change_a_bit(kind: str, mode: str) -> None:
    n, steps = (700, 60) if kind == "exact" else (200, 12)
    alone = trace(MODELS[kind], 1, n, steps, mode)
    for threads in (2, 3, 64):
        assert trace(MODELS[kind], threads, n, steps, mode) == alone


def test_a_forked_copy_goes_on_alone() -> None:
    env = dl2c.make_vec("example:waypoint", 256, num_threads=3)
    actions = np.zeros(env.action_space.shape, np.int64)
    env.reset(seed=1)
    env.step(actions)
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        signal.alarm(60)
        obs = env.step(actions)[0]
        os.write(write, obs[-1].tobytes())
        env.close()
        os._exit(0)
    expected = env.step(actions)[0][-1].tobytes()
    assert os.waitpid(child, 0)[1] == 0
    assert os.read(read, len(expected) + 1) == expected


def test_a_refused_state_leaves_the_threads_at_work() -> None:
    library = open_library(source_of("example:waypoint"), {})
    batch = library.batch(300, threads=4)
    batch.reset()
    x, p = batch.get_state(0)
    with pytest.raises(ResetFailed):
        batch.reset_to(299, None, np.full_like(x, 1e6), p)
    batch.step()


@pytest.mark.parametrize("threads", [0, -1, 257])
def test_impossible_numbers_are_refused(threads: int) -> None:
    with pytest.raises(ValueError, match="num_threads"):
        dl2c.make_vec("example:waypoint", 4, num_threads=threads)


def test_every_door_has_them() -> None:
    made: Any = gym.make_vec("dl2c:dl2c/Waypoint-v0", 130, num_threads=2)
    sb3 = dl2c.make_sb3("example:waypoint", 130, num_threads=2)
    sb3.seed(0)
    assert np.array_equal(made.reset(seed=0)[0], sb3.reset())
