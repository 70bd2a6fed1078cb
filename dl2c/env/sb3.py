"""Many environments as a Stable-Baselines3 `VecEnv`, stepped by one C call.

Imports stable_baselines3, so it is itself imported on first use only (`dl2c.make_sb3`).
"""

import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from dl2c.env.actions import encoding, flat_format
from dl2c.env.infos import STATUS, SUCCESS, reason_names
from dl2c.env.opening import Model, batch_options, open_library, source_of
from dl2c.env.seeding import begin
from dl2c.env.spaces import observation_space
from dl2c.env.state import state_line
from dl2c.env.stepping import Column, infos_function, steps_function
from dl2c.env.targeted import check_uniform
from dl2c.native.manifest import Manifest

MOST_THREADS = 4
"""With some hundred environments more of them wait for each other more than they gain."""


def threads_that_pay(manifest: Manifest) -> int:
    """How many threads should share a step: one where all motion is a closed form, which takes no time."""
    costly = any(flow.kernel != "exact" for flow in manifest.flows)
    return min(os.cpu_count() or 1, MOST_THREADS) if costly else 1


class Dl2cVecEnv(VecEnv):
    """`num_envs` environments of one model, shared by `num_threads` (None: as many as pay; results are the
    same); `model` and `options` as for `Dl2cEnv`.

    Stable-Baselines3 knows no Dict actions: a model with both kinds of decisions gets the Box format.
    An episode that ends says so in its info: `terminal_observation`, `TimeLimit.truncated`,
    `is_success`, `status`, `reason`, `cost` and `blocked` of its last step, `time`; other infos are empty.
    """

    def __init__(
        self,
        model: Model,
        num_envs: int = 1,
        *,
        num_threads: int | None = 1,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.source, self._render_mode = source_of(model), render_mode
        library = open_library(self.source, options)
        self.manifest = library.manifest
        check_uniform(self.manifest)
        threads = threads_that_pay(self.manifest) if num_threads is None else num_threads
        self.batch = library.batch(
            num_envs, autoreset="same_step", threads=threads, **batch_options(self.manifest)
        )
        self.encoding = encoding(self.manifest, flat_format(self.manifest))
        single = (self.batch.rewards, np.dtype(np.float32))
        self._transition = steps_function(self.encoding, self.batch, self.batch.obs, single, self.batch.ends)
        self._infos = infos_function()
        self._reasons = reason_names(self.manifest)
        self._rng = np.random.default_rng()
        self._seeded = np.zeros(num_envs, np.bool_)
        self._actions: Any = None
        spaces = observation_space(self.manifest), self.encoding.space()
        super().__init__(num_envs, *spaces)  # pyright: ignore[reportUnknownMemberType] # Space without its parameter
        self.metadata = {"render_modes": ["ansi"]}

    def reset(self) -> NDArray[Any]:
        """Begin an episode in every environment, from the seeds given to `seed` since the last reset."""
        begin(self.batch, np.ones(self.num_envs, np.bool_), self._seeds, self._seeded, self._rng)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self.batch.obs.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take note of the actions; `step_wait` does the step."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, dones and infos; an environment that is done has begun its next episode."""
        obs, rewards, ends = self._transition(self._actions)
        dones = ends[0] | ends[1]
        return obs, rewards, dones, self._infos(dones, self._columns(ends[1] & ~ends[0]))

    def _columns(self, truncated: NDArray[np.bool_]) -> dict[str, Column]:
        """What is told of episodes that end."""
        b = self.batch
        return {
            "terminal_observation": b.final_obs,
            "TimeLimit.truncated": truncated,
            "is_success": b.status == SUCCESS,
            "status": (b.status, STATUS),
            "reason": (b.reason, self._reasons),
            "cost": b.cost,
            "blocked": b.blocked,
            "time": b.time,
        }

    def action_masks(self) -> NDArray[np.bool_]:
        """Which alternatives have a run: one row per environment."""
        self.batch.check_open()
        return self.encoding.masks(self.batch.mask).astype(np.bool_)

    def decides(self) -> NDArray[np.bool_]:
        """In which environments the policy decides something in the next step; training learns from those."""
        return self.batch.decides()

    def close(self) -> None:
        """Free the native environments. Closing twice is fine."""
        self.batch.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of each environment; what is not per environment is the same for all."""
        if attr_name == "render_mode":
            return [self._render_mode for _ in self._get_indices(indices)]
        if (methods := self._methods()).get(attr_name):
            return [partial(methods[attr_name], i) for i in self._get_indices(indices)]
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute, for all environments at once."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call `action_masks` or `render` of each environment."""
        if method_name == "action_masks":
            return list(self.action_masks()[list(self._get_indices(indices))])
        if method_name not in self._methods():
            raise AttributeError(
                f"the environments have no method {method_name!r}; there is action_masks, render"
            )
        return [method() for method in self.get_attr(method_name, indices)]

    def _methods(self) -> dict[str, Callable[[int], Any]]:
        """Methods of one environment, given its index."""
        return {
            "action_masks": lambda i: self.action_masks()[i],
            "render": lambda i: state_line(self.manifest, self.batch, i),
        }

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[Any] | None]:
        """There is no image rendering."""
        return [None] * self.num_envs

    def __getstate__(self) -> dict[str, Any]:
        given = {"model": self.source, "num_envs": self.num_envs, "render_mode": self._render_mode}
        return given | {"options": self.manifest.options}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["model"], state["num_envs"], render_mode=state["render_mode"], **state["options"])
