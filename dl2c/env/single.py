"""One environment: `gymnasium.Env` over a batch of one.

Everything that happens in a step happens in C; this module reads buffers and hands out fresh
objects. Numbers that depend on the model are worked out once, in the constructor.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from dl2c.env.actions import encoding
from dl2c.env.opening import Model, batch_options, open_library, source_of
from dl2c.env.registration import WithSpec
from dl2c.env.screen import Screen
from dl2c.env.seeding import SEEDS, draw_seed
from dl2c.env.snapshot import Snapshot, put, take
from dl2c.env.spaces import observation_space
from dl2c.env.state import check_reset_options, drawn_reader, read_chosen, read_state, reset_state, state_line
from dl2c.env.stepping import Origin, Parts, Step, step_function
from dl2c.env.targeted import Targeted

if TYPE_CHECKING:
    from dl2c.native.binding import Batch


class Dl2cEnv(WithSpec, gym.Env[NDArray[Any], Any]):  # pyright: ignore[reportIncompatibleVariableOverride] # `spec` is a variable there
    """A compiled dL model as a Gymnasium environment.

    `model` is a path, a text or `example:NAME`; `options` are those of `dl2c.options.Options`.
    Raises `CompileError`, `UnknownOption` or `NativeError`.

    `info` of every step: `status` (none, success, failure), `reason` (why the episode ended, "" while
    it runs), `cost` (violated safety predicates), `blocked`, `executed_action` (the run taken, in the
    encoding of the action space), `duration` and `time` in seconds, `postcondition`, `saturated`; with
    discrete decisions `action_mask` (int8); with decisions of the environment `environment`, what it
    decided by key (-1 or NaN for what it did not meet); at the end `is_success`. `info` of a reset:
    `action_mask`, `initial_state_certificate` (what is proved of sampled initial states; `checked` where
    the precondition was only evaluated in doubles), `initial_state_target` (with
    `initial_distribution="z3"`: `nearest`, or why the state was drawn uniformly).

    Pickling or copying an environment gives a fresh one of the same model and options.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi", "rgb_array", "human"], "render_fps": 10}  # pyright: ignore[reportIncompatibleVariableOverride] # not ClassVar there

    def __init__(self, model: Model, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"no render mode {render_mode!r}; there is 'ansi', 'rgb_array', 'human'")
        self.render_mode = render_mode
        self.source = source_of(model)
        shown = render_mode in ("rgb_array", "human")
        library = open_library(self.source, options, inspect=shown)
        self.manifest = library.manifest
        self._batch = library.batch(1, autoreset="disabled", **batch_options(self.manifest))
        self._encoding = encoding(self.manifest)
        self.observation_space = observation_space(self.manifest)
        self.action_space = self._encoding.space()
        targeted = self.manifest.options.get("initial_distribution") == "z3"
        self._targeted = Targeted(self.source, options) if targeted else None
        self._seeded = False
        self._act: Callable[[Any], Step] = _not_running
        """What a step does now."""
        self._closed = False
        self._bind(self._batch)
        self._screen: Screen | None = None
        if shown:
            fps = self.metadata["render_fps"]
            self._screen = Screen(self.source, options, self._batch, render_mode, fps)
            self._transition = self._screen.watching(self._transition)

    def _bind(self, batch: "Batch") -> None:
        """Views of a batch and functions over it, made once."""
        self._obs = batch.obs[0]
        plain = batch.mask.shape == self._encoding.masks(batch.mask).shape
        self._fresh_mask = batch.mask[0].copy if plain else lambda: self._encoding.masks(batch.mask)[0]
        extras: dict[str, Origin] = {}
        if self.manifest.drawn_choices or self.manifest.drawn_inputs:
            extras["environment"] = drawn_reader(self.manifest, batch)
        if self.manifest.choices:
            extras["action_mask"] = batch.mask[0] if plain else self._fresh_mask
        self._transition = step_function(Parts(self.manifest, batch, self._encoding, extras, self._stop))

    def _stop(self) -> None:
        self._act = _not_running

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode. `seed` restarts the random stream; without one it goes on.

        `options={"state": {...}}` begins in that state: every variable and every constant not fixed.
        Raises `ResetFailed` if the model's precondition refuses it or no initial state can be drawn.
        """
        super().reset(seed=seed)
        check_reset_options(options or {}, ("state",))
        if seed is None and not self._seeded:
            seed = draw_seed(self.np_random)
        info: dict[str, Any] = {"initial_state_certificate": self.manifest.certificate}
        stream = None if seed is None else seed % SEEDS
        begun = False
        if options and "state" in options:
            reset_state(self.manifest, self._batch, 0, stream, options["state"])
            begun = True
        elif self._targeted is not None:
            found = self._targeted.reset(self.manifest, self._batch, stream, self.np_random)
            info["initial_state_target"], begun = found, found == "nearest"
            if begun:
                info["initial_state_certificate"] = "checked"
        if not begun:
            self._batch.reset(seeds=None if stream is None else np.array([stream], np.uint64))
        self._seeded, self._act = True, self._transition
        if self.manifest.choices:
            info["action_mask"] = self._fresh_mask()
        if self._screen is not None:
            self._screen.begin()
        return self._obs.copy(), info

    def step(self, action: Any) -> Step:
        """One run of the loop's body. Raises `ValueError` for an action outside the action space."""
        return self._act(action)

    def save(self) -> Snapshot:
        """Where the episode stands, to `restore` later, here or in another environment of this build.

        Raises `ResetNeeded` before the first reset.
        """
        if not self._seeded:
            _not_running(None)
        return take(self._batch, 0)

    def restore(self, snapshot: Snapshot) -> tuple[NDArray[Any], dict[str, Any]]:
        """Go on from a snapshot; what follows is what followed it, to the last bit.

        Returns the observation, and an info with `action_mask` where there is one. Raises `ValueError`
        for a snapshot of another build.
        """
        put(self._batch, 0, snapshot)
        self._seeded, self._act = True, _not_running if snapshot.ended else self._transition
        if self._screen is not None:
            self._screen.begin()
        info: dict[str, Any] = {"action_mask": self._fresh_mask()} if self.manifest.choices else {}
        return self._obs.copy(), info

    def transition(
        self, snapshot: Snapshot, action: Any
    ) -> tuple[Snapshot, float, bool, bool, dict[str, Any]]:
        """What a step from a snapshot leads to: the next one, reward, terminated, truncated, info.

        A function of its arguments, for planners: the episode of this environment goes on where it is.
        """
        own = self.save() if self._seeded else None
        with nullcontext() if self._screen is None else self._screen.aside():
            self.restore(snapshot)
            try:
                _, reward, terminated, truncated, info = self.step(action)
                return self.save(), reward, terminated, truncated, info
            finally:
                if own is not None:
                    self.restore(own)
                else:
                    self._seeded, self._act = False, _not_running

    def action_masks(self) -> NDArray[np.bool_]:
        """Which alternatives have a run, one entry per alternative, as MaskablePPO asks."""
        self._batch.check_open()
        return self._fresh_mask().astype(np.bool_)

    @property
    def state(self) -> dict[str, float]:
        """Variables and constants by name, exact."""
        return read_state(self.manifest, self._batch)

    @property
    def chosen(self) -> dict[str, float]:
        """The values that `x := *` took in the last step by key, exact; with `action_map="squash"` only those
        that the environment decided. NaN for one that it did not meet.
        """
        return read_chosen(self.manifest, self._batch)

    def render(self) -> str | NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride] # generic in an unused parameter there
        """Mode `ansi`: time and state on one line. `rgb_array`: the model's scene (needs pygame-ce), or else
        the episode so far as its `plot=` asks for (needs matplotlib), (height, width, 3). `human`: the same
        in a window, brought up to date by resets and steps.
        """
        self._batch.check_open()
        if self._screen is not None:
            return self._screen.render()
        return state_line(self.manifest, self._batch) if self.render_mode == "ansi" else None

    def watch(self, step: Callable[[], Step], fractions: Sequence[float]) -> Iterator[NDArray[np.uint8]]:
        """Pictures as `render` gives them, inside a step: `step` makes it, then they come, at rising
        fractions of the time that it takes. Needs mode `rgb_array`.
        """
        assert self._screen is not None, "there are no pictures in this render mode"
        yield from self._screen.inside(step, fractions)

    def close(self) -> None:
        """Free the native environment. Closing twice is fine."""
        if not self._closed:
            self._closed, self._act = True, _not_running
            self._batch.close()
            if self._screen is not None:
                self._screen.close()

    def __getstate__(self) -> dict[str, Any]:
        return {
            "model": self.source,
            "render_mode": self.render_mode,
            "options": self.manifest.options,
            "spec": self.spec,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["model"], render_mode=state["render_mode"], **state["options"])
        self._spec = state["spec"]


def _not_running(action: Any) -> NoReturn:
    raise gym.error.ResetNeeded("the episode has ended, or none has begun: call reset() first")
