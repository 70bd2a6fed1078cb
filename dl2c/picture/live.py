"""Curves of an episode that goes on: what is there is kept, and only what is new is drawn."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.model import Model
from dl2c.picture.figure import DPI, draw, panels_of
from dl2c.picture.panels import BLUE, ORANGE
from dl2c.picture.thresholds import constant_names
from dl2c.picture.track import Track, moving

AHEAD = 2.0
"""How much further than the episode so far the axis of time goes when it is drawn anew."""

STEPS_AHEAD = 10


class LivePlots:
    """The variables of a model over time, on a figure of matplotlib's, which is drawn anew only where an
    episode begins or ends, leaves its axes, or changes what thresholds depend on.
    """

    def __init__(self, figure: Any, model: Model) -> None:
        self.figure, self._model = figure, model
        self._lines, self._counted = panels_of(model).lines, panels_of(model).histograms
        self._moving = moving(model)
        self._track: Track | None = None
        self._constant: set[str] = set()
        self._curves: list[tuple[Any, Any]] = []
        self._paper: Any = None

    def show(self, track: Track) -> None:
        """Bring the figure up to date."""
        if not self._goes_on(track):
            self._draw(track)
        blocked = [k + 1 for k, b in enumerate(track.blocked) if b]
        times = np.array(track.times)
        for name, (curve, marks) in zip(self._lines, self._curves, strict=True):
            values = track.curve(name, name in self._moving)
            curve.set_data(times, values)
            marks.set_data(times[blocked], values[blocked])
        self._track = track

    def pixels(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        canvas = self.figure.canvas
        if self._paper is None:
            for artist in (artist for pair in self._curves for artist in pair):
                artist.set_animated(True)
            canvas.draw()
            self._paper = canvas.copy_from_bbox(self.figure.bbox)
        canvas.restore_region(self._paper)
        for pair in self._curves:
            for artist in pair:
                artist.axes.draw_artist(artist)
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _goes_on(self, track: Track) -> bool:
        """Whether the track is that of the last picture, further on, and still inside its axes."""
        before = self._track
        if before is None or self._counted or track.reason or track.states[0] is not before.states[0]:
            return False
        if self._constant != constant_names(self._model, track):
            return False
        for name, (curve, _) in zip(self._lines, self._curves, strict=True):
            (low, high), values = curve.axes.get_ylim(), track.values(name)
            if not (
                track.times[-1] <= curve.axes.get_xlim()[1] and low <= min(values) <= max(values) <= high
            ):
                return False
        return True

    def _draw(self, track: Track) -> None:
        draw(self.figure, self._model, [track])
        self.figure.set_dpi(DPI)
        self._constant, self._curves, self._paper = constant_names(self._model, track), [], None
        for name, axes in zip(self._lines, self.figure.axes, strict=False):
            style = "default" if name in self._moving else "steps-pre"
            (curve,) = axes.plot([], [], color=BLUE, lw=1.4, marker=".", ms=2.5, drawstyle=style, zorder=3)
            (marks,) = axes.plot([], [], "x", color=ORANGE, ms=4.5, zorder=4)
            self._curves.append((curve, marks))
            if not track.reason:
                last = track.times[-1]
                longest = max(np.diff(track.times), default=0.0)
                axes.set_xlim(0.0, max(AHEAD * last, STEPS_AHEAD * longest) or 1.0)
