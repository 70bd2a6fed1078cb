"""Pictures of learning and of single episodes, written to PNG files. Imports matplotlib when called."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dl2c.training.run import Point


CURVES = {
    "success": "success rate",
    "violations": "violation rate",
    "blocked": "episodes with\na blocked request",
    "episode_return": "mean return",
}
"""What of a learning curve is shown, by field of `Point`."""


def plot_curves(curves: Mapping[str, Sequence[Sequence["Point"]]], path: Path) -> None:
    """Rates and returns over environment steps; several runs of one name share a colour."""
    figure, axes = _axes(len(CURVES))
    for k, (name, runs) in enumerate(curves.items()):
        for j, run in enumerate(runs):
            steps = [point.steps for point in run]
            for axis, field in zip(axes, CURVES, strict=True):
                values = [getattr(point, field) for point in run]
                axis.plot(steps, values, color=f"C{k}", label=None if j else name, alpha=0.8)
    for axis, label in zip(axes, CURVES.values(), strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if label != CURVES["episode_return"]:
            axis.set_ylim(-0.02, 1.02)
    axes[-1].set_xlabel("environment steps")
    axes[0].legend(loc="best", fontsize="small")
    _save(figure, path)


def plot_trajectory(
    rows: Sequence[Mapping[str, Any]], names: Mapping[str, str], path: Path, title: str
) -> None:
    """Variables of one episode over its time; `names` maps a variable to its axis label."""
    figure, axes = _axes(len(names))
    times = [row["time"] for row in rows]
    for axis, (name, label) in zip(axes, names.items(), strict=True):
        axis.plot(times, [row[name] for row in rows], marker=".", markersize=3)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time / s")
    _save(figure, path)


def _axes(rows: int) -> tuple[Any, Any]:
    """A figure that needs no display, with `rows` axes above each other. Untyped: matplotlib's own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(7, 1.2 + 2.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]


def _save(figure: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120, metadata={"Software": None})
