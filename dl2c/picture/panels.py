"""The parts of a picture, each drawn on axes of matplotlib's (untyped: its own)."""

import textwrap
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from dl2c.ir.model import Model
from dl2c.picture.regions import region
from dl2c.picture.thresholds import Kind, deadline, thresholds
from dl2c.picture.track import Track, events, moving

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
"""The colours of Okabe and Ito, which people tell apart whatever their colour vision."""

CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, BLACK, YELLOW)

COLOURS: dict[Kind, str] = {
    "safety": VERMILION,
    "progress": GREEN,
    "stability": ORANGE,
    "deadline": PURPLE,
    "domain": BLACK,
}
DASHES: tuple[Any, ...] = ("--", ":", "-.", (0, (7, 2)), (0, (3, 1, 1, 1, 1, 1)))
"""Thresholds of one panel differ in these."""

ENDS = {"success": (GREEN, "*"), "failure": (VERMILION, "X"), "none": (BLACK, "s")}
"""Colour and marker of an episode's end, by status."""

WRAP = 26
MOST_THRESHOLDS = 5


def plain(text: str) -> str:
    """Text that matplotlib takes for nothing but text."""
    return text.replace("\\", "/").replace("$", r"\$")


def label_of(model: Model, name: str, width: int = WRAP) -> str:
    """What an axis shows: description, name, unit."""
    q = next(q for q in (*model.variables, *model.constants) if q.name == name)
    unit = f" / ({q.unit})" if "/" in q.unit or " " in q.unit else f" / {q.unit}" if q.unit else ""
    about = textwrap.wrap(q.description, width, max_lines=2, placeholder=" …")
    return plain("\n".join([*about, f"{name}{unit}"]))


