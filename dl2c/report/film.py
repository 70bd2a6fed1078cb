"""Films of recorded episodes, in the time of the model. Needs imageio-ffmpeg, and what pictures need.

In: episodes. Out: a file, whole or not at all. Motion inside steps is shown as it was.
"""

import math
import re
from collections.abc import Iterable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from dl2c.diagnostics import Mistake
from dl2c.env.single import Dl2cEnv
from dl2c.outputs import output_file
from dl2c.picture.shapes import COLOURS, INK
from dl2c.report.episode import Episode, action_of, begin

ENDINGS = (".mp4", ".gif")

FRAMES = 25
"""A second: what GIF can say exactly."""

LONGEST = 60.0
"""Seconds that an episode may take; a longer one is shown faster than it was."""

HELD = 1.0
"""Seconds that its last picture stays."""

SHADES = 28
"""Of each colour in a GIF, from almost white to itself."""

MARKED, CURVE = (230, 159, 0), (204, 121, 167)
"""Colours of curves over time, besides those of roles."""

Frame = NDArray[np.uint8]


def check_film(path: Path) -> None:
    """Whether a film can be written there, by the name. Raises `OSError`, `ModuleNotFoundError`."""
    if path.suffix.lower() not in ENDINGS:
        raise OSError(22, f"Not one of the formats of films ({', '.join(ENDINGS)})", str(path))
    import_module("imageio_ffmpeg")


def write_film(episodes: Iterable[Episode], path: Path) -> None:
    """Write a film of episodes, one after the other; folders are made. Raises what `check_film` raises,
    `Mistake` where what pictures need is missing, `OSError`.
    """
    check_film(path)
    with output_file(path) as fresh, TemporaryDirectory(prefix="dl2c-") as scratch:
        writer: Any = None
        try:
            for episode in episodes:
                for frame in frames_of(episode):
                    writer = writer or _writer(fresh, frame, Path(scratch))
                    writer.send(np.ascontiguousarray(frame))
        except DependencyNotInstalled as missing:
            raise Mistake(str(missing)) from None
        except OSError as problem:
            raise OSError(problem.errno or 5, "ffmpeg could not write the film", str(path)) from None
        finally:
            if writer is not None:
                writer.close()
        if not (fresh.exists() and fresh.stat().st_size):
            raise OSError(5, "ffmpeg could not write the film", str(path))


def frames_of(episode: Episode) -> Iterator[Frame]:
    """The pictures of an episode (height, width, 3), `FRAMES` a second of the model's time, and one of a step
    that takes no time. Raises `DependencyNotInstalled`, and what replaying raises.
    """
    env = Dl2cEnv(episode.source, render_mode="rgb_array", **episode.options)
    try:
        begin(env, episode.start)
        total = episode.moments[-1].time if episode.moments else 0.0
        every = max(total / LONGEST, 1.0) / FRAMES
        last: Any = env.render()
        yield last
        start = 0.0
        for moment in episode.moments:
            fractions = _fractions(start, moment.duration, every)
            act = partial(env.step, action_of(moment.action))
            for last in env.watch(act, fractions):
                yield last
            start = moment.time
        for _ in range(round(HELD * FRAMES)):
            yield last
    finally:
        env.close()


def _fractions(start: float, duration: float, every: float) -> list[float]:
    """The parts of a step at which a picture is due."""
    if not duration > 0.0:
        return [1.0]
    first, end = math.floor(start / every) + 1, start + duration
    return [min((k * every - start) / duration, 1.0) for k in range(first, math.floor(end / every) + 1)]


def _palette() -> bytes:
    """The 256 colours of a GIF, as a picture in PPM: those of pictures and their way to white."""
    roles = [COLOURS[role] for role in ("agent", "unsafe", "goal")]
    dark = [tuple(part * 3 // 4 for part in colour) for colour in roles]
    hues = np.array([*roles, *dark, INK, MARKED, CURVE], float)[:, None]
    shades = 255.0 + (hues - 255.0) * (np.arange(1, SHADES + 1) / SHADES)[:, None]
    table = np.full((256, 3), 255, np.uint8)
    table[: len(hues) * SHADES] = shades.reshape(-1, 3).round()
    return b"P6 16 16 255\n" + table.tobytes()


def _writer(path: Path, frame: Frame, scratch: Path) -> Any:
    """A running ffmpeg that takes frames of this size; `scratch` is a folder for what it reads."""
    ffmpeg: Any = import_module("imageio_ffmpeg")
    height, width, _ = frame.shape
    options: dict[str, Any] = {"fps": FRAMES, "macro_block_size": 1, "ffmpeg_log_level": "quiet"}
    if path.suffix.lower() == ".gif":
        (scratch / "palette.ppm").write_bytes(_palette())
        place = re.sub(r"([\\':,;\[\]])", r"\\\1", re.sub(r"([\\':])", r"\\\1", f"{scratch}/palette.ppm"))
        mapped = f"movie={place}[c];[in][c]paletteuse=dither=none:diff_mode=rectangle[out]"
        options |= {"codec": "gif", "pix_fmt_out": "pal8", "quality": None, "output_params": ["-vf", mapped]}
    else:
        even = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"
        options |= {"quality": 7, "output_params": ["-vf", even, "-movflags", "+faststart"]}
    writer = ffmpeg.write_frames(str(path), (width, height), **options)
    writer.send(None)
    return writer
