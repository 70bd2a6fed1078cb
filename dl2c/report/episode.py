"""One episode as data: all that replays it bit for bit, and what must come out.

A file of it is JSON. It holds the model's text, so that it can be replayed wherever the model is, or what
has become of it.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from dl2c.env.single import Dl2cEnv
from dl2c.inputs import checked_input, read_json
from dl2c.outputs import write_output
from dl2c.source import MAX_TEXT, Source, text_hash
from dl2c.version import __version__

FORMAT, VERSION = "dl2c episode", 1

NATIVE, WEB = "native", "webassembly"
"""What an episode was run by: this machine's code, or that of a page of `dl2c play`."""

MOST_BYTES = 256 * 1024**2
"""What is longer is not an episode."""

MOST_RESETS = 10**7
"""Episodes that may come before one, and so resets that replaying it takes."""


class EpisodeError(Exception):
    """A file is not an episode; the message says why."""


@dataclass(frozen=True, slots=True)
class Start:
    """How an episode began: the seed, how many episodes came before it since then, and the state that was
    asked for, None for one that was drawn."""

    seed: int
    number: int = 0
    state: Mapping[str, float] | None = None


@dataclass(frozen=True, slots=True)
class Moment:
    """A step: the action that was asked for, the state it led to (by name) and what was said of it."""

    action: Any
    state: Mapping[str, float]
    time: float
    duration: float
    reward: float
    cost: int
    blocked: bool
    postcondition: bool


@dataclass(frozen=True, slots=True)
class Episode:
    """From its start to the last step taken; `status` and `reason` are those of that step.

    `options` are the effective ones of the environment, `initial` is the state after the reset.
    """

    source: Source
    options: Mapping[str, Any]
    start: Start
    initial: Mapping[str, float]
    moments: tuple[Moment, ...]
    status: str
    reason: str
    version: str = __version__
    engine: str = NATIVE

    @property
    def states(self) -> tuple[Mapping[str, float], ...]:
        """The initial state and those after each step."""
        return (self.initial, *(m.state for m in self.moments))

    @property
    def actions(self) -> tuple[Any, ...]:
        return tuple(m.action for m in self.moments)

    @property
    def failed(self) -> bool:
        """Whether it ended in failure or a @safety predicate failed on the way."""
        return self.status == "failure" or any(m.cost > 0 for m in self.moments)


def begin(env: Dl2cEnv, start: Start) -> None:
    """Begin the episode. Raises `ResetFailed`, `ValueError`."""
    options = None if start.state is None else {"state": dict(start.state)}
    env.reset(seed=start.seed, options=None if start.number else options)
    for left in range(start.number, 0, -1):
        env.reset(options=options if left == 1 else None)


def moment(env: Dl2cEnv, action: Any, reward: float, info: Mapping[str, Any]) -> Moment:
    """The step just taken."""
    return Moment(
        plain(action),
        env.state,
        info["time"],
        info["duration"],
        float(reward),
        info["cost"],
        bool(info["blocked"]),
        bool(info["postcondition"]),
    )


def play(env: Dl2cEnv, start: Start, actions: Sequence[Any]) -> Episode:
    """What follows a start under these actions, to the last of them or the end of the episode.

    Raises `ResetFailed`, `ValueError` for a start or an action that the environment refuses.
    """
    begin(env, start)
    initial, moments = env.state, list[Moment]()
    status, reason = "none", ""
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        moments.append(moment(env, action, reward, info))
        status, reason = info["status"], info["reason"]
        if terminated or truncated:
            break
    return Episode(env.source, env.manifest.options, start, initial, tuple(moments), status, reason)


def replay(episode: Episode, source: Source | None = None) -> Episode:
    """The episode once more, with its own text or another. Raises what `Dl2cEnv` and `play` raise."""
    env = Dl2cEnv(source or episode.source, **episode.options)
    try:
        return play(env, episode.start, [action_of(a) for a in episode.actions])
    finally:
        env.close()


def action_of(action: Any) -> Any:
    """An action of a file, as the environment takes it."""
    if isinstance(action, dict):
        return cast("dict[str, Any]", action)
    return action if isinstance(action, int) else np.asarray(action)


def difference(recorded: Episode, found: Episode) -> str:
    """Where a replay first differs from what was recorded; "" where it never does, to the last bit."""
    if text := _between(recorded.initial, found.initial, "the initial state"):
        return text
    for k, (one, other) in enumerate(zip(recorded.moments, found.moments, strict=False), 1):
        if text := _between(one.state, other.state, f"step {k}"):
            return text
        if one != other:
            names = [n for n in Moment.__slots__ if getattr(one, n) != getattr(other, n)]
            return _said(f"step {k}", names[0], getattr(one, names[0]), getattr(other, names[0]))
    if len(recorded.moments) != len(found.moments):
        return f"it ends after {len(found.moments)} steps, not {len(recorded.moments)}"
    ends = ((recorded.status, recorded.reason), (found.status, found.reason))
    return "" if ends[0] == ends[1] else _said("the end", "status and reason", *ends)


