"""The shapes of a scene on a surface of pygame's (untyped: its own)."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dl2c.native.manifest import ShapeSpec
from dl2c.picture.layout import Panel
from dl2c.picture.panels import BLUE, GREEN, VERMILION

INK, FAINT, PAPER, ROAD = (40, 40, 40), (205, 205, 205), (255, 255, 255), (236, 236, 236)

Colour = tuple[int, int, int]
Place = tuple[int, int]


def _colour(code: str) -> Colour:
    return int(code[1:3], 16), int(code[3:5], 16), int(code[5:7], 16)


COLOURS: Mapping[str, Colour] = {
    "agent": _colour(BLUE),
    "unsafe": _colour(VERMILION),
    "goal": _colour(GREEN),
    "world": (120, 120, 120),
}
"""Of roles: colours that people tell apart whatever their colour vision."""

FILLS: Mapping[str, int] = {"agent": 255, "unsafe": 165, "goal": 90, "world": 30}
"""How opaque areas are, of 255."""

MARK = 7
"""Radius of a point in pixels."""

CAR, WALL = 30, 56
"""Heights in pixels on a line: of what moves there, and of what blocks it."""

ROW = 17
"""From one row of labels to the next."""

VEIL = 150
"""How opaque the paper behind names is, of 255."""

LARGE = 40
"""Radius in pixels of a disk that may have names on it."""

TURNS = 24
"""Corners of a sector's arc."""


