"""Cover the initial states with boxes, so that few draws are rejected.

Charts of the initial states come in, each a formula over a box and a density; disjoint boxes of each
chart go out that together hold every point satisfying the formula. Regions are dropped only where
interval arithmetic proves that nothing satisfies it, so drawing from the boxes by volume times the
largest density and rejecting stays exactly uniform. Best first: the box that wastes most is halved,
along the direction that leaves least after contraction.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from dl2c.interval.arithmetic import Box, Interval
from dl2c.interval.contract import Contractor
from dl2c.ir.logic import size, symbols
from dl2c.ir.model import Formula, Symbol
from dl2c.work import spend

ENOUGH = 0.95
"""At this acceptance no more boxes are made."""

CANDIDATES = 12
"""Directions in which a box is tried to be halved: those of its relatively longest edges."""

MORE = 4
"""There may be this many times more boxes as long as the density is unbounded on one of them."""

ROUNDS = 2
"""Contraction rounds of a half: its parent was contracted before."""

NODES_PER_SECOND = 120_000
"""Assumed speed of contraction, so that a time limit means the same work on every machine."""

Widths: TypeAlias = Mapping[Symbol, float]
"""The unit of each name, by which volumes of different charts become comparable."""


@dataclass(frozen=True, slots=True)
class Root:
    """One chart. `wide` are its free names with more than one value. `density` bounds the density of the
    states on a box from above; `estimate` says how much of a box is accepted, between 0 and 1, by points of
    this law. `bent` names influence the density; those that leave it without a bound on a box are `steep`
    there."""

    formula: Formula
    contractor: Contractor
    box: Mapping[Symbol, Interval]
    wide: tuple[Symbol, ...]
    bent: frozenset[Symbol]
    steep: Callable[[Box], set[Symbol]]
    density: Callable[[Box], float]
    estimate: Callable[[Box, float], float]


@dataclass(frozen=True, slots=True)
class Leaf:
    """A box of a chart, its share of all draws before division by their sum (`mass`: volume times largest
    density), that density, and how much of it is estimated to be accepted."""

    chart: int
    box: Mapping[Symbol, Interval]
    mass: float
    density: float
    accepted: float

    @property
    def waste(self) -> float:
        return self.mass * (1 - self.accepted)


def pave(roots: Sequence[Root], *, boxes: int, time_limit_s: float) -> tuple[Leaf, ...]:
    """At most `boxes` boxes, or one per chart, that split the charts along their free names."""
    widths = _widths(roots)
    leaves = [_leaf(roots, k, r.box, widths) for k, r in enumerate(roots)]
    final: list[Leaf] = []
    directions = [_directions(root) for root in roots]
    nodes = max(
        (size(r.formula) * min(len(d), CANDIDATES) for r, d in zip(roots, directions, strict=True)), default=1
    )
    splits = int(time_limit_s * NODES_PER_SECOND / (2 * ROUNDS * nodes + 1))
    while leaves and splits > 0:
        spend()
        worst = max(leaves, key=lambda leaf: leaf.waste)
        endless = not math.isfinite(worst.density)
        if len(leaves) + len(final) >= (boxes * MORE if endless else boxes):
            break
        if acceptance_of(leaves + final) >= ENOUGH:
            break
        leaves.remove(worst)
        root, wide = roots[worst.chart], directions[worst.chart]
        if endless and (steep := root.steep(worst.box)):
            wide = [s for s in wide if s in steep] or wide
        wide = sorted(wide, key=lambda s: -_edge(worst.box, s, widths))[:CANDIDATES]
        halves = _best_split(root, worst, wide, widths)
        splits -= 1
        if halves is None:
            final.append(worst)
        else:
            leaves += [_leaf(roots, worst.chart, half, widths) for half in halves]
    return tuple(leaf for leaf in leaves + final if leaf.mass > 0)


def acceptance_of(leaves: Sequence[Leaf]) -> float:
    """The part of all draws that is accepted."""
    total = math.fsum(leaf.mass for leaf in leaves)
    if not math.isfinite(total) or total <= 0:
        return 0.0
    return math.fsum(leaf.mass * leaf.accepted for leaf in leaves) / total


def _widths(roots: Sequence[Root]) -> dict[Symbol, float]:
    widths: dict[Symbol, float] = {}
    for root in roots:
        for symbol in root.wide:
            width = root.box[symbol].high - root.box[symbol].low
            widths[symbol] = max(width, widths.get(symbol, 0.0))
    return widths


def _leaf(roots: Sequence[Root], chart: int, box: Mapping[Symbol, Interval], widths: Widths) -> Leaf:
    root = roots[chart]
    density = root.density(box)
    mass = _volume(root, box, widths) * density * _unit(roots, root, widths)
    return Leaf(chart, box, mass, density, root.estimate(box, density))


def _volume(root: Root, box: Box, widths: Widths) -> float:
    """In units of the widths."""
    return math.prod([_edge(box, s, widths) for s in root.wide])


def _unit(roots: Sequence[Root], root: Root, widths: Widths) -> float:
    """How large the unit volume of a chart is, compared with that of the first one."""
    sizes = [math.fsum(math.log(widths[s]) for s in r.wide) for r in (root, roots[0])]
    return math.exp(sizes[0] - sizes[1])


def _directions(root: Root) -> list[Symbol]:
    told = root.bent | symbols(root.formula)
    return [s for s in root.wide if s in told]


def _best_split(
    root: Root, leaf: Leaf, directions: Sequence[Symbol], widths: Widths
) -> list[dict[Symbol, Interval]] | None:
    """The contracted halves with the least mass; among equals, those of the relatively longest edge."""
    best: tuple[float, list[dict[Symbol, Interval]]] | None = None
    before = _volume(root, leaf.box, widths)
    for symbol in directions:
        parts = _halved(leaf.box[symbol])
        if not all(p.low < p.high for p in parts):
            continue
        halves = [root.contractor.contract({**leaf.box, symbol: part}, ROUNDS) for part in parts]
        kept = [h for h in halves if h is not None and _volume(root, h, widths) > 0]
        left = math.fsum(_volume(root, h, widths) * _relative(root, h, leaf, symbol) for h in kept) / before
        score = left - 1e-3 * _edge(leaf.box, symbol, widths)
        if best is None or score < best[0]:
            best = score, kept
    return None if best is None else best[1]


def _halved(edge: Interval) -> tuple[Interval, Interval]:
    middle = edge.low + (edge.high - edge.low) / 2
    return Interval(edge.low, middle), Interval(middle, edge.high)


def _edge(box: Box, symbol: Symbol, widths: Widths) -> float:
    return (box[symbol].high - box[symbol].low) / widths[symbol]


def _relative(root: Root, box: Box, leaf: Leaf, symbol: Symbol) -> float:
    """The largest density on a part of a leaf, relative to the leaf's: the mean of that of its halves, since
    it is mostly largest on both sides of zero."""
    if not root.bent or not math.isfinite(leaf.density):
        return 1.0
    parts = _halved(box[symbol])
    return math.fsum(root.density({**box, symbol: part}) for part in parts) / 2 / leaf.density
