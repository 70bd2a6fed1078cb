"""What an environment shows of its episode: an array of pixels, or a window. Needs matplotlib."""

from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from dl2c.env.opening import compilation_of
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.picture.track import Track

Transition = Callable[[Any], tuple[Any, float, bool, bool, dict[str, Any]]]


class Screen:
    """The episode so far, drawn when asked for; with `mode` "human" also at every reset and step."""

    def __init__(self, source: Source, options: Mapping[str, Any], mode: str, fps: int) -> None:
        if find_spec("matplotlib") is None:
            raise DependencyNotInstalled("rendering needs matplotlib: `pip install matplotlib`")
        self._model = compilation_of(source, options).unbounded
        self._mode, self._fps = mode, fps
        self._track: Track | None = None
        self._figure: Any = None

    def begin(self, state: Mapping[str, float]) -> None:
        """A new episode begins in a state."""
        from dl2c.picture.track import Track

        self._track = Track((0.0,), (dict(state),), ())
        self._show()

    @contextmanager
    def aside(self) -> Generator[None]:
        """What the environment does meanwhile is not shown, and not part of the episode."""
        kept = self._track, self._mode
        self._mode = ""
        try:
            yield
        finally:
            self._track, self._mode = kept

    def watching(self, transition: Transition, state: Callable[[], Mapping[str, float]]) -> Transition:
        """A step that is seen here; `state` reads what it led to."""

        def step(action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            result = transition(action)
            info = result[-1]
            assert self._track is not None
            seen = (dict(state()), info["blocked"], info["status"], info["reason"])
            time = self._track.times[-1] + info["duration"]
            self._track = self._track.then(time, *seen)
            self._show()
            return result

        return step

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (height, width, 3) in mode `rgb_array`; a window brought up to date in mode `human`."""
        if self._mode == "human":
            self._show()
            return None
        return None if self._track is None else self._pixels(self._track)

    def _pixels(self, track: "Track") -> NDArray[np.uint8]:
        from dl2c.picture.figure import draw, episode_figure, pixels

        if self._figure is None:
            self._figure = episode_figure(self._model, [track])
        else:
            draw(self._figure, self._model, [track])
        return pixels(self._figure)

    def _show(self) -> None:
        """Bring the window up to date, and wait as long as a frame lasts."""
        if self._mode != "human" or self._track is None:
            return
        from dl2c.picture.figure import draw

        plt = _pyplot()
        if self._figure is None:
            plt.ion()
            self._figure = plt.figure()
        draw(self._figure, self._model, [self._track])
        plt.pause(1 / self._fps)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._figure is not None and self._mode == "human":
            _pyplot().close(self._figure)
        self._figure = None


def _pyplot() -> Any:
    """Matplotlib's windows, untyped."""
    from matplotlib import pyplot

    return pyplot
