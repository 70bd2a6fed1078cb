"""What a step tells of n environments besides their observations, in arrays side by side in one memory."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

CACHE_LINE = 64
"""Bytes in it."""

OUTCOME = struct.Struct("@3d3i6?")
"""How `Results.memory` of one environment begins."""

OUTCOME_NAMES = (
    *("rewards", "duration", "time", "status", "reason", "cost"),
    *("terminated", "truncated", "blocked", "postcondition", "saturated", "began"),
)
"""The buffers that `OUTCOME` reads, in their order."""


@dataclass(frozen=True, slots=True)
class Widths:
    """How many entries the rows of results have: fields of `dl2c_sizes`."""

    nchoice: int
    ninput: int
    nenvchoice: int
    nenvinput: int
    nmask: int


class Results:
    """The buffers of `dl2c_buffers` that a step writes, except observations; names and shapes are the same.

    The flags are numpy bools. The buffer `reset` is here `began`, since a batch has a method of that name.
    """

    __slots__ = (
        *("_n", "_widths", "memory", "ends"),
        *OUTCOME_NAMES,
        *("executed_choices", "executed_inputs", "drawn_choices", "drawn_inputs", "mask"),
    )

    def __init__(self, n: int, widths: Widths, memory: NDArray[np.uint8] | None = None) -> None:
        """Arrays over `memory`, which another one of the same sizes has laid out; else over fresh memory."""
        self._n, self._widths = n, widths
        inputs, choices = widths.ninput + widths.nenvinput, widths.nchoice + widths.nenvchoice
        outcome = -(-OUTCOME.size * n // 8) * 8
        size = outcome + n * (8 * inputs + 4 * choices + widths.nmask)
        self.memory = zeros((size,), np.uint8) if memory is None else memory
        take = _parts(self.memory)
        self.rewards, self.duration, self.time = take(np.float64, 3, n)
        self.status, self.reason, self.cost = take(np.int32, 3, n)
        flags = take(np.bool_, 6, n)
        self.ends: NDArray[np.bool_] = flags[:2]
        self.terminated, self.truncated, self.blocked, self.postcondition, self.saturated, self.began = flags
        take = _parts(self.memory[outcome:])
        self.executed_inputs: NDArray[np.float64] = take(np.float64, n, widths.ninput)
        self.drawn_inputs: NDArray[np.float64] = take(np.float64, n, widths.nenvinput)
        self.executed_choices: NDArray[np.int32] = take(np.int32, n, widths.nchoice)
        self.drawn_choices: NDArray[np.int32] = take(np.int32, n, widths.nenvchoice)
        self.mask: NDArray[np.int8] = take(np.int8, n, widths.nmask)
        if memory is None:
            self.drawn_inputs[:] = np.nan
            self.drawn_choices[:] = -1

    def laid_over(self, memory: NDArray[np.uint8]) -> "Results":
        """The results that a copy of `memory` keeps."""
        return Results(self._n, self._widths, memory)


def zeros(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """An array that begins with a cache line, as those of a batch in C do (cgen/runtime/model.h)."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.zeros(size + CACHE_LINE, np.uint8)
    first = -memory.__array_interface__["data"][0] % CACHE_LINE
    return memory[first : first + size].view(dtype).reshape(shape)


def _parts(memory: NDArray[np.uint8]) -> Callable[[Any, int, int], NDArray[Any]]:
    """Takes arrays (rows, columns) of a type from the memory, one after the other."""
    start = 0

    def take(dtype: Any, rows: int, columns: int) -> NDArray[Any]:
        nonlocal start
        first, start = start, start + np.dtype(dtype).itemsize * rows * columns
        return memory[first:start].view(dtype).reshape(rows, columns)

    return take
