"""Pictures of learning and of single episodes, written to PNG files. Imports matplotlib when called."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dl2c.training.ppo import Point


def plot_curves(curves: Mapping[str, Sequence[Sequence["Point"]]], path: Path) -> None:
    """Success and violation rates over environment steps; several runs of one name share a colour."""
    figure, axes = _axes(2, sharex=True)
    for k, (name, runs) in enumerate(curves.items()):
        for j, run in enumerate(runs):
            steps = [p.steps for p in run]
            label = name if j == 0 else None
            axes[0].plot(steps, [p.success for p in run], color=f"C{k}", label=label, alpha=0.8)
            axes[1].plot(steps, [p.violations for p in run], color=f"C{k}", label=label, alpha=0.8)
    axes[0].set_ylabel("success rate")
    axes[1].set_ylabel("violation rate")
    axes[1].set_xlabel("environment steps")
    for axis in axes:
        axis.set_ylim(-0.02, 1.02)
        axis.grid(alpha=0.3)
    axes[0].legend(loc="best", fontsize="small")
    _save(figure, path)


def plot_trajectory(
    rows: Sequence[Mapping[str, Any]], names: Mapping[str, str], path: Path, title: str
) -> None:
    """Variables of one episode over its time; `names` maps a variable to its axis label."""
    figure, axes = _axes(len(names), sharex=True)
    times = [row["time"] for row in rows]
    for axis, (name, label) in zip(axes, names.items(), strict=True):
        axis.plot(times, [row[name] for row in rows], marker=".", markersize=3)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time / s")
    _save(figure, path)


def _axes(rows: int, **keywords: Any) -> tuple[Any, Any]:
    """A figure that needs no display, with `rows` axes above each other. Untyped: matplotlib's own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(7, 1.2 + 2.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, squeeze=False, **keywords)[:, 0]


def _save(figure: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120, metadata={"Software": None})
