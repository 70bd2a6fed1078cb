"""Pictures of recorded episodes and of what a policy does."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from dl2c.env.opening import Model as ModelName
from dl2c.env.opening import source_of
from dl2c.ir.model import Model
from dl2c.picture.figure import episode_figure, save
from dl2c.picture.track import Track
from dl2c.pipeline import lowered_model, resolve_options
from dl2c.report.blame import model_of
from dl2c.report.episode import Episode
from dl2c.training.policies import Policy
from dl2c.training.rollout import COLUMNS, rollout


def draw_episode(episode: Episode, path: Path) -> None:
    """A picture of one episode, by the suffix of `path`."""
    save(episode_figure(model_of(episode), [track_of(episode)]), path)


def track_of(episode: Episode) -> Track:
    """What a picture shows of an episode."""
    times = (0.0, *(m.time for m in episode.moments))
    blocked = tuple(m.blocked for m in episode.moments)
    return Track(times, tuple(episode.states), blocked, episode.status, episode.reason)


def tracks_of(
    policy: str | Path | Policy,
    model: ModelName,
    episodes: int = 1,
    seed: int = 0,
    masked: bool = True,
    **options: Any,
) -> tuple[Model, list[Track]]:
    """Episodes of a policy for a picture, and the model they are of. Arguments are those of `rollout`."""
    source = source_of(model)
    ir = lowered_model(source, resolve_options(options))
    rows = list(rollout(policy, source, episodes, seed, masked, **options))
    return ir, list(_tracks(rows, [*(v.name for v in ir.variables), *(c.name for c in ir.constants)]))


def _tracks(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> Iterator[Track]:
    """Rows of a rollout as tracks. Whether a request blocked is not among them."""
    begins = [k for k, row in enumerate(rows) if row["step"] == 0]
    column: Callable[[str], str] = lambda name: f"{name}_" if name in COLUMNS else name  # noqa: E731
    for begin, end in zip(begins, [*begins[1:], len(rows)], strict=True):
        own = rows[begin:end]
        states = tuple({n: row[column(n)] for n in names} for row in own)
        last = own[-1]
        yield Track(
            tuple(r["time"] for r in own), states, (False,) * (len(own) - 1), last["status"], last["reason"]
        )
