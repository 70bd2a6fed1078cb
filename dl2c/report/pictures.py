"""Pictures of recorded episodes and of what a policy does."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.env.opening import Model as ModelName
from dl2c.picture.figure import blank, episode_figure, save
from dl2c.picture.panels import BLUE, GREEN, ORANGE, VERMILION, environment_steps, legend
from dl2c.picture.track import Track
from dl2c.report.blame import model_of
from dl2c.report.episode import Episode
from dl2c.report.recording import Recording
from dl2c.training.evaluation import outcomes
from dl2c.training.policies import Policy


def draw_episode(episode: Episode, path: Path) -> None:
    """A picture of one episode, by the suffix of `path`."""
    save(episode_figure(model_of(episode), [track_of(episode)]), path)


def track_of(episode: Episode) -> Track:
    """What a picture shows of an episode."""
    times = (0.0, *(m.time for m in episode.moments))
    blocked = tuple(m.blocked for m in episode.moments)
    return Track(times, tuple(episode.states), blocked, episode.status, episode.reason)


def episodes_of(
    policy: str | Path | Policy,
    model: ModelName,
    episodes: int = 1,
    seed: int = 0,
    masked: bool = True,
    **options: Any,
) -> list[Episode]:
    """Episodes of a policy, all at once. Arguments are those of `evaluate`."""
    recording = Recording(episodes, seed)
    outcomes(policy, model, episodes, seed, masked, recording, **options)
    return recording.episodes()


def curves_figure(curve: Sequence[Mapping[str, Any]], evaluations: Sequence[Mapping[str, Any]]) -> Any:
    """The learning curve of a run: entries as in `run.json`. Rounds without an episode are left out."""
    figure = blank(figsize=(8.4, 4.6))
    figure.subplots_adjust(left=0.09, right=0.82, bottom=0.1, top=0.98, hspace=0.07)
    rates, returns = figure.subplots(2, 1, sharex=True)
    for name, colour, style, label in RATES:
        rates.plot(*_column(curve, name), color=colour, ls=style, lw=1.4, label=label)
        if name in ("success", "violations"):
            _intervals(rates, evaluations, name, colour)
    rates.set_ylim(-0.03, 1.03)
    rates.set_ylabel("fraction of episodes", fontsize=8)
    returns.plot(*_column(curve, "episode_return"), color=BLUE, lw=1.3, label="while learning")
    _intervals(returns, evaluations, "episode_return", BLUE)
    returns.set_ylabel("mean return", fontsize=8)
    environment_steps(returns)
    returns.xaxis.label.set_fontsize(8)
    for axes in (rates, returns):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(labelsize=7)
        legend(axes)
    return figure


RATES = (
    ("success", GREEN, "-", "success"),
    ("violations", VERMILION, "--", "safety violated"),
    ("blocked", ORANGE, "-.", "a request blocked"),
)


def _column(curve: Sequence[Mapping[str, Any]], name: str) -> tuple[list[float], list[float]]:
    told = [p for p in curve if isinstance(p[name], int | float) and p[name] == p[name]]
    return [p["steps"] for p in told], [p[name] for p in told]


def _intervals(axes: Any, evaluations: Sequence[Mapping[str, Any]], name: str, colour: str) -> None:
    """Evaluations with their 95 % intervals."""
    if not evaluations:
        return
    found = [(e["steps"], e["found"][name]) for e in evaluations]
    steps, values = [s for s, _ in found], [e["value"] for _, e in found]
    ends = [(e["value"] - e["low"], e["high"] - e["value"]) for _, e in found]
    spread = np.maximum(0, np.array(ends).T)  # the ends are rounded: that of a rate of 1 may lie below it
    label = "evaluated" if name == "episode_return" else f"{name}, evaluated"
    axes.errorbar(steps, values, spread, fmt="o", ms=4, capsize=2, color=colour, label=label)
