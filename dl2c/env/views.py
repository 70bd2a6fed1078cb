"""Two ways to show an episode: the scene of its model, and curves over time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from dl2c.env.opening import compilation_of
from dl2c.env.state import read_state
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.native.binding import Batch
    from dl2c.picture.live import LivePlots
    from dl2c.picture.track import Track

ON_THE_WAY = np.linspace(0.0, 1.0, 17)
"""Fractions of a step at which the way of an agent is followed."""


def needed(module: str, package: str) -> None:
    """Raises `DependencyNotInstalled` for a module that is not there."""
    if find_spec(module) is None:
        raise DependencyNotInstalled(f"rendering needs {package}: `pip install {package}`")


class NoView:
    """In place of a view whose library is missing: the episode goes on, a picture raises `missing`."""

    def __init__(self, missing: DependencyNotInstalled) -> None:
        self._missing = missing

    def begin(self) -> None:
        """There is nothing to remember."""

    def stepped(
        self, reward: float, info: Mapping[str, Any], fractions: Sequence[float]
    ) -> Iterator[NDArray[np.uint8]]:
        """A picture for each of the fractions."""
        yield from (self.pixels() for _ in fractions)

    def pixels(self) -> NDArray[np.uint8]:
        """Raises `DependencyNotInstalled`."""
        raise self._missing

    def show(self) -> None:
        """Raises `DependencyNotInstalled`."""
        raise self._missing

    def close(self) -> None:
        """There is no window."""


class SceneView:
    """The scene of a model; `batch` is one environment of a library that was built to inspect."""

    def __init__(self, batch: "Batch", fps: int) -> None:
        needed("pygame", "pygame-ce")
        from dl2c.picture.scene import ScenePicture, Status

        self._batch, self._fps = batch, fps
        self._picture = ScenePicture(batch.library)
        self._status = Status()

    def begin(self) -> None:
        """An episode begins where the environment is now."""
        from dl2c.picture.scene import Status

        self._status = Status(time=float(self._batch.time[0]))
        self._picture.begin(*self._batch.get_state(0))

    def stepped(
        self, reward: float, info: Mapping[str, Any], fractions: Sequence[float]
    ) -> Iterator[NDArray[np.uint8]]:
        """The environment has made a step: pictures at fractions of its time, which rise."""
        from dl2c.native.inspect import motion

        before, self._status = self._status, self._status.then(reward, info)
        _, p = self._batch.get_state(0)
        places = np.union1d(ON_THE_WAY, fractions) if self._picture.follows else np.array(fractions)
        states = motion(self._batch, 0, places) if len(places) else ()
        for place, x in zip(places.tolist(), states, strict=True):
            if self._picture.follows:
                self._picture.follow(x, p)
            if place in fractions:
                status = replace(before, time=before.time + place * info["duration"])
                self._picture.draw(x, p, status if place < 1.0 else self._status)
                yield self._picture.pixels()

    def pixels(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        self._picture.draw(*self._batch.get_state(0), self._status)
        return self._picture.pixels()

    def show(self) -> None:
        """Bring the window up to date, and wait as long as a frame lasts."""
        self._picture.draw(*self._batch.get_state(0), self._status)
        self._picture.show(self._fps)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._picture.close()


class PlotView:
    """Variables over time, as `plot=` asks for; `batch` is one environment."""

    def __init__(self, source: Source, options: Mapping[str, Any], batch: "Batch", fps: int) -> None:
        needed("matplotlib", "matplotlib")
        self._batch, self._fps = batch, fps
        self._model = compilation_of(source, options).unbounded
        self._track: Track | None = None
        self._plots: LivePlots | None = None

    def begin(self) -> None:
        """An episode begins where the environment is now."""
        from dl2c.picture.track import Track

        self._track = Track((0.0,), (self._state(),), ())

    def stepped(
        self, reward: float, info: Mapping[str, Any], fractions: Sequence[float]
    ) -> Iterator[NDArray[np.uint8]]:
        """The environment has made a step: a picture of where it led to for each of the fractions."""
        assert self._track is not None
        time = self._track.times[-1] + info["duration"]
        self._track = self._track.then(time, self._state(), info["blocked"], info["status"], info["reason"])
        if fractions:
            yield from [self.pixels()] * len(fractions)

    def pixels(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        from dl2c.picture.figure import blank

        return self._drawn(blank).pixels()

    def show(self) -> None:
        """Bring the window up to date, and wait as long as a frame lasts."""
        plt = _pyplot()
        plt.ion()
        self._drawn(plt.figure)
        plt.pause(1 / self._fps)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._plots is not None and self._plots.figure.canvas.manager is not None:
            _pyplot().close(self._plots.figure)
        self._plots = None

    def _drawn(self, make: Callable[[], Any]) -> "LivePlots":
        """The episode so far on a figure that is made once."""
        from dl2c.picture.live import LivePlots

        assert self._track is not None
        if self._plots is None:
            self._plots = LivePlots(make(), self._model)
        self._plots.show(self._track)
        return self._plots

    def _state(self) -> dict[str, float]:
        return read_state(self._batch.library.manifest, self._batch)


def _pyplot() -> Any:
    """Matplotlib's windows, untyped."""
    from matplotlib import pyplot

    return pyplot
