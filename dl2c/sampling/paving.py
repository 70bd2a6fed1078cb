"""Cover the initial states with boxes, so that few draws are rejected.

A formula and a box come in; disjoint boxes go out that together hold every point of
the box satisfying the formula. Regions are dropped only where interval arithmetic
proves that nothing satisfies it, so drawing from the boxes by volume and rejecting
stays exactly uniform. Best first: the box that wastes most volume is halved, along the
direction that leaves least volume after contraction.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from dl2c.interval.arithmetic import Box, Interval
from dl2c.interval.contract import contract
from dl2c.ir.logic import atoms, operands, symbols
from dl2c.ir.model import Formula, Symbol, Term

ENOUGH = 0.95
"""An acceptance that more boxes need not improve."""

ROUNDS = 2
"""Contraction rounds of a half: its parent was contracted before."""

NODES_PER_SECOND = 100_000
"""Assumed speed of contraction, so that a time limit means the same work on every machine."""

Estimate = Callable[[Box], float]
"""The part of a box that satisfies the formula, between 0 and 1."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """A box, its volume relative to the whole, and how much of it is estimated to be accepted."""

    box: Mapping[Symbol, Interval]
    volume: float
    accepted: float

    @property
    def waste(self) -> float:
        return self.volume * (1 - self.accepted)


def pave(
    formula: Formula,
    box: Box,
    free: Sequence[Symbol],
    estimate: Estimate,
    *,
    boxes: int,
    time_limit_s: float,
) -> tuple[Leaf, ...]:
    """At most `boxes` boxes that split `box` along `free`, which has finite limits there."""
    wide = [s for s in free if box[s].low < box[s].high]
    scale = {s: box[s].high - box[s].low for s in wide}
    relevant = [s for s in wide if s in symbols(formula)]
    leaves = [Leaf(box, 1.0, estimate(box))]
    final: list[Leaf] = []
    splits = _affordable_splits(formula, len(relevant), time_limit_s)
    while leaves and splits > 0 and len(leaves) + len(final) < boxes:
        if _acceptance(leaves + final) >= ENOUGH:
            break
        worst = max(leaves, key=lambda leaf: leaf.waste)
        leaves.remove(worst)
        halves = _best_split(formula, worst, relevant, scale)
        splits -= 1
        if halves is None:
            final.append(worst)
        else:
            leaves += [Leaf(half, volume, estimate(half)) for half, volume in halves]
    return tuple(leaves + final)


def _acceptance(leaves: Sequence[Leaf]) -> float:
    total = math.fsum(leaf.volume for leaf in leaves)
    return math.fsum(leaf.volume * leaf.accepted for leaf in leaves) / total if total > 0 else 0.0


def _affordable_splits(formula: Formula, directions: int, time_limit_s: float) -> int:
    nodes = sum(_size(a.left) + _size(a.right) for a in atoms(formula))
    return int(time_limit_s * NODES_PER_SECOND / (2 * ROUNDS * nodes * directions + 1))


def _size(term: Term) -> int:
    return 1 + sum(_size(t) for t in operands(term))


Halves = list[tuple[dict[Symbol, Interval], float]]


def _best_split(
    formula: Formula, leaf: Leaf, directions: Sequence[Symbol], scale: Mapping[Symbol, float]
) -> Halves | None:
    """The contracted halves with the least volume; among equals, those of the relatively longest edge."""
    best: tuple[float, Halves] | None = None
    for symbol in directions:
        edge = leaf.box[symbol]
        middle = edge.low + (edge.high - edge.low) / 2
        if not edge.low < middle < edge.high:
            continue
        parts = (Interval(edge.low, middle), Interval(middle, edge.high))
        halves = [_contracted(formula, {**leaf.box, symbol: part}, scale) for part in parts]
        kept = [h for h in halves if h is not None and h[1] > 0]
        left = math.fsum(volume for _, volume in kept) / leaf.volume
        score = left - 1e-3 * (edge.high - edge.low) / scale[symbol]
        if best is None or score < best[0]:
            best = score, kept
    return None if best is None else best[1]


def _contracted(
    formula: Formula, box: Box, scale: Mapping[Symbol, float]
) -> tuple[dict[Symbol, Interval], float] | None:
    kept = contract(formula, box, ROUNDS)
    if kept is None:
        return None
    return kept, math.prod((kept[s].high - kept[s].low) / width for s, width in scale.items())