class Painter:
    """Draws shapes; what it writes is written once and kept."""

    def __init__(self, panels: Mapping[str, Panel], write: Callable[[str, Colour], Any]) -> None:
        """`write` gives a surface with a text."""
        import pygame
        from pygame import gfxdraw

        self._pygame: Any = pygame
        self._gfx: Any = gfxdraw
        self._panels, self._write = panels, write
        self._labels: list[tuple[str, Colour, Place]] = []
        self._kept: list[Any] = []
        """Rectangles that names keep away from."""
        self._rows = 0

    def draw(self, surface: Any, shapes: Sequence[ShapeSpec], values: Sequence[float]) -> None:
        """All shapes in their order, above them their names. What has no finite value is left out."""
        self._labels, self._kept, self._rows = [], [], 0
        for shape in shapes:
            given = {name: [values[k] for k in places] for name, places in shape.arguments.items()}
            if shape.panel != "text" and all(math.isfinite(v) for part in given.values() for v in part):
                panel = self._panels[shape.panel]
                if shape.panel != "line":
                    surface.set_clip(panel.left - MARK, panel.top, panel.width + 2 * MARK, panel.height)
                getattr(self, f"_{shape.kind}")(surface, shape, panel, given)
                surface.set_clip(None)
        self._put_labels(surface)

    def _put_labels(self, surface: Any) -> None:
        """Write names, none on another one and all inside the picture."""
        taken = list(self._kept)
        for text, colour, place in self._labels:
            written = self._write(text, colour)
            wanted = written.get_rect(center=place).clamp(surface.get_rect())
            moved = (wanted.move(0, ROW * rows).clamp(surface.get_rect()) for rows in (0, 1, 2, 3, -1, -2))
            where = next((r for r in moved if r.collidelist(taken) < 0), wanted)
            taken.append(where)
            self._gfx.box(surface, where, (*PAPER, VEIL))
            surface.blit(written, where)

    def place(self, shape: ShapeSpec, values: Sequence[float]) -> Place | None:
        """Where a shape is in a plane, None for one that is nowhere in it."""
        if shape.panel != "plane" or "x" not in shape.arguments:
            return None
        x, y = (values[shape.arguments[name][0]] for name in "xy")
        if not (math.isfinite(x) and math.isfinite(y)):
            return None
        scales = self._panels["plane"].scales
        return scales["x"].at(x), scales["y"].at(y)

    # Parts of shapes --------------------------------------------------------------

    def _area(self, surface: Any, role: str, corners: Sequence[Place]) -> None:
        colour = COLOURS[role]
        self._gfx.filled_polygon(surface, corners, (*colour, FILLS[role]))
        self._gfx.aapolygon(surface, corners, colour)

    def _label(self, shape: ShapeSpec, x: int, y: int) -> None:
        red, green, blue = COLOURS[shape.role]
        if shape.name:
            self._labels.append((shape.name, (red * 3 // 4, green * 3 // 4, blue * 3 // 4), (x, y)))

    def _arrow(self, surface: Any, colour: Colour, start: Place, end: Place, head: int = 8) -> None:
        """A line with a head at its end."""
        draw = self._pygame.draw
        draw.line(surface, colour, start, end, 3)
        angle = math.atan2(end[1] - start[1], end[0] - start[0])
        wings = [
            (end[0] - head * math.cos(angle + t), end[1] - head * math.sin(angle + t)) for t in (-0.5, 0.5)
        ]
        draw.polygon(surface, colour, [end, *wings])

    @staticmethod
    def _direction(given: Mapping[str, Sequence[float]]) -> tuple[float, float] | None:
        """The unit vector of a heading in pixels, None where there is none."""
        dx, dy = given.get("heading", (0.0, 0.0))
        size = math.hypot(dx, dy)
        return None if not 0.0 < size < math.inf else (dx / size, -dy / size)

    @staticmethod
    def _middle(panel: Panel, given: Mapping[str, Sequence[float]]) -> Place:
        return panel.scales["x"].at(given["x"][0]), panel.scales["y"].at(given["y"][0])

    # In a plane -------------------------------------------------------------------

    def _round(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]], radius: int
    ) -> None:
        x, y = self._middle(panel, given)
        colour = COLOURS[shape.role]
        self._gfx.filled_circle(surface, x, y, radius, (*colour, FILLS[shape.role]))
        self._gfx.aacircle(surface, x, y, radius, colour)
        if direction := self._direction(given):
            reach = radius + 10
            tip = round(x + reach * direction[0]), round(y + reach * direction[1])
            self._arrow(surface, INK, (x, y), tip)
        if radius < LARGE:
            self._kept.append(self._pygame.Rect(x - radius, y - radius, 2 * radius, 2 * radius))
        self._label(shape, x, y - radius - 11)

    def _disk(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        self._round(surface, shape, panel, given, panel.scales["x"].long(given["radius"][0]))

    def _point(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        self._round(surface, shape, panel, given, MARK)

    def _box(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        (x,), (y,), (width,), (height,) = (given[n] for n in ("x", "y", "width", "height"))
        dx, dy = self._direction(given) or (1.0, 0.0)
        along, across = (dx * width / 2, -dy * width / 2), (dy * height / 2, dx * height / 2)
        to_x, to_y = panel.scales["x"].at, panel.scales["y"].at
        corners = [
            (to_x(x + a * along[0] + b * across[0]), to_y(y + a * along[1] + b * across[1]))
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        self._area(surface, shape.role, corners)
        if "heading" in given:
            tip = to_x(x + 1.5 * along[0]), to_y(y + 1.5 * along[1])
            self._arrow(surface, INK, self._middle(panel, given), tip)
        top = min(corner[1] for corner in corners)
        low = max(corner[1] for corner in corners)
        inside = low - top > 3 * ROW
        self._label(shape, self._middle(panel, given)[0], top + ROW // 2 + 2 if inside else top - 9)

    def _segment(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        ends = [
            (panel.scales["x"].at(given[x][0]), panel.scales["y"].at(given[y][0]))
            for x, y in (("x", "y"), ("x2", "y2"))
        ]
        self._pygame.draw.line(surface, COLOURS[shape.role], *ends, 5 if shape.role == "agent" else 3)
        (x, y), (x2, y2) = ends
        self._label(shape, (x + x2) // 2, (y + y2) // 2 - 10)

    def _polygon(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        points = given["points"]
        corners = [
            (panel.scales["x"].at(x), panel.scales["y"].at(y))
            for x, y in zip(points[0::2], points[1::2], strict=True)
        ]
        self._area(surface, shape.role, corners)
        x, y = (sum(part) // len(corners) for part in zip(*corners, strict=True))
        self._label(shape, x, y)

    def _ray(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        direction, (x, y) = self._direction(given), self._middle(panel, given)
        if direction is None:
            return
        colour = COLOURS[shape.role]
        reach = panel.scales["x"].long(given["length"][0]) if "length" in given else 2000
        end = round(x + reach * direction[0]), round(y + reach * direction[1])
        if "length" in given:
            self._arrow(surface, colour, (x, y), end)
        else:
            self._pygame.draw.line(surface, colour, (x, y), end, 2)
        self._label(shape, (x + min(reach, 60) * direction[0]).__round__(), y - 10)

    # On a line --------------------------------------------------------------------

    def _on_line(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        scale, colour = panel.scales["line"], COLOURS[shape.role]
        x, length = given["x"][0], given.get("length", [0.0])[0]
        left, right = sorted((scale.at(x), scale.at(x + length)))
        draw, rect = self._pygame.draw, self._pygame.Rect
        y = road_of(panel)
        ground = y + WALL // 2
        if "length" in given and shape.role == "goal":
            top = ground - WALL
            area = rect(left, top, max(right - left, 4), WALL)
            self._gfx.box(surface, area, (*colour, FILLS[shape.role]))
            draw.rect(surface, colour, area, 1)
        elif "length" in given:
            width = max(right - left, 8)
            height = min(max(width // 2, 14), CAR)
            top = y - height // 2
            draw.rect(surface, colour, rect(left, top, width, height), border_radius=4)
        else:
            top = y - CAR
            draw.line(surface, colour, (left, ground), (left, top), 4)
            if shape.role == "agent":
                draw.circle(surface, colour, (left, y), MARK + 2)
            elif shape.role != "unsafe":
                draw.polygon(surface, colour, [(left, top), (left + 18, top + 7), (left, top + 14)])
        if shape.name:
            middle, row = (left + right) // 2, panel.top + 9 + self._rows * ROW
            self._rows += 1
            draw.line(surface, FAINT, (middle, row + 8), (middle, top - 1))
            self._label(shape, middle, row)

    # Levels and angles --------------------------------------------------------------

    def _level(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        scale, colour, draw = panel.scales["level"], COLOURS[shape.role], self._pygame.draw
        at, left, width = scale.at(given["value"][0]), panel.left, panel.width
        if "low" in given:
            top, bottom = sorted((at, scale.at(given["low"][0])))
            area = self._pygame.Rect(left, top, width, max(bottom - top, 1))
            self._gfx.box(surface, area, (*colour, min(FILLS[shape.role], 120)))
            draw.line(surface, colour, (left, at), (left + width, at), 3)
            if "high" in given:
                rim = scale.at(given["high"][0])
                walls = [(left, rim), (left, bottom), (left + width, bottom), (left + width, rim)]
                draw.lines(surface, INK, False, walls, 4)
        else:
            draw.line(surface, colour, (left - 8, at), (left + width + 8, at), 3)
        if shape.name:
            written = self._write(shape.name, colour)
            self._label(shape, left + width + 18 + written.get_width() // 2, at)

    def _pointer(
        self, surface: Any, shape: ShapeSpec, panel: Panel, given: Mapping[str, Sequence[float]]
    ) -> None:
        (x, y), angle, colour = panel.middle, given["angle"][0], COLOURS[shape.role]
        radius = dial_of(panel)

        def on(turned: float, reach: float) -> Place:
            return round(x + reach * math.cos(turned)), round(y - reach * math.sin(turned))

        if "spread" in given:
            half = min(abs(given["spread"][0]), math.pi)
            arc = [on(angle + half * (2 * k / TURNS - 1), radius) for k in range(TURNS + 1)]
            self._area(surface, shape.role, [(x, y), *arc])
        else:
            self._pygame.draw.line(surface, colour, (x, y), on(angle, radius - 8), 7)
            self._pygame.draw.circle(surface, colour, (x, y), 9)
        self._label(shape, *on(angle, radius + 16))


def road_of(panel: Panel) -> int:
    """The pixel of the middle of a road."""
    return panel.top + panel.height - WALL // 2 - 4


def dial_of(panel: Panel) -> int:
    """The radius of a dial in pixels."""
    return min(panel.width, panel.height) // 2 - 30
