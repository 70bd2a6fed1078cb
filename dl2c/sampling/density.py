"""How large the density of the initial states is at most, box by box.

A measure comes in; what bounds its density on boxes goes out, by Hadamard's inequality for the rows of
slopes, and for the columns of all changes with each drawn name.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from dl2c.interval.arithmetic import INF, Box, Interval, enclosure, magnitude
from dl2c.interval.nodes import Graph, Node
from dl2c.interval.rounding import add_up, div_up, mul_down, mul_up
from dl2c.ir.logic import symbols
from dl2c.ir.model import Symbol
from dl2c.sampling.equalities.measure import Entries, Entry, Measure, at

Slope: TypeAlias = tuple[float, tuple[Node, ...]]
"""A factor, and terms of which each bounds what it multiplies."""

Share: TypeAlias = tuple[Symbol, Symbol, float]
"""Two names of a row, and how much the product of their slopes counts."""


@dataclass(frozen=True, slots=True)
class DensityBound:
    """Bounds of a density, for many boxes that differ little."""

    measure: Measure
    graph: Graph
    rows: tuple[Mapping[Symbol, tuple[Slope, ...]], ...]
    widths: tuple[tuple[Node, ...], ...]
    shares: tuple[tuple[Share, ...], ...]
    known: dict[tuple[Interval, ...], float] = field(default_factory=dict[tuple[Interval, ...], float])

    def squared(self, box: Box) -> float:
        """An upper bound of `Measure.squared` on a box of all names; may be infinite."""
        part = tuple(box[s] for s in self.graph.symbols)
        if part not in self.known:
            self.known[part] = self._squared(box)
        return self.known[part]

    def _squared(self, box: Box) -> float:
        self.graph.assign(box)
        sizes = [{z: _size(slopes) for z, slopes in row.items()} for row in self.rows]
        result = min(_by_rows(sizes, self.shares), _by_columns(self.measure, sizes)) if sizes else 1.0
        for widths in self.widths:
            longest = max(min(w.value().high for w in widths), 0.0)
            result = mul_up(result, mul_up(longest, longest))
        return result if not math.isnan(result) else INF

    def density(self, box: Box) -> float:
        """An upper bound of the density itself."""
        return self.measure.scale * math.sqrt(self.squared(box))

    def steep(self, box: Box) -> set[Symbol]:
        """The names on which slopes without a bound on the box depend."""
        self.graph.assign(box)
        slopes = [s for row in self.rows for several in row.values() for s in several]
        return {n for s in slopes if not math.isfinite(_size([s])) for n in symbols(s[1][0].term)}


def density_bound(measure: Measure) -> DensityBound:
    """To bound the density of a measure."""
    graph = Graph()
    rows = tuple(
        {z: tuple(_slope(e, graph) for e in entries) for z, entries in row.items()} for row in measure.rows
    )
    widths = tuple(tuple(map(graph.node, several)) for several in measure.widths)
    return DensityBound(measure, graph, rows, widths, tuple(_shares(row, measure) for row in measure.rows))


def _shares(row: Entries, measure: Measure) -> tuple[Share, ...]:
    pairs = ((a, b, abs(at(measure.inverse, a, b))) for a in row for b in row)
    return tuple((a, b, enclosure(share).high) for a, b, share in pairs if share)


def _slope(entry: Entry, graph: Graph) -> Slope:
    terms = [t for t in (entry.term, entry.limit) if t is not None]
    return enclosure(abs(entry.scale)).high, tuple(graph.node(t) for t in terms)


def _size(slopes: Sequence[Slope]) -> float:
    """The largest size of a sum of slopes."""
    around = 0.0
    for scale, terms in slopes:
        around = add_up(around, mul_up(scale, min(_largest(t.value()) for t in terms)))
    return around


def _largest(around: Interval) -> float:
    return INF if around.empty else magnitude(around).high


def _by_rows(sizes: Sequence[Mapping[Symbol, float]], shares: Sequence[Sequence[Share]]) -> float:
    result = 1.0
    for row, pairs in zip(sizes, shares, strict=True):
        plain, refined = 0.0, 0.0
        for size in row.values():
            plain = add_up(plain, mul_up(size, size))
        for a, b, share in pairs:
            refined = add_up(refined, mul_up(share, mul_up(row[a], row[b])))
        result = mul_up(result, min(plain, refined))
    return result if not math.isnan(result) else INF


def _by_columns(measure: Measure, sizes: Sequence[Mapping[Symbol, float]]) -> float:
    """The bound by the lengths of the columns: the changes of all names with each drawn one."""
    whole: dict[Symbol, dict[Symbol, float]] = {}
    for row in sizes:
        own = next(iter(row))
        whole[own] = _changes({z: size for z, size in row.items() if z != own}, whole)
    affine = [_changes({z: enclosure(abs(c)).high for z, c in a.items()}, whole) for a in measure.affine]
    columns: dict[Symbol, float] = {}
    for changes in (*whole.values(), *affine):
        for drawn, size in changes.items():
            columns[drawn] = add_up(columns.get(drawn, 1.0), mul_up(size, size))
    result = 1.0
    for column in columns.values():
        result = mul_up(result, column)
    scale = mul_down(measure.scale, measure.scale) * (1 - 1e-12)
    return div_up(result, scale) if not math.isnan(result) else INF


def _changes(
    sizes: Mapping[Symbol, float], whole: Mapping[Symbol, Mapping[Symbol, float]]
) -> dict[Symbol, float]:
    """By drawn names, of what changes by these factors with drawn names and those of `whole`."""
    changes: dict[Symbol, float] = {}
    for z, factor in sizes.items():
        for drawn, size in whole.get(z, {z: 1.0}).items():
            changes[drawn] = add_up(changes.get(drawn, 0.0), mul_up(factor, size))
    return changes
