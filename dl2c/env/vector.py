"""Many environments stepped by one C call: `gymnasium.vector.VectorEnv` over a batch.

Environment i of a batch seeded s does bit for bit what the single environment seeded s+i does.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias, cast

import gymnasium as gym
import numpy as np
from gymnasium import Space
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dl2c.env.actions import encoding
from dl2c.env.infos import ENTRIES, IS_SUCCESS, NUMBERS, STATUS, SUCCESS, reason_names
from dl2c.env.lazy import LazyInfos
from dl2c.env.opening import Model, batch_options, open_library, source_of
from dl2c.env.registration import WithSpec
from dl2c.env.seeding import begin, spread
from dl2c.env.snapshot import Snapshot, put, take
from dl2c.env.spaces import observation_space
from dl2c.env.state import check_reset_options, read_drawn, read_state, state_line
from dl2c.env.stepping import steps_function
from dl2c.env.targeted import check_uniform
from dl2c.native.results import Results

Bools: TypeAlias = NDArray[np.bool_]
Infos: TypeAlias = dict[str, Any]

_MODES = {
    AutoresetMode.DISABLED: "disabled",
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
}


class Dl2cVectorEnv(WithSpec, VectorEnv[NDArray[Any], Any, NDArray[Any]]):  # pyright: ignore[reportIncompatibleVariableOverride] # `spec` is a variable there
    """`num_envs` environments of one model; `model` and `options` as for `Dl2cEnv`.

    Infos are arrays of length n, each `key` with a mask `_key` that says whose entry counts: those
    of `Dl2cEnv`, with `status` (int8) and `reason` (int32) as codes that `status_names` and
    `reason_names` spell out. In SAME_STEP mode the infos of a step that ended an episode are in
    `final_info`, its observation in `final_obs`. `copy=False` hands out the buffers themselves for
    observations and rewards: they change with the next step. `num_threads` share the environments, to
    the same bits: worth it where a step of all takes long, some 100 us, as with CVODES or thousands.
    """

    def __init__(
        self,
        model: Model,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_threads: int = 1,
        copy: bool = True,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, not {num_envs}")
        if render_mode not in (None, "ansi"):
            raise ValueError(f"no render mode {render_mode!r}; there is 'ansi'")
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["ansi"], "render_fps": 10, "autoreset_mode": self.autoreset_mode}
        self.num_envs, self.num_threads = num_envs, num_threads
        self.copy, self.render_mode = copy, render_mode
        self.source = source_of(model)
        library = open_library(self.source, options)
        self.manifest = library.manifest
        check_uniform(self.manifest)
        self.batch = library.batch(
            num_envs,
            autoreset=_MODES[self.autoreset_mode],
            threads=num_threads,
            shared_obs=not copy,
            **batch_options(self.manifest),
        )
        self._encoding = encoding(self.manifest)
        self._transition = steps_function(self._encoding, self.batch, self.batch.ends, self.batch.memory)
        self.single_observation_space = observation_space(self.manifest)
        self.single_action_space: Space[Any] = self._encoding.space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.status_names, self.reason_names = dict(enumerate(STATUS)), reason_names(self.manifest)
        self._seeded = np.zeros(num_envs, np.bool_)
        self._set_ready(np.zeros(num_envs, np.bool_))

    def reset(  # pyright: ignore[reportIncompatibleMethodOverride] # Gymnasium's own environments take lists too
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], Infos]:
        """Begin episodes. A seed s gives environment i the seed s+i; a list gives each its own.

        `options={"reset_mask": mask}` resets only where the boolean array is true.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        check_reset_options(options or {}, ("reset_mask",))
        mask = self._reset_mask(options or {})
        begin(self.batch, mask, spread(seed, self.num_envs), self._seeded, self.np_random)
        self._set_ready(self._ready | mask)
        return self._out(self.batch.obs), self._reset_infos(mask) | self._masks(self.batch, mask)

    def step(self, actions: Any) -> tuple[NDArray[Any], NDArray[np.float64], Bools, Bools, Infos]:
        """One step of every environment. In NEXT_STEP mode an environment whose episode has ended
        begins the next one instead, with reward 0. Raises `ValueError` for an action outside the space.
        """
        if not self._all_ready:
            raise gym.error.ResetNeeded(
                f"call reset() for the environments {np.flatnonzero(~self._ready).tolist()}"
            )
        batch = self.batch
        ends, memory = self._transition(actions)
        terminated, truncated = ends[0], ends[1]  # quicker than to unpack
        last = None
        if self.autoreset_mode != AutoresetMode.NEXT_STEP and np.count_nonzero(ends):
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                last = batch.final_obs[terminated | truncated]
            else:
                self._set_ready(~(terminated | truncated))
        infos = LazyInfos(self._infos, memory, last)
        return self._out(batch.obs), self._out(batch.rewards), terminated, truncated, infos

    def _infos(self, memory: NDArray[np.uint8], last: NDArray[Any] | None) -> Infos:
        """The infos of a step, whose results are in `memory`; `last` are the last observations (k, nobs) of
        episodes that have ended, where others have begun.
        """
        results = self.batch.laid_over(memory)
        ended, began = results.terminated | results.truncated, results.began
        everywhere = np.ones_like(ended)
        infos = self._step_infos(results, ~began, ended) | self._reset_infos(began)
        infos |= self._masks(results, everywhere)
        return infos if last is None else infos | self._final(results, ended, last)

    def _step_infos(self, results: Results, mask: Bools, ended: Bools) -> Infos:
        """What the results say of the step just taken, where `mask` is true."""
        values: Infos = dict.fromkeys(ENTRIES)
        values |= {name: getattr(results, name).astype(ENTRIES[name].dtype) for name in NUMBERS}
        values["executed_action"] = self._encoding.executed(results.executed_choices, results.executed_inputs)
        if drawn := read_drawn(self.manifest, results):
            values["environment"] = drawn
        return _masked(values, mask) | _masked({IS_SUCCESS: results.status == SUCCESS}, mask & ended)

    def _final(self, results: Results, ended: Bools, last: NDArray[Any]) -> Infos:
        """What same-step autoreset would otherwise hide: the last observation and infos of ended episodes."""
        observations = np.empty(self.num_envs, object)
        for i, row in zip(np.flatnonzero(ended), last, strict=True):
            observations[i] = row.copy()
        infos = self._step_infos(results, ended, ended) | self._masks(results, ended)
        if "action_mask" in infos:
            infos["action_mask"][ended] = 1
        return {
            "final_obs": observations,
            "_final_obs": ended.copy(),
            "final_info": infos,
            "_final_info": ended.copy(),
        }

    def _reset_infos(self, mask: Bools) -> Infos:
        """What is known of the environments in `mask`, whose episodes have just begun."""
        if not mask.any():
            return {}
        certificates = np.empty(self.num_envs, object)
        certificates[mask] = self.manifest.certificate
        return {"initial_state_certificate": certificates, "_initial_state_certificate": mask.copy()}

    def _masks(self, results: Results, mask: Bools) -> Infos:
        if not self.manifest.choices:
            return {}
        return _masked({"action_mask": self._encoding.masks(results.mask)}, mask)

    def _set_ready(self, ready: Bools) -> None:
        """Which environments may be stepped, all or an error: asked at every step, so known beforehand."""
        self._ready, self._all_ready = ready, bool(ready.all())

    def _reset_mask(self, options: dict[str, Any]) -> Bools:
        given = options.get("reset_mask")
        mask = np.ones(self.num_envs, np.bool_) if given is None else np.asarray(given)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be a boolean array of shape ({self.num_envs},)")
        return mask

    def _out(self, buffer: NDArray[Any]) -> NDArray[Any]:
        return buffer.copy() if self.copy else buffer

    def action_masks(self) -> Bools:
        """Which alternatives have a run: one row per environment."""
        self.batch.check_open()
        return self._encoding.masks(self.batch.mask).astype(np.bool_)

    def state(self, i: int = 0) -> dict[str, float]:
        """Variables and constants of environment i by name, exact."""
        return read_state(self.manifest, self.batch, i)

    def save(self, i: int) -> Snapshot:
        """Where environment i stands. Raises `ResetNeeded` before its first reset."""
        if not self._seeded[i]:
            raise gym.error.ResetNeeded(f"call reset() for the environment {i}")
        return take(self.batch, i)

    def restore(self, i: int, snapshot: Snapshot) -> None:
        """Go on in environment i from a snapshot of this build. Raises `ValueError` for another one."""
        put(self.batch, i, snapshot)
        self._seeded[i] = True
        self._ready[i] = self.autoreset_mode != AutoresetMode.DISABLED or not snapshot.ended
        self._set_ready(self._ready)

    def render(self) -> tuple[str, ...] | None:
        """Time and state of every environment, one line each (mode `ansi`)."""
        self.batch.check_open()
        if self.render_mode != "ansi":
            return None
        return tuple(state_line(self.manifest, self.batch, i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the native environments; called by `close`, once."""
        self.batch.close()

    def __getstate__(self) -> dict[str, Any]:
        return {
            "model": self.source,
            "arguments": {
                "num_envs": self.num_envs,
                "autoreset_mode": self.autoreset_mode,
                "num_threads": self.num_threads,
                "copy": self.copy,
                "render_mode": self.render_mode,
            },
            "options": self.manifest.options,
            "spec": self.spec,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["model"], **state["arguments"], **state["options"])
        self._spec = state["spec"]


def _masked(values: Infos, mask: Bools) -> Infos:
    """The values with their `_key` masks: other entries are 0; nothing if no entry counts."""
    if not mask.any():
        return {}
    kept, dropped = mask.copy(), np.flatnonzero(~mask)
    infos: Infos = {}
    for key, value in values.items():
        if isinstance(value, dict):
            infos[key] = _masked(cast(Infos, value), mask)
        else:
            value[dropped] = 0
            infos[key] = value
        infos[f"_{key}"] = kept
    return infos