def _between(one: Mapping[str, float], other: Mapping[str, float], where: str) -> str:
    if one.keys() != other.keys():
        return f"{where} has other names: {', '.join(sorted(one.keys() ^ other.keys()))}"
    for name, value in one.items():
        if value.hex() != other[name].hex():
            return _said(where, name, value, other[name])
    return ""


def _said(where: str, name: str, recorded: Any, found: Any) -> str:
    return f"{where} differs: {name} is {found!r}, recorded was {recorded!r}"


def plain(action: Any) -> Any:
    """An action of any action space as JSON holds it."""
    match action:
        case dict():
            return {str(k): plain(v) for k, v in cast("dict[Any, Any]", action).items()}
        case _:
            return np.asarray(action).tolist()


# Files --------------------------------------------------------------------------


def write_episode(episode: Episode, path: Path) -> None:
    """Write a file that `read_episode` reads; folders are made."""
    content = {
        "format": FORMAT,
        "format_version": VERSION,
        "dl2c_version": episode.version,
        "engine": episode.engine,
        "model": {
            "name": episode.source.name,
            "sha256": text_hash(episode.source.text),
            "text": episode.source.text,
        },
        "options": dict(episode.options),
        "start": asdict(episode.start),
        "initial": dict(episode.initial),
        "steps": [asdict(m) | {"reward": _word(m.reward)} for m in episode.moments],
        "status": episode.status,
        "reason": episode.reason,
    }
    write_output(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _word(number: float) -> float | str:
    return number if math.isfinite(number) else str(number)


def read_episode(path: Path) -> Episode:
    """Read a file. Raises `EpisodeError` for one that is not an episode, `OSError`. Nothing in it is run."""
    with checked_input(EpisodeError, f"{path} is not an episode of dl2c"):
        return _episode(read_json(path, MOST_BYTES))


def _episode(content: Any) -> Episode:
    data = _object(content)
    if data.get("format") != FORMAT:
        raise ValueError(f"it does not say that its format is {FORMAT!r}")
    if data["format_version"] != VERSION:
        raise ValueError(f"its format has version {data['format_version']!r}, this dl2c reads {VERSION}")
    model, start = _object(data["model"]), _object(data["start"])
    text = _text(model["text"])
    if len(text) > MAX_TEXT or text_hash(text) != model["sha256"]:
        raise ValueError("the model's text is not the one that was written")
    given: Any = start["state"]
    return Episode(
        source=Source(_text(model["name"]), text),
        options=_object(data["options"]),
        start=Start(
            _count(start["seed"]),
            _count(start["number"], MOST_RESETS),
            None if given is None else _state(given),
        ),
        initial=_state(data["initial"]),
        moments=tuple(_moment(step) for step in data["steps"]),
        status=_text(data["status"]),
        reason=_text(data["reason"]),
        version=_text(data["dl2c_version"]),
        engine=_text(data.get("engine", NATIVE)),
    )


def _moment(data: Any) -> Moment:
    floats = {n: float(data[n]) for n in ("time", "duration", "reward")}
    flags = {n: bool(data[n]) for n in ("blocked", "postcondition")}
    return Moment(
        action=_action(data["action"]),
        state=_state(data["state"]),
        cost=_count(data["cost"]),
        **floats,
        **flags,
    )


def _action(data: Any) -> Any:
    """Numbers, lists of them, or such by name. Raises `TypeError`."""
    match data:
        case dict():
            return {str(k): _action(v) for k, v in cast("dict[Any, Any]", data).items()}
        case list():
            return [_action(v) for v in cast("list[Any]", data)]
        case int() | float() if not isinstance(data, bool):
            return data
        case _:
            raise TypeError(f"an action is made of numbers, not {data!r}")


def _state(data: Any) -> dict[str, float]:
    return {name: float(value) for name, value in _object(data).items()}


def _object(data: Any) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise TypeError(f"expected an object, not {data!r:.40}")
    return cast("dict[str, Any]", data)


def _text(data: Any) -> str:
    if not isinstance(data, str):
        raise TypeError(f"expected a text, not {data!r:.40}")
    return data


def _count(data: Any, most: int = 2**64 - 1) -> int:
    if not isinstance(data, int) or isinstance(data, bool) or not 0 <= data <= most:
        raise TypeError(f"expected a number from 0 to {most}, not {data!r:.40}")
    return data
