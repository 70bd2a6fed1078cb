"""Pictures of searches for proofs about policies: a plane of states, and the decided share over time."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dl2c.ir.model import Model
from dl2c.paths.enumerate import assignments_of, decisions_of
from dl2c.picture.figure import blank
from dl2c.picture.panels import BLACK, BLUE, ENDS, GREEN, VERMILION, YELLOW, label_of, plain
from dl2c.policy_proof.plane import Plane, plane_of, shown
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Found
from dl2c.policy_proof.tree import BY_BOUNDS, BY_SOLVER, LEFT_OPEN, NO_STATE
from dl2c.policy_proof.verdict import percent

LOOKS: dict[int, tuple[str, dict[str, Any]]] = {
    BY_BOUNDS: ("proved by bounds", {"facecolor": GREEN, "alpha": 0.55}),
    BY_SOLVER: ("proved by Z3", {"facecolor": BLUE, "alpha": 0.55}),
    NO_STATE: ("no state is assumed", {"facecolor": BLACK, "alpha": 0.13}),
    LEFT_OPEN: ("open (not decided)", {"facecolor": YELLOW, "alpha": 0.55}),
}
"""For each kind of leaf, its name in the legend and matplotlib's arguments."""

EDGE = (0.0, 0.0, 0.0, 0.35)

MOST_OUTLINED = 3000
"""Leaves whose edges are drawn."""

MOST_PATHS = 20_000
"""Leaves that are drawn as paths, in formats that have them; more become pixels."""

WIDTH = 128
"""Of the caption, in characters."""

ENDED = {"proved": "success", "refuted": "failure", "unknown": "none"}
"""The mark of an answer, as that of an episode's end."""


