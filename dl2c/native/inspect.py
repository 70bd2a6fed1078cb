"""What a model's library says of a state and of the last step, for those who show it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dl2c.native.binding import Batch, Library


def scene_values(
    library: Library, x: NDArray[np.float64], p: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """What the scene of the model shows of state x (nx) with constants p (np), into `out` (nscene)."""
    memory = library.row(out, np.float64, library.sizes.nscene, "double[]")
    library.check(library.lib.dl2c_scene_values(*library.state(x, p), memory))


def motion(batch: Batch, i: int, fractions: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """States (n, nx) inside the last step of environment i, at fractions of the time that its flows took: 0
    is where the first of them began, 1 where the last one ended.

    Only of a batch whose library was built to `inspect`. Raises `ValueError` for a fraction outside [0, 1],
    `IndexError` for no such environment.
    """
    given = np.ascontiguousarray(fractions, np.float64)
    if not ((given >= 0) & (given <= 1)).all():
        raise ValueError("fractions of a step are from 0 to 1")
    if not 0 <= i < batch.n:
        raise IndexError(f"environment {i} of a batch of {batch.n}")
    library = batch.library
    x = np.empty((len(given), library.sizes.nx))
    ffi, call = library.ffi, library.lib.dl2c_inspect_motion
    memory = ffi.from_buffer("double[]", given), ffi.from_buffer("double[]", x)
    library.check(batch.called(call, i, len(given), *memory))
    return x


def violations(library: Library, x: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.int32]:
    """How many @safety predicates are violated in each of the states x (n, nx) with constants p (np): (n).

    Only of a library that was built to `inspect`.
    """
    states = np.ascontiguousarray(x, np.float64)
    if states.ndim != 2 or states.shape[1] != library.sizes.nx:
        raise ValueError(f"expected states of {library.sizes.nx} values, not an array of shape {x.shape}")
    found = np.empty(len(states), np.int32)
    ffi = library.ffi
    constants = library.row(p, np.float64, library.sizes.np, "double[]")
    memory = ffi.from_buffer("double[]", states), constants, ffi.from_buffer("int32_t[]", found)
    library.check(library.lib.dl2c_inspect_violations(len(states), *memory))
    return found
