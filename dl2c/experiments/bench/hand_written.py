"""The waypoint example as a loop written by hand in C: what the generated code is measured against.

Its source is part of the tests, so that a checkout has it and an installed package has not. It is
compiled on the spot with the flags of generated code.
"""

import ctypes
import tempfile
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from dl2c.env.opening import examples_dir
from dl2c.native.toolchain import STRICT_FLAGS, find_compiler, link_flags, run
from dl2c.source import Source

SOURCE = examples_dir().parent / "tests" / "bench" / "waypoint_loop.c"

WORDS, STATE = 18, 11
"""Sizes of `struct waypoint`: words in all, and those of variables and constants, which come first."""

RESULTS: dict[str, tuple[int, type[np.generic]]] = {
    **dict.fromkeys(("obs", "final_obs"), (11, np.float32)),
    "mask": (4, np.int8),
    **dict.fromkeys(("reward", "duration", "time"), (1, np.float64)),
    **dict.fromkeys(("choice", "status", "reason", "cost"), (1, np.int32)),
    **dict.fromkeys(("terminated", "truncated", "blocked"), (1, np.uint8)),
    **dict.fromkeys(("postcondition", "saturated", "reset"), (1, np.uint8)),
}
"""The fields of `struct results` in order: entries per environment and their type."""


def is_there(source: Source) -> bool:
    """Whether the hand-written loop does what this model says: it is the waypoint example in a checkout."""
    return SOURCE.is_file() and source.text == Source.read(examples_dir() / "waypoint.kyx").text


@final
class HandWritten:
    """n environments, seeded 0, 1, ..., n-1. `state` is (n, 11): variables, then constants.

    Raises `CompilerMissing`, `CompilerFailed`.
    """

    __slots__ = ("_envs", "_lib", "_out", "_step", "n", "results", "state")

    def __init__(self, n: int, native: bool | None = None) -> None:
        self._lib, self.n = _compiled(native), n
        self._envs = np.zeros((n, WORDS))
        self.state = self._envs[:, :STATE]
        self.results: dict[str, NDArray[Any]] = {
            name: np.zeros((n, entries), dtype) for name, (entries, dtype) in RESULTS.items()
        }
        pointers = [array.ctypes.data for array in self.results.values()]
        self._out = (ctypes.c_void_p * len(pointers))(*pointers)
        self._lib.waypoint_reset(*self._all(), ctypes.c_uint64(0))
        self._step = (*self._all(), self._out)

    def _all(self) -> tuple[ctypes.c_void_p, ctypes.c_int64]:
        return ctypes.c_void_p(self._envs.ctypes.data), ctypes.c_int64(self.n)

    def step(self) -> None:
        """Step every environment once; `results` and `state` change."""
        self._lib.waypoint_step(*self._step)

    def refresh(self) -> None:
        """Take note of what was written to `state`."""
        self._lib.waypoint_refresh(*self._all())


def _compiled(native: bool | None) -> ctypes.CDLL:
    compiler = find_compiler()
    with tempfile.TemporaryDirectory(prefix="dl2c-") as folder:
        library = Path(folder, "waypoint_loop.so")
        flags = (*compiler.flags(native), *STRICT_FLAGS)
        run((*compiler.command, *flags, str(SOURCE), *link_flags(), "-o", str(library)), Path(folder))
        return ctypes.CDLL(str(library))
