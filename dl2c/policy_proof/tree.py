"""Trees of boxes, level after level: along what each box is split at its middle, or what decided it.

The tree of a proof covers the box of its question. That of a search which ended before has boxes that are
open: those that cannot be split, and those below its last level.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from math import inf, nextafter
from typing import TypeAlias

import numpy as np

from dl2c.native.boxes import Bytes, Doubles
from dl2c.policy_proof.question import Question

BY_SOLVER, LEFT_OPEN = 250, 251
BY_BOUNDS, NO_STATE = 252, 253
"""What decided a box that is not split; dimensions are smaller numbers."""

MOST_BOXES = 2_000_000
"""Of one level."""

Slice: TypeAlias = Mapping[int, float]
"""Values of some dimensions, inside the box of the question."""


def check_levels(question: Question, tree: Sequence[bytes]) -> None:
    """Whether levels fit each other and the question. Raises `ValueError`."""
    size = 1
    for level in tree:
        codes = np.frombuffer(level, np.uint8)
        if len(codes) != size or size > MOST_BOXES:
            raise ValueError("a level of the tree has not as many boxes as were split before")
        split = codes[codes < BY_SOLVER]
        if (split >= len(question.dimensions)).any() or (codes > NO_STATE).any():
            raise ValueError("a box of the tree is neither split nor decided")
        size = 2 * len(split)


def leaves(
    question: Question, tree: Sequence[bytes], through: Slice | None = None
) -> Iterator[tuple[Doubles, Bytes]]:
    """The leaves, level after level: boxes (n, dimensions, 2), low and high, and what decided each (n).
    Together they are the whole box. With `through` only those that this slice meets: of two that share a
    face in it the upper one. The tree is one that `check_levels` lets pass.
    """
    ends = [(_below(low), -_below(-high)) for low, high in question.box]
    boxes = np.array(ends, np.float64).reshape(1, len(ends), 2)
    places, highest = np.zeros(1, np.intp), boxes[0, :, 1]
    for level in tree:
        every = np.frombuffer(level, np.uint8)
        codes = every[places]
        split = codes < BY_SOLVER
        yield boxes[~split], codes[~split]
        order = np.cumsum(every < BY_SOLVER) - 1
        places = (2 * order[places[split]][:, None] + (0, 1)).reshape(-1)
        boxes = _halves(boxes[split], codes[split])
        for dimension, value in (through or {}).items():
            low, high = boxes[:, dimension].T
            met = (low <= value) & ((value < high) | (high == highest[dimension]))
            boxes, places = boxes[met], places[met]
    if len(boxes):
        yield boxes, np.full(len(boxes), LEFT_OPEN, np.uint8)


def _below(value: Fraction) -> float:
    """The nearest double that is not above."""
    nearest = float(value)
    return nearest if Fraction(nearest) <= value else nextafter(nearest, -inf)


def _halves(boxes: Doubles, along: Bytes) -> Doubles:
    """Both halves of each box, one after the other."""
    both = np.repeat(boxes, 2, axis=0)
    rows, dimensions = np.arange(len(both)), np.repeat(along, 2)
    low, high = both[rows, dimensions].T
    middle = low + 0.5 * (high - low)
    both[rows[::2], dimensions[::2], 1] = middle[::2]
    both[rows[1::2], dimensions[1::2], 0] = middle[1::2]
    return both


def splits(question: Question, tree: Sequence[bytes]) -> list[int]:
    """How often boxes are split along each dimension."""
    codes = np.frombuffer(b"".join(tree), np.uint8)
    return np.bincount(codes[codes < BY_SOLVER], minlength=len(question.dimensions)).tolist()
