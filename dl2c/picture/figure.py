"""A picture of episodes: which panels there are, where they stand, and what becomes of it."""

import base64
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.interruption import is_command
from dl2c.ir.model import Model
from dl2c.ir.scene import plotted_pairs
from dl2c.outputs import output_file
from dl2c.picture import panels
from dl2c.picture.track import Track

MOST_LINES = 6
"""Panels over time in one column."""

DPI = 110


@dataclass(frozen=True, slots=True)
class Panels:
    """What is shown of a model: variables over time, variables whose values are counted, pairs of variables
    against each other.
    """

    lines: tuple[str, ...]
    histograms: tuple[str, ...]
    phases: tuple[tuple[str, str], ...]


def panels_of(model: Model) -> Panels:
    """What `plot=` asks for. Variables with `scatter` are paired in their order, one left over is shown over
    time; where nothing is asked for, that is every observed variable.
    """
    lines, histograms, scatter = (
        [v.name for v in model.variables if v.plot == kind] for kind in ("line", "hist", "scatter")
    )
    if len(scatter) % 2:
        lines = [*lines, scatter[-1]]
    if not (lines or scatter or histograms):
        observed = [v.name for v in model.variables if v.observed]
        lines = observed or [v.name for v in model.variables]
    return Panels(tuple(lines[:MOST_LINES]), tuple(histograms), plotted_pairs(model))


def blank(**layout: Any) -> Any:
    """An empty figure (matplotlib's own, and its arguments) that needs no display."""
    if is_command() and "matplotlib.figure" not in sys.modules:
        _import_without_descriptions()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(**layout)
    FigureCanvasAgg(figure)
    return figure


def _import_without_descriptions() -> None:
    """Import matplotlib, but let it describe no properties in the help of its classes: that takes a quarter
    of the time, and nobody asks a command for that help.
    """
    from matplotlib import artist

    describe = artist.kwdoc
    artist.kwdoc = lambda artist: ""
    try:
        import_module("matplotlib.figure")
    finally:
        artist.kwdoc = describe


def episode_figure(model: Model, tracks: Sequence[Track], title: str = "") -> Any:
    """A figure (matplotlib's own) of some episodes: the first is explained, the others are faint."""
    figure = blank()
    draw(figure, model, tracks, title)
    return figure


def draw(figure: Any, model: Model, tracks: Sequence[Track], title: str = "") -> None:
    """Draw on a figure, after everything on it is removed."""
    what = panels_of(model)
    others = len(what.histograms) + len(what.phases)
    figure.clear()
    figure.set_layout_engine("constrained")
    height = max(1.5 * len(what.lines) + 0.8, 3.2 * others + 0.5, 2.6)
    figure.set_size_inches(7.2 * bool(what.lines) + 5.0 * bool(others), height)
    widths = [7.2] * bool(what.lines) + [5.0] * bool(others)
    columns = figure.add_gridspec(1, len(widths), width_ratios=widths)
    figure.suptitle(panels.plain(title or _title(model, tracks[0])), fontsize=10)
    if what.lines:
        _lines(figure, columns[0], model, tracks, what.lines)
    if others:
        rows = columns[len(widths) - 1].subgridspec(others, 1)
        for k, name in enumerate(what.histograms):
            panels.histogram(_axes(figure, rows[k]), model, tracks, name)
        for k, names in enumerate(what.phases, len(what.histograms)):
            panels.phase(_axes(figure, rows[k]), model, tracks, names)


def _title(model: Model, track: Track) -> str:
    end = f" — {track.end} after {track.times[-1]:.4g} s, {len(track.blocked)} steps" if track.end else ""
    return f"{model.name}{end}"


def _lines(figure: Any, place: Any, model: Model, tracks: Sequence[Track], names: Sequence[str]) -> None:
    rows = place.subgridspec(len(names), 1)
    all_axes: list[Any] = []
    for k, name in enumerate(names):
        axes = _axes(figure, rows[k], sharex=all_axes[0] if k else None)
        panels.line(axes, model, tracks, name, explained=k == 0)
        axes.tick_params(labelbottom=k == len(names) - 1)
        all_axes.append(axes)
    all_axes[-1].set_xlabel("time / s", fontsize=8)


def _axes(figure: Any, place: Any, **options: Any) -> Any:
    axes = figure.add_subplot(place, **options)
    axes.grid(alpha=0.25, lw=0.6)
    axes.tick_params(labelsize=7)
    return axes


# What becomes of it -------------------------------------------------------------


def save(figure: Any, path: Path) -> None:
    """Write PNG (or SVG, PDF, by the name); folders are made. Raises `OSError`."""
    check_format(path)
    with output_file(path) as fresh:
        figure.savefig(fresh, dpi=DPI, metadata={"Software": None} if path.suffix == ".png" else None)


def check_format(path: Path) -> None:
    """Whether a picture can be written there, by the name. Raises `OSError`."""
    known = blank().canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".").lower() not in known:
        raise OSError(22, f"Not one of the formats of pictures ({', '.join(sorted(known))})", str(path))


def pixels(figure: Any) -> NDArray[np.uint8]:
    """The picture (height, width, 3)."""
    figure.set_dpi(DPI)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()


def data_uri(figure: Any) -> str:
    """The picture as PNG in a URI, for pages."""
    buffer = io.BytesIO()
    figure.set_dpi(DPI)
    # `savefig` would draw twice; what zlib saves at its usual level takes a tenth longer
    figure.canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