def legend(axes: Any) -> None:
    """A legend beside the axes, if there is anything to explain."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="center left", bbox_to_anchor=(1.005, 0.5), fontsize=7, frameon=False, handlelength=1.8
        )


def environment_steps(axes: Any) -> None:
    """Label an axis of environment steps: few enough not to overlap, however many digits they have."""
    from matplotlib.ticker import MaxNLocator, StrMethodFormatter

    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.set_xlabel("environment steps")


def line(axes: Any, model: Model, tracks: Sequence[Track], name: str, explained: bool = True) -> None:
    """A variable over time: the first track with what happened in it, the others faint. `explained`: the
    legend says what its marks are.
    """
    moves = name in moving(model)
    style = "default" if moves else "steps-pre"
    for other in tracks[1:]:
        faint: dict[str, Any] = {"color": SKY, "alpha": 0.45, "lw": 0.8, "zorder": 1}
        axes.plot(other.times, other.curve(name, moves), drawstyle=style, **faint)
    track = tracks[0]
    times, values = np.array(track.times), track.curve(name, moves)
    axes.plot(times, values, color=BLUE, lw=1.4, marker=".", ms=2.5, drawstyle=style, zorder=3)
    _happenings(axes, model, track, values, explained)
    low, high = _window(np.concatenate([t.values(name) for t in tracks]))
    _mark_thresholds(axes, model, tracks[0], name, (low, high), axes.axhline)
    shown = [*axes.get_ylim(), low * 0.8 + high * 0.2, low * 0.2 + high * 0.8]
    axes.set_ylim(min(shown), max(shown))
    when = deadline(model, track)
    if when is not None and when <= 1.5 * max(times[-1], 1e-9):
        axes.axvline(when, color=PURPLE, ls="-.", lw=1.1, label="deadline")
    axes.set_ylabel(label_of(model, name), fontsize=8)
    legend(axes)


def _happenings(axes: Any, model: Model, track: Track, values: Any, explained: bool) -> None:
    """Marks for flows that ended early, for requests that blocked, and for the end."""
    times = np.array(track.times)
    for where, marker, colour, text in (
        (events(model, track), "v", BLACK, "end of the domain"),
        ([k + 1 for k, b in enumerate(track.blocked) if b], "x", ORANGE, "request blocked"),
    ):
        if where:
            label = text if explained else None
            axes.plot(times[where], values[where], marker, color=colour, ms=4.5, zorder=4, label=label)
    if track.reason:
        colour, marker = ENDS[track.status]
        label = plain(track.end) if explained else None
        look: dict[str, Any] = {"color": colour, "ls": "", "ms": 8, "zorder": 5, "clip_on": False}
        axes.plot(times[-1:], values[-1:], marker=marker, label=label, **look)


def _window(values: Any) -> tuple[float, float]:
    """The range in which thresholds are looked for: that of the values and half as much on both sides."""
    low, high = float(values.min()), float(values.max())
    margin = 0.5 * (high - low) or 0.5 * abs(high) or 1.0
    return low - margin, high + margin


def _mark_thresholds(
    axes: Any, model: Model, track: Track, name: str, window: tuple[float, float], draw: Any
) -> None:
    found = thresholds(model, track, name, *window)[:MOST_THRESHOLDS]
    for number, ((kind, text), group) in enumerate(groupby(found, key=lambda t: (t.kind, t.text))):
        for k, threshold in enumerate(group):
            look = {"color": COLOURS[kind], "ls": DASHES[number % len(DASHES)]}
            draw(threshold.value, lw=1.1, zorder=2, label=None if k else plain(text), **look)


def histogram(axes: Any, model: Model, tracks: Sequence[Track], name: str) -> None:
    """How often values of a variable were visited, in all tracks."""
    visited = np.concatenate([t.values(name) for t in tracks])
    axes.hist(visited, bins=min(40, max(8, len(visited) // 10)), color=SKY, edgecolor=BLUE, linewidth=0.4)
    if len(tracks) == 1:
        _mark_thresholds(axes, model, tracks[0], name, _window(visited), axes.axvline)
    axes.set_xlabel(label_of(model, name, 60), fontsize=8)
    axes.set_ylabel("visited states", fontsize=8)
    legend(axes)


def phase(axes: Any, model: Model, tracks: Sequence[Track], names: tuple[str, str]) -> None:
    """Two variables against each other, with what is unsafe and what is outside all domains shaded, the
    other names being as at the end of the first track.
    """
    track = tracks[0]
    x, y = (track.values(n) for n in names)
    for other in tracks[1:]:
        axes.plot(*(other.values(n) for n in names), color=SKY, alpha=0.45, lw=0.8, zorder=2)
    axes.plot(x, y, color=BLUE, lw=1.3, marker=".", ms=3, zorder=3)
    axes.plot(x[:1], y[:1], "o", mfc="white", mec=BLUE, ms=6, zorder=4, label="start")
    if track.reason:
        colour, marker = ENDS[track.status]
        axes.plot(x[-1:], y[-1:], marker, color=colour, ms=9, zorder=5, label=plain(track.end))
    axes.margins(0.12)
    units = {q.name: q.unit for q in model.variables}
    if units[names[0]] == units[names[1]] == "m":
        _square(axes)
    _shade(axes, model, track, names)
    axes.set_xlabel(label_of(model, names[0], 60), fontsize=8)
    axes.set_ylabel(label_of(model, names[1]), fontsize=8)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=7, frameon=False)


def _square(axes: Any) -> None:
    """The same scale on both axes."""
    limits = (axes.get_xlim(), axes.get_ylim())
    half = max(high - low for low, high in limits) / 2
    (x, y) = ((low + high) / 2 for low, high in limits)
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")


def _shade(axes: Any, model: Model, track: Track, names: tuple[str, str]) -> None:
    xs, ys = axes.get_xlim(), axes.get_ylim()
    found = region(model, track, names, xs, ys)
    for where, colour, hatch, text in (
        (~found.safe, VERMILION, "//", "unsafe"),
        (~found.inside, BLACK, "..", "outside the domain"),
    ):
        if where.any():
            look: dict[str, Any] = {"alpha": 0.2, "zorder": 0}
            axes.contourf(
                found.x, found.y, where.astype(float), [0.5, 1.5], colors=[colour], hatches=[hatch], **look
            )
            axes.fill([np.nan], [np.nan], color=colour, hatch=hatch, label=text, **look)
    axes.set_xlim(xs)
    axes.set_ylim(ys)
