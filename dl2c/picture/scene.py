"""A picture of a scene that is kept and brought up to date: what stays is drawn once. Needs pygame.

In: a library with a scene, its states, and a line of words about the episode. Out: pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.native.binding import Library
from dl2c.native.inspect import scene_values, violations
from dl2c.picture.layout import FOOTER, MARGIN, Panel, arranged, size_of
from dl2c.picture.shapes import (
    COLOURS,
    FAINT,
    INK,
    PAPER,
    ROAD,
    WALL,
    Colour,
    Painter,
    Place,
    dial_of,
    road_of,
)

SMALL, LARGE = 18, 24
"""Sizes of letters."""

WORDS = {"agent": "agent", "unsafe": "avoid", "goal": "reach"}
"""What the legend says before the names of a role."""

ENDED = {"success": COLOURS["goal"], "failure": COLOURS["unsafe"], "none": INK}

GRID = (64, 48)
"""Places of a plane at which @safety is judged, where that is shaded."""

MOST_WRITTEN = 500


@dataclass(frozen=True, slots=True)
class Status:
    """What is said below a picture: seconds and return so far, how the last step ended the episode, and
    whether its request had no run."""

    time: float = 0.0
    total: float = 0.0
    status: str = "none"
    reason: str = ""
    blocked: bool = False

    def then(self, reward: float, info: Mapping[str, Any]) -> "Status":
        """After one more step, of which `info` is Gymnasium's."""
        return Status(info["time"], self.total + reward, info["status"], info["reason"], info["blocked"])


