"""The three figures of the paper, from our results. Imports matplotlib when called."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.experiments.paper import waypoint
from dl2c.experiments.paper.closed_forms import fastest_time, guarded_drive
from dl2c.experiments.paper.experiments import Results
from dl2c.experiments.paper.forced import Approach
from dl2c.experiments.paper.waypoint import Driven, course_of
from dl2c.picture.figure import blank, save
from dl2c.picture.panels import BLUE, GREEN, ORANGE
from dl2c.picture.panels import VERMILION as RED
from dl2c.training.evaluation import FIRST_SEED
from dl2c.training.rollout import rollout

GREY = "#777777"
"""Beside the colours of `picture.panels`, which the colour-blind can tell apart; lines differ too."""

PAPER_SUCCESS = 0.68


def figures(results: Results, folder: Path) -> list[Path]:
    """Write fig1.png, fig2.png, fig3.png."""
    paths = [folder / f"fig{k}.png" for k in (1, 2, 3)]
    _forced_acceleration(results.approach, paths[0])
    _profiles(results, paths[1])
    _learning(results, paths[2])
    return paths


def _axes(rows: int, height: float) -> tuple[Any, Any]:
    figure = blank(figsize=(7, height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def _forced_acceleration(shown: Approach, path: Path) -> None:
    """Speed, and the two distances that meet at the predicted time."""
    figure, (above, below) = _axes(2, 5.5)
    x = {name: np.array([row[name] for row in shown.rows]) for name in shown.rows[0]}
    above.plot(shown.times, x["v"], color=BLUE, marker="o", markersize=4)
    above.set_ylabel("speed v / (m/s)")
    left, needed = x["xo"] - x["x"], x["v"] ** 2 / (2 * x["b"])
    below.plot(shown.times, left, color=BLUE, marker="o", markersize=4, label="distance left, xo - x")
    below.plot(
        shown.times, needed, color=RED, marker="s", markersize=4, ls="--", label="stopping distance, v²/(2b)"
    )
    below.set_ylabel("distance / m")
    below.set_xlabel("time / s")
    for axis in (above, below):
        axis.axvline(shown.predicted, color=GREY, ls=":", label=f"predicted end, {shown.predicted:.3f} s")
    below.legend(loc="center left", fontsize="small")
    above.legend(loc="upper left", fontsize="small")
    constants = ", ".join(f"{name} = {x[name][0]:.3g} {unit}" for name, unit in UNITS.items())
    above.set_title(f"Test 2: forced acceleration until one cannot stop any more\n{constants}", fontsize=10)
    save(figure, path)


UNITS = {"A": "m/s²", "b": "m/s²", "ep": "s"}


def _profiles(results: Results, path: Path) -> None:
    """One episode of a masked and of an unmasked policy."""
    figure, axes = _axes(3, 7.5)
    k = _telling(results.unmasked[-1])
    for run, colour, style in ((results.masked[-1], BLUE, "-"), (results.unmasked[-1], ORANGE, "--")):
        rows = list(
            rollout(
                str(run.policy), waypoint.MODEL, seed=FIRST_SEED + k, masked=run.masked, **waypoint.STRICT
            )
        )
        label = f"{run.name}, {'masked' if run.masked else 'no masks'}: {_end(rows[-1])}"
        for axis, name in zip(axes, ("xr", "vr", "T"), strict=True):
            _plot(axis, rows, name, colour, style, label if name == "vr" else None)
    first = rows[0]
    course = course_of([first])
    optimum, fastest = float(guarded_drive(course).time[0]), float(fastest_time(course)[0])
    area = (first["xg"] - first["GDelta"], first["xg"] + first["GDelta"])
    axes[0].axhspan(*area, color=GREEN, alpha=0.2, label="goal area")
    axes[0].legend(loc="lower right", fontsize="small")
    axes[1].axhline(first["Vmax"], color=GREY, ls="-.", label=f"Vmax = {first['Vmax']:.1f} m/s")
    for axis in axes:
        axis.axvline(optimum, color=GREY, ls=":", label=f"optimum of the guards, {optimum:.1f} s")
        axis.axvline(fastest, color=RED, ls="--", lw=1, label=f"fastest run of the model, {fastest:.1f} s")
    axes[1].set_ylim(0, 1.9 * first["Vmax"])
    axes[1].legend(loc="upper center", fontsize="small", ncols=2)
    axes[2].set_ylim(bottom=0)
    for axis, label in zip(axes, ("position / m", "speed / (m/s)", "time to deadline / s"), strict=True):
        axis.set_ylabel(label)
    axes[-1].set_xlabel("time / s")
    axes[0].set_title("Test 3: accelerate, coast, brake inside the goal area", fontsize=10)
    save(figure, path)


def _telling(run: Driven) -> int:
    """An episode that is a success if there is one, of middling length."""
    order = np.argsort(run.optimum)
    good = [int(i) for i in order if run.success[i]] or [int(i) for i in order]
    return good[len(good) // 4]


def _plot(
    axis: Any, rows: Sequence[Mapping[str, Any]], name: str, colour: str, style: str, label: Any
) -> None:
    times, values = [row["time"] for row in rows], [row[name] for row in rows]
    width = 3 if style == "-" else 1.5
    axis.plot(times, values, color=colour, ls=style, lw=width, label=label)


def _end(row: Mapping[str, Any]) -> str:
    return "success" if row["status"] == "success" else str(row["reason"])


def _learning(results: Results, path: Path) -> None:
    """Success in evaluations during the training: mean of the seeds, and the range of them."""
    figure, (axis,) = _axes(1, 4.2)
    for runs, colour, marker in ((results.masked, BLUE, "o"), (results.unmasked, ORANGE, "s")):
        steps = [checked.steps for checked in runs[0].curve]
        rates = np.array([[checked.found.success.value for checked in run.curve] for run in runs])
        name = f"{runs[0].name}, {'masked' if runs[0].masked else 'no masks'}, {len(runs)} seeds"
        axis.plot(steps, rates.mean(axis=0), color=colour, marker=marker, markersize=4, label=name)
        axis.fill_between(steps, rates.min(axis=0), rates.max(axis=0), color=colour, alpha=0.25, lw=0)
    axis.axhline(PAPER_SUCCESS, color=GREY, ls="--", label=f"the paper, {PAPER_SUCCESS:.0%}")
    random = results.guards[-1].success.mean()
    axis.axhline(random, color=RED, ls=":", label=f"uniform random, no masks, {random:.0%}")
    axis.set_xscale("log")
    axis.set_ylim(-0.03, 1.03)
    axis.set_xlabel("environment steps")
    axis.set_ylabel("success rate of the deterministic policy")
    axis.set_title("Test 3: a request whose guard fails ends the episode", fontsize=10)
    axis.legend(loc="center left", fontsize="small")
    save(figure, path)
