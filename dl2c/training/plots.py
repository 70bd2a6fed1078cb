"""Pictures of learning and of single episodes, written to PNG files. Imports matplotlib when called."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dl2c.picture.figure import blank, save
from dl2c.picture.panels import BLUE, CYCLE, DASHES, SKY, VERMILION, environment_steps

if TYPE_CHECKING:
    from dl2c.training.run import Point


CURVES = {
    "success": "success rate",
    "violations": "violation rate",
    "blocked": "episodes with\na blocked request",
    "episode_return": "mean return",
}
"""What of a learning curve is shown, by field of `Point`."""

ALWAYS = ("violations", "episode_return")
"""What is shown even where it is 0 throughout."""


def plot_curves(curves: Mapping[str, Sequence[Sequence["Point"]]], path: Path) -> None:
    """Rates and returns over environment steps; several runs of one name share a colour."""
    points = [point for runs in curves.values() for run in runs for point in run]
    shown = [field for field in CURVES if field in ALWAYS or any(getattr(p, field) > 0 for p in points)]
    figure, axes = _axes(len(shown))
    for k, (name, runs) in enumerate(curves.items()):
        for j, run in enumerate(runs):
            steps = [point.steps for point in run]
            for axis, field in zip(axes, shown, strict=True):
                values = [getattr(point, field) for point in run]
                style = ("-", *DASHES)[k % (1 + len(DASHES))]
                axis.plot(steps, values, color=CYCLE[k % len(CYCLE)], ls=style, label=None if j else name)
    for axis, field in zip(axes, shown, strict=True):
        axis.set_ylabel(CURVES[field])
        axis.grid(alpha=0.3)
        if field != "episode_return":
            axis.set_ylim(-0.02, 1.02)
    environment_steps(axes[-1])
    axes[0].legend(loc="best", fontsize="small")
    save(figure, path)


def plot_trajectory(
    rows: Sequence[Mapping[str, Any]], names: Mapping[str, str], path: Path, title: str
) -> None:
    """Variables of one episode over its time; `names` maps a variable to its axis label."""
    figure, axes = _axes(len(names))
    times = [row["time"] for row in rows]
    for axis, (name, label) in zip(axes, names.items(), strict=True):
        axis.plot(times, [row[name] for row in rows], color=BLUE, marker=".", markersize=3)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time / s")
    save(figure, path)


def _axes(rows: int) -> tuple[Any, Any]:
    """A figure that needs no display, with `rows` axes above each other. Untyped: matplotlib's own."""
    figure = blank(figsize=(7, 1.2 + 2.2 * rows), layout="constrained")
    return figure, figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]


Bar: TypeAlias = tuple[str, float, float, float]
"""A title with a value, its lowest and its highest."""

GROWTH_INCHES = 2.5


def speeds(rows: Sequence[Bar], title: str, growths: Sequence[tuple[str, str, Mapping[int, float]]]) -> Any:
    """Bars, and below them how something grows: the labels of both axes, and the points. All axes but that
    of titles are logarithmic.
    """
    heights = [0.5 + 0.3 * len(rows), *(GROWTH_INCHES for _ in growths)]
    figure = blank(figsize=(8, 0.5 + sum(heights)), layout="constrained")
    axes = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _bars(axes[0], rows)
    axes[0].set_title(title, fontsize="medium")
    for axis, (x, y, points) in zip(axes[1:], growths, strict=True):
        axis.loglog(list(points), list(points.values()), color=BLUE, marker="o")
        for point in points.items():
            axis.annotate(f"{point[1]:.3g}", point, (0, 6), textcoords="offset points", ha="center")
        axis.set_ymargin(0.2)
        axis.set_xticks(list(points), [f"{value:,}" for value in points])
        axis.minorticks_off()
        axis.set_xlabel(x)
        axis.set_ylabel(y)
        axis.grid(alpha=0.3)
    return figure


def _bars(axis: Any, rows: Sequence[Bar]) -> None:
    names, values, lows, highs = zip(*rows, strict=True)
    places = range(len(rows))
    spread = [
        [v - low for v, low in zip(values, lows, strict=True)],
        [high - v for v, high in zip(values, highs, strict=True)],
    ]
    axis.barh(places, values, xerr=spread, color=SKY, ecolor=VERMILION, capsize=3)
    for place, high, value in zip(places, highs, values, strict=True):
        axis.annotate(f"{value:,.0f}", (high, place), (6, 0), textcoords="offset points", va="center")
    axis.set_yticks(places, names)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xlim(right=6 * max(highs))
    axis.grid(axis="x", alpha=0.3)
