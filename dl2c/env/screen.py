"""What an environment shows of its episode: an array of pixels, or a window.

A model with a scene is drawn by pygame, another one as curves over time by matplotlib.
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from dl2c.env.views import NoView, PlotView, SceneView
from dl2c.source import Source

if TYPE_CHECKING:
    from dl2c.native.binding import Batch

Transition = Callable[[Any], tuple[Any, float, bool, bool, dict[str, Any]]]


class View(Protocol):
    """One way to show an episode."""

    def begin(self) -> None:
        """An episode begins where the environment is now."""
        ...

    def stepped(
        self, reward: float, info: Mapping[str, Any], fractions: Sequence[float]
    ) -> Iterator[NDArray[np.uint8]]:
        """The environment has made a step, which is followed as far as pictures of it are taken: at these
        fractions of its time, which rise."""
        ...

    def pixels(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        ...

    def show(self) -> None:
        """Bring a window up to date, and wait as long as a frame lasts."""
        ...

    def close(self) -> None:
        """Close the window, if there is one."""
        ...


class Screen:
    """The episode so far, drawn when asked for; with `mode` "human" also at every reset and step.

    Raises `DependencyNotInstalled` in that mode; in the other one a picture does: learning libraries ask for
    pixels that they never look at.
    """

    def __init__(
        self, source: Source, options: Mapping[str, Any], batch: "Batch", mode: str, fps: int
    ) -> None:
        self._view = _view(source, options, batch, fps, mode == "human")
        self._human, self._begun, self._watching = mode == "human", False, True

    def begin(self) -> None:
        """A new episode begins in the present state."""
        if not self._watching:
            return
        self._begun = True
        self._view.begin()
        if self._human:
            self._view.show()

    @contextmanager
    def aside(self) -> Generator[None]:
        """What the environment does meanwhile is not shown, and not part of the episode."""
        self._watching = False
        try:
            yield
        finally:
            self._watching = True

    def watching(self, transition: Transition) -> Transition:
        """A step that is seen here."""

        def step(action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            result = transition(action)
            if self._watching:
                for _ in self._view.stepped(result[1], result[-1], ()):
                    pass
                if self._human:
                    self._view.show()
            return result

        return step

    def inside(
        self, step: Callable[[], tuple[Any, float, bool, bool, dict[str, Any]]], fractions: Sequence[float]
    ) -> Iterator[NDArray[np.uint8]]:
        """Pictures at fractions of the time of a step, which is made first."""
        with self.aside():
            result = step()
        yield from self._view.stepped(result[1], result[-1], fractions)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (height, width, 3) in mode `rgb_array`; a window brought up to date in mode `human`.

        Raises `DependencyNotInstalled`.
        """
        if not self._begun:
            return None
        if self._human:
            self._view.show()
            return None
        return self._view.pixels()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._view.close()


def _view(source: Source, options: Mapping[str, Any], batch: "Batch", fps: int, needed: bool) -> View:
    """How the model is shown. Raises `DependencyNotInstalled` if the view is needed."""
    try:
        scene = batch.library.manifest.scene.shapes
        return SceneView(batch, fps) if scene else PlotView(source, options, batch, fps)
    except DependencyNotInstalled as missing:
        if needed:
            raise
        return NoView(missing)