class ScenePicture:
    """One picture of the scene of a library that was built to `inspect`."""

    def __init__(self, library: Library) -> None:
        import pygame

        pygame.font.init()
        self._pygame: Any = pygame
        self._library, self._scene = library, library.manifest.scene
        self.size = size_of(self._scene)
        self._screen: Any = pygame.Surface(self.size)
        self._fonts = {size: pygame.font.Font(None, size) for size in (SMALL, LARGE)}
        self._written: dict[tuple[str, Colour, int], Any] = {}
        self._values = np.empty(library.sizes.nscene)
        self._panels: dict[str, Panel] = {}
        self._background: Any = None
        self._canvas: Any = None
        self._shade: NDArray[np.bool_] | None = None
        self._ends: dict[int, Place] = {}
        self._way: list[tuple[Place, Place]] = []
        self.follows = any(s.role == "agent" and s.panel == "plane" for s in self._scene.shapes)
        """Whether the way of an agent is shown."""

    def begin(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> None:
        """An episode begins in state x (nx) with constants p (np)."""
        values = self._evaluated(x, p)
        panels = arranged(self._scene, values)
        if panels != self._panels:
            self._panels = panels
            self._background = self._drawn_background()
            self._painter = Painter(panels, self._label)
        self._canvas, self._shade = self._background.copy(), None
        self._ends, self._way = {}, []
        self._traced(values)

    def follow(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> None:
        """The agent went through this state: its way stays visible."""
        self._traced(self._evaluated(x, p))

    def draw(self, x: NDArray[np.float64], p: NDArray[np.float64], status: Status) -> Any:
        """The picture of a state, as a surface of pygame's that the next call changes."""
        values = self._evaluated(x, p)
        if self._scene.shaded:
            self._shaded(x, p)
        self._screen.blit(self._canvas, (0, 0))
        self._painter.draw(self._screen, self._scene.shapes, values)
        self._say(values, status)
        return self._screen

    def pixels(self) -> NDArray[np.uint8]:
        """What was drawn last (height, width, 3), in fresh memory."""
        width, height = self.size
        raw = bytearray(self._pygame.image.tobytes(self._screen, "RGB"))
        return np.frombuffer(raw, np.uint8).reshape(height, width, 3)

    def _evaluated(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> Sequence[float]:
        scene_values(self._library, x, p, self._values)
        return self._values.tolist()

    # What moves -------------------------------------------------------------------

    def _traced(self, values: Sequence[float]) -> None:
        """Go on with the way of each agent in the plane."""
        for k, shape in enumerate(self._scene.shapes):
            if shape.role != "agent" or (place := self._painter.place(shape, values)) is None:
                continue
            before = self._ends.get(k, place)
            if before != place:
                self._way.append((before, place))
                self._draw_way([(before, place)])
            self._ends[k] = place

    def _draw_way(self, lines: Sequence[tuple[Place, Place]]) -> None:
        panel = self._panels["plane"]
        self._canvas.set_clip(panel.left, panel.top, panel.width, panel.height)
        for line in lines:
            self._pygame.draw.aaline(self._canvas, COLOURS["agent"], *line)
        self._canvas.set_clip(None)

    def _shaded(self, x: NDArray[np.float64], p: NDArray[np.float64]) -> None:
        """Mark on the canvas where @safety fails, all else being as it is."""
        names = [q.name for q in self._library.manifest.variables]
        panel = self._panels["plane"]
        axes = [panel.scales[axis] for axis in "xy"]
        rows = (np.linspace(s.low, s.high, n) for s, n in zip(axes, GRID, strict=True))
        grid = np.meshgrid(*rows, indexing="ij")
        states = np.tile(x, (grid[0].size, 1))
        for name, column in zip(self._scene.shaded, grid, strict=True):
            states[:, names.index(name)] = column.ravel()
        shade = (violations(self._library, states, p) > 0).reshape(GRID)
        if self._shade is not None and np.array_equal(shade, self._shade):
            return
        self._shade = shade
        self._canvas = self._background.copy()
        pygame = self._pygame
        veil = pygame.Surface(GRID, pygame.SRCALPHA)
        veil.fill((*COLOURS["unsafe"], 0))
        pygame.surfarray.pixels_alpha(veil)[:] = np.where(shade[:, ::-1], 70, 0)
        wide = pygame.transform.smoothscale(veil, (panel.width, panel.height))
        self._canvas.blit(wide, (panel.left, panel.top))
        self._draw_way(self._way)

    def _say(self, values: Sequence[float], status: Status) -> None:
        """Numbers and the line about the episode."""
        told = [
            f"{s.name} {values[s.arguments['value'][0]]:.3g} {s.unit}".rstrip()
            for s in self._scene.shapes
            if s.panel == "text"
        ]
        top = self.size[1] - FOOTER
        self._screen.blit(self._text("    ".join(told), INK), (MARGIN, top + 8))
        line = f"time {status.time:.2f} s    return {status.total:.4g}"
        end = status.reason if status.status == "none" else f"{status.status}: {status.reason}"
        words = self._text(line, INK)
        self._screen.blit(words, (MARGIN, top + 28))
        left = MARGIN + words.get_width() + 24
        if end:
            self._screen.blit(self._label(end, ENDED[status.status]), (left, top + 28))
        elif status.blocked:
            self._screen.blit(self._label("the request was blocked", (150, 90, 0)), (left, top + 28))

    # What stays -------------------------------------------------------------------

    def _text(self, text: str, colour: Colour, size: int = SMALL) -> Any:
        return self._fonts[size].render(text, True, colour)

    def _label(self, text: str, colour: Colour, size: int = SMALL) -> Any:
        """A text that is written once and kept."""
        key = (text, colour, size)
        if (found := self._written.get(key)) is None:
            if len(self._written) >= MOST_WRITTEN:
                self._written.clear()
            found = self._written[key] = self._text(text, colour, size)
        return found

    def _drawn_background(self) -> Any:
        surface = self._pygame.Surface(self.size)
        surface.fill(PAPER)
        surface.blit(self._text(self._library.manifest.name, INK, LARGE), (MARGIN, 8))
        self._legend(surface)
        for kind, panel in self._panels.items():
            getattr(self, f"_{kind}_background")(surface, panel)
        return surface

    def _legend(self, surface: Any) -> None:
        left, top = MARGIN, 31
        for role, word in WORDS.items():
            shapes = [s for s in self._scene.shapes if s.role == role]
            if not shapes:
                continue
            names = ", ".join(dict.fromkeys(s.name for s in shapes if s.name))
            self._pygame.draw.rect(surface, COLOURS[role], (left, top + 1, 11, 11))
            text = self._text(f"{word}: {names}" if names else word, INK)
            surface.blit(text, (left + 16, top))
            left += 16 + text.get_width() + 20

    def _across(self, surface: Any, panel: Panel, axis: str, name: str) -> None:
        """Numbers and unit below a panel."""
        below = panel.top + panel.height
        for x, text in panel.scales[axis].ticks():
            self._pygame.draw.line(surface, INK, (x, below), (x, below + 4))
            written = self._text(text, INK)
            surface.blit(written, (x - written.get_width() // 2, below + 6))
        unit = self._library.manifest.scene.axes[axis].unit
        written = self._text(f"{name} / {unit}" if unit else name, INK)
        surface.blit(written, (panel.left + panel.width - written.get_width(), below + 20))

    def _upwards(self, surface: Any, panel: Panel, axis: str, name: str) -> None:
        """Numbers and unit to the left of a panel."""
        for y, text in panel.scales[axis].ticks():
            self._pygame.draw.line(surface, INK, (panel.left - 4, y), (panel.left, y))
            written = self._text(text, INK)
            surface.blit(written, (panel.left - 7 - written.get_width(), y - written.get_height() // 2))
        unit = self._library.manifest.scene.axes[axis].unit
        written = self._text(f"{name} / {unit}" if unit and name else name or unit, INK)
        surface.blit(written, (panel.left - 7 - written.get_width(), panel.top - 18))

    def _plane_background(self, surface: Any, panel: Panel) -> None:
        draw = self._pygame.draw
        for x, _ in panel.scales["x"].ticks():
            draw.line(surface, ROAD, (x, panel.top), (x, panel.top + panel.height))
        for y, _ in panel.scales["y"].ticks():
            draw.line(surface, ROAD, (panel.left, y), (panel.left + panel.width, y))
        draw.rect(surface, FAINT, (panel.left, panel.top, panel.width, panel.height), 1)
        self._across(surface, panel, "x", "x")
        self._upwards(surface, panel, "y", "y")

    def _line_background(self, surface: Any, panel: Panel) -> None:
        draw, y = self._pygame.draw, road_of(panel)
        draw.rect(surface, ROAD, (panel.left, y - WALL // 2, panel.width, WALL))
        for x in range(panel.left, panel.left + panel.width, 24):
            draw.line(surface, PAPER, (x, y), (x + 11, y), 2)
        draw.line(surface, INK, (panel.left, y + WALL // 2), (panel.left + panel.width, y + WALL // 2))
        self._across(surface, panel, "line", "position")

    def _level_background(self, surface: Any, panel: Panel) -> None:
        self._upwards(surface, panel, "level", "")

    def _dial_background(self, surface: Any, panel: Panel) -> None:
        self._pygame.draw.circle(surface, FAINT, panel.middle, dial_of(panel), 2)