def proof_figure(
    model: Model, questions: Sequence[Question], found: Sequence[Found], names: Sequence[str] = ()
) -> Any:
    """A figure (matplotlib's own) of what was found out, over two names of a question's dimensions; without
    them over those along which boxes were split most often. Raises `NotCovered`, `NativeError`.
    """
    question, seen = shown(questions, found, names)
    plane = plane_of(question, seen, names)
    figure = blank(figsize=(10.4, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    figure.suptitle(plain(_title(model, question, seen)), fontsize=11)
    _states(left, model, plane)
    _share(right, seen)
    figure.supxlabel(plain(_caption(plane)), fontsize=8.5)
    return figure


def _title(model: Model, question: Question, found: Found) -> str:
    by = f", {found.by_solver} of them by Z3" if found.by_solver else ""
    reason = f" ({found.reason})" if found.reason and found.progress else ""
    done = f"{found.answer}{reason}, {found.boxes:,} boxes{by}, {percent(found.share)} decided"
    return "\n".join([f"{model.name}: {done}", *_taken(model, question)])


def _taken(model: Model, question: Question) -> list[str]:
    """The alternatives that the environment takes, in a line."""
    decisions = {d.key: d for d in decisions_of((*model.lead, *model.body))}
    parts: list[str] = []
    for key, k in question.lead:
        name, texts = decisions[key].name or key, decisions[key].alternatives
        parts.append(f"{name} = {k} ({textwrap.shorten(' '.join(texts[k].split()), 40, placeholder=' …')})")
    return [f"the environment takes {', '.join(parts)}"] if parts else []


def _caption(plane: Plane) -> str:
    where = "middle of the states" if plane.violation is None else "violation"
    values = ", ".join(f"{name}\xa0=\xa0{value:.4g}" for name, value in plane.values.items())
    text = f"The plane goes through the {where}: {values}" if values else ""
    return "\n".join(textwrap.wrap(text, WIDTH))


def _states(axes: Any, model: Model, plane: Plane) -> None:
    """The plane of states: leaves, points in which the policy is refuted, and the violation."""
    from matplotlib.collections import PolyCollection

    for code, (label, look) in LOOKS.items():
        chosen = plane.leaves[plane.decided == code]
        if not len(chosen):
            continue
        outlined, many = len(plane.leaves) <= MOST_OUTLINED, len(plane.leaves) > MOST_PATHS
        edges: dict[str, Any] = {"edgecolor": EDGE, "linewidth": 0.4} if outlined else {"linewidth": 0}
        drawn = PolyCollection(_corners(chosen), **look, **edges, antialiased=outlined, rasterized=many)
        axes.add_collection(drawn, autolim=False)
        axes.fill([np.nan], [np.nan], label=label, **look)
    if len(plane.refuted):
        half = plane.spacing[:, None] * (-0.5, 0.5)
        cells = _corners(plane.refuted[:, :, None] + half)
        look: dict[str, Any] = {"facecolor": VERMILION, "linewidth": 0}
        axes.add_collection(
            PolyCollection(cells, **look, antialiased=False, rasterized=True, zorder=3), autolim=False
        )
        axes.fill([np.nan], [np.nan], label="refuted (points)", **look)
    if plane.violation is not None:
        mark = {"marker": "*", "ms": 15, "mfc": "white", "mec": BLACK, "mew": 1.3, "ls": ""}
        axes.plot(*([v] for v in plane.violation), **mark, zorder=4, clip_on=False, label="violation")
    axes.set(xlim=_widened(plane.limits[0]), ylim=_widened(plane.limits[1]))
    axes.set_title("states", fontsize=10)
    axes.set_xlabel(_label(model, plane.names[0]), fontsize=9)
    if len(plane.names) == 2:
        axes.set_ylabel(_label(model, plane.names[1]), fontsize=9)
    else:
        axes.tick_params(left=False, labelleft=False)
    axes.tick_params(labelsize=8)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=3, fontsize=8, frameon=False)


def _corners(leaves: Any) -> Any:
    """The corners (n, 4, 2) of leaves (n, 2, 2)."""
    (x0, x1), (y0, y1) = leaves[:, 0].T, leaves[:, 1].T
    return np.stack([np.stack(c, axis=1) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], axis=1)


def _widened(limits: Any) -> tuple[float, float]:
    """Limits with a narrow margin, so that points at them are seen."""
    low, high = map(float, limits)
    margin = 0.015 * (high - low) or 0.5
    return low - margin, high + margin


def _label(model: Model, name: str) -> str:
    """The label of a dimension; of a value that the environment draws that of its variable."""
    given: Mapping[str, str] = {a.key: a.variable for a in assignments_of(model.lead)}
    return f"{label_of(model, given[name], 60)}, as drawn" if name in given else label_of(model, name, 60)


def _share(axes: Any, found: Found) -> None:
    """The decided share over seconds."""
    if not found.progress:
        axes.set_axis_off()
        axes.text(0.5, 0.5, plain(found.reason), transform=axes.transAxes, ha="center", fontsize=9)
        return
    seconds = [0.0, *(p.seconds for p in found.progress)]
    shares = [0.0, *(100 * p.decided for p in found.progress)]
    axes.plot(seconds, shares, color=BLUE, lw=1.5, marker=".", ms=4, drawstyle="steps-post", clip_on=False)
    colour, marker = ENDS[ENDED[found.answer]]
    look = {"marker": marker, "color": colour, "ms": 10, "ls": "", "clip_on": False, "zorder": 4}
    axes.plot(seconds[-1:], shares[-1:], **look, label=f"{found.answer} after {seconds[-1]:.2g} s")
    if found.answer == "refuted" and not shares[-1]:
        about = "a violation was found\nbefore any box was decided"
        axes.text(0.5, 0.5, about, transform=axes.transAxes, ha="center", fontsize=9)
    axes.set(xlim=(0, max(seconds[-1], 1e-3) * 1.03), ylim=(0, 100))
    axes.grid(alpha=0.25, lw=0.6)
    axes.set_title("decided volume over time", fontsize=10)
    axes.set_xlabel("seconds of search", fontsize=9)
    axes.set_ylabel("decided / %", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize=8, frameon=False)
