"""Long use: memory stays where it is, whatever number of steps, batches and environments."""

import ctypes
import gc
from pathlib import Path

import numpy as np
import pytest

import dl2c
from dl2c.native.binding import Library

STATM = Path("/proc/self/statm")
TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)
"""Gives the system back what `free` has kept; only glibc has it."""
EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "waypoint.kyx"
BATCH = 1024
ROOM = 3 * 1024**2
"""Bytes that Python's own allocator may take on the way."""

pytestmark = pytest.mark.skipif(not STATM.exists(), reason="the system does not say how much memory is used")


def resident() -> int:
    """Bytes of memory in use, without what was freed and not given back."""
    gc.collect()
    if TRIM is not None:
        TRIM(0)
    return int(STATM.read_text(encoding="ascii").split()[1]) * 4096


@pytest.fixture(scope="module")
def library() -> Library:
    return dl2c.build(EXAMPLE).library


def stepped(library: Library, steps: int, autoreset: str) -> int:
    """Step a fresh batch that often in all; returns how many episodes began meanwhile."""
    batch = library.batch(BATCH, autoreset=autoreset, max_steps=50)
    batch.reset(seeds=np.arange(BATCH, dtype=np.uint64))
    alternatives = len(library.manifest.choices[0].alternatives)
    rng = np.random.default_rng(0)
    began = 0
    for _ in range(steps // BATCH):
        batch.choices[:, 0] = rng.integers(alternatives, size=BATCH)
        batch.step()
        began += int((batch.terminated | batch.truncated).sum())
    if steps % 2:
        batch.close()
    return began


def check_memory(library: Library, steps: int) -> None:
    for mode in ("same_step", "next_step"):
        stepped(library, 50 * BATCH, mode)
        before = resident()
        assert stepped(library, steps, mode) > BATCH
        assert resident() - before < ROOM


def test_memory_is_flat_over_a_million_steps(library: Library) -> None:
    check_memory(library, 1_000_000)


@pytest.mark.slow
def test_memory_is_flat_over_many_million_steps(library: Library) -> None:
    check_memory(library, 10_000_000)


def test_batches_give_their_memory_back(library: Library) -> None:
    for k in range(20):
        stepped(library, 2 * BATCH + k % 2, "same_step")
    before = resident()
    for k in range(300):
        stepped(library, 2 * BATCH + k % 2, "same_step")
    assert resident() - before < ROOM


def test_environments_give_their_memory_back() -> None:
    for count in (10, 80):
        before = resident()
        for seed in range(count):
            env = dl2c.make(EXAMPLE)
            env.reset(seed=seed)
            env.step(env.action_space.sample())
            env.close()
    assert resident() - before < ROOM
