"""Beginning episodes of a batch: which random streams restart, and from which seed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from dl2c.native.binding import Batch

SEEDS = 2**64
"""Random streams are keyed by 64 bits; seeds are taken modulo this."""


def spread(seed: int | Sequence[int | None] | None, n: int) -> list[int | None]:
    """One seed per environment: s becomes s, s+1, ..., s+n-1. A list has n entries, else `ValueError`."""
    if seed is None:
        return [None] * n
    if isinstance(seed, int):
        return [seed + i for i in range(n)]
    if len(seed) != n:
        raise ValueError(f"{len(seed)} seeds for {n} environments")
    return list(seed)


def draw_seed(rng: np.random.Generator) -> int:
    """A seed for an environment that was given none."""
    return int(rng.integers(SEEDS, dtype=np.uint64))


def begin(
    batch: "Batch",
    mask: NDArray[np.bool_],
    seeds: Sequence[int | None],
    seeded: NDArray[np.bool_],
    rng: np.random.Generator,
) -> None:
    """Reset the environments in `mask`. One with a seed restarts from it, one never seeded from a drawn
    seed, the others go on with their stream. `seeded` is brought up to date.
    """
    named = np.array([s is not None for s in seeds])
    restart = mask & (named | ~seeded)
    keys = np.array([0 if s is None else s % SEEDS for s in seeds], np.uint64)
    for i in np.flatnonzero(restart & ~named):
        keys[i] = draw_seed(rng)
    if restart.any():
        batch.reset(restart, keys)
    if (mask & ~restart).any():
        batch.reset(mask & ~restart)
    seeded |= mask
