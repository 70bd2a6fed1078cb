"""Where the parts of a scene stand in its picture, and which numbers its axes show.

In: a scene of a manifest, and the values of its shapes where an episode begins. Out: panels with scales
from numbers to pixels. Knows nothing of drawing.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from dl2c.native.manifest import AxisSpec, SceneSpec, ShapeSpec

WIDTH, HEIGHT, FLAT = 640, 520, 280
"""Of a picture in pixels; its height is `FLAT` where all that it shows is on a line."""

HEADER, FOOTER, MARGIN = 72, 48, 14
LEFT, BELOW = 44, 34
"""What axes take: numbers to the left of one that goes up, and below one that goes right."""

FAR = 8000
"""Pixels beyond which nothing is drawn."""

ENDLESS, NARROW = 1e100, 1e-6
"""Numbers that are drawn are below this, and a picture is at least so wide, in parts of them."""

PADDING = 0.04
"""Of the extent of an axis, so that nothing ends at the edge."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Numbers from `low` to `high` along an axis: `low` is at pixel `start`, the next unit `step` further."""

    low: float
    high: float
    start: float
    step: float

    def at(self, value: float) -> int:
        """The pixel of a number."""
        return round(min(max(self.start + (value - self.low) * self.step, -FAR), FAR))

    def long(self, length: float) -> int:
        """A length in pixels, at least one."""
        return max(1, round(min(abs(length * self.step), FAR)))

    def ticks(self) -> Iterator[tuple[int, str]]:
        """Pixels of round numbers, and the numbers."""
        span = self.high - self.low
        size = 10.0 ** math.floor(math.log10(span / 4))
        size *= next(f for f in (1, 2, 5, 10) if span / (size * f) <= 8)
        for k in range(math.ceil(self.low / size), math.floor(self.high / size) + 1):
            yield self.at(k * size), f"{k * size:.10g}"


@dataclass(frozen=True, slots=True)
class Panel:
    """A part of a picture: its rectangle in pixels, and scales for the axes that it has."""

    left: int
    top: int
    width: int
    height: int
    scales: Mapping[str, Scale]

    @property
    def middle(self) -> tuple[int, int]:
        """Its middle pixel."""
        return self.left + self.width // 2, self.top + self.height // 2


def size_of(scene: SceneSpec) -> tuple[int, int]:
    """Width and height of a picture."""
    flat = {s.panel for s in scene.shapes} <= {"line", "text"}
    return WIDTH, FLAT if flat else HEIGHT


def arranged(scene: SceneSpec, values: Sequence[float]) -> dict[str, Panel]:
    """The panels of a picture by name; `values` are those where an episode begins."""
    limits = {name: _limits(axis, _seen(scene, name, values)) for name, axis in scene.axes.items()}
    kinds = dict.fromkeys(s.panel for s in scene.shapes if s.panel != "text")
    width, height = size_of(scene)
    left, top, bottom = MARGIN, HEADER, height - FOOTER
    found: dict[str, Panel] = {}
    above = [k for k in ("plane", "level", "dial") if k in kinds]
    if "line" in kinds:
        line = FLAT - HEADER - FOOTER
        found["line"] = _line(limits["line"], left, bottom - line, width - 2 * left, line)
        bottom -= line
    for k, kind in enumerate(above):
        share = (width - 2 * MARGIN) // len(above)
        frame = left + k * share, top, share, bottom - top
        match kind:
            case "plane":
                found[kind] = _plane(limits["x"], limits["y"], *frame)
            case "level":
                found[kind] = _level(limits["level"], *frame)
            case _:
                found[kind] = Panel(*frame, {})
    return found


def _plane(
    x: tuple[float, float], y: tuple[float, float], left: int, top: int, width: int, height: int
) -> Panel:
    """Both axes have the same scale, and all of the rectangle that leaves is used."""
    wide, high = width - LEFT, height - BELOW
    step = min(wide / (x[1] - x[0]), high / (y[1] - y[0]))
    across, up = round((x[1] - x[0]) * step), round((y[1] - y[0]) * step)
    begin, end = left + LEFT + (wide - across) // 2, top + (high - up) // 2
    scales = {"x": Scale(*x, begin, step), "y": Scale(*y, end + up, -step)}
    return Panel(begin, end, across, up, scales)


def _line(limits: tuple[float, float], left: int, top: int, width: int, height: int) -> Panel:
    scale = Scale(*limits, left, width / (limits[1] - limits[0]))
    return Panel(left, top, width, height - BELOW, {"line": scale})


def _level(limits: tuple[float, float], left: int, top: int, width: int, height: int) -> Panel:
    across, up = min(200, width // 3), height - BELOW
    scale = Scale(*limits, top + up, -up / (limits[1] - limits[0]))
    return Panel(left + (width - across) // 2, top, across, up, {"level": scale})


# Limits -------------------------------------------------------------------------


def _limits(axis: AxisSpec, seen: Sequence[float]) -> tuple[float, float]:
    """The limits of an axis, with some padding; where the model has none, around what is `seen`."""
    near = [end for end in seen if abs(end) < ENDLESS] or [0.0]
    least, most = min(near), max(near)
    around = max(0.5 * (most - least), 0.5, NARROW * max(abs(least), abs(most)))
    low = axis.low if abs(axis.low) < ENDLESS else min(least, axis.high) - around
    high = axis.high if abs(axis.high) < ENDLESS else max(most, low) + around
    padding = max(PADDING * (high - low), NARROW * max(abs(low), abs(high))) or 1.0
    return low - padding, high + padding


def _seen(scene: SceneSpec, axis: str, values: Sequence[float]) -> list[float]:
    """How far shapes reach along an axis in one state."""
    ends = [end for shape in scene.shapes for end in _ends(shape, axis, values)]
    return [end for end in ends if math.isfinite(end)]


def _ends(shape: ShapeSpec, axis: str, values: Sequence[float]) -> Iterator[float]:
    given = {name: [values[k] for k in places] for name, places in shape.arguments.items()}
    if shape.panel != {"x": "plane", "y": "plane"}.get(axis, axis):
        return
    if shape.kind == "polygon":
        yield from given["points"]["xy".index(axis) :: 2]
        return
    match axis:
        case "line":
            (x,) = given["x"]
            yield from (x, x + given.get("length", [0.0])[0])
        case "level":
            yield from (v for name in ("value", "low", "high") for v in given.get(name, ()))
        case _:
            sizes = ("radius", "length") if shape.kind != "box" else ("width", "height")
            reach = max((abs(given[name][0]) for name in sizes if name in given), default=0.0)
            for name in (axis, f"{axis}2"):
                yield from (v + side * reach for v in given.get(name, ()) for side in (-1, 1))
