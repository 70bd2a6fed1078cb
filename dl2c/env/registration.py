"""The environments' names in Gymnasium. Importing dl2c registers them."""

from copy import copy
from typing import TYPE_CHECKING

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

if TYPE_CHECKING:
    from dl2c.native.manifest import Manifest

ENTRY_POINT = "dl2c.env.single:Dl2cEnv"
VECTOR_ENTRY_POINT = "dl2c.env.vector:Dl2cVectorEnv"

EXAMPLES = {
    "Waypoint": "waypoint",
    "StaticSafetyLine": "static_safety_line",
    "StaticSafety": "static_safety",
    "PassiveSafety": "passive_safety",
    "Evasion": "evasion",
    "ForcedAcceleration": "forced_acceleration",
    "BouncingBall": "bouncing_ball",
    "Pendulum": "pendulum",
    "Dubins": "dubins",
    "Acc": "acc",
    "Etcs": "etcs",
    "WaterTank": "watertank",
    "Thermostat": "thermostat",
}
"""The models that come with dl2c: `dl2c/<key>-v0` is `examples/<value>.kyx`."""


class WithSpec:
    """What environments know of the id that they were made from; their `manifest` is there before."""

    manifest: "Manifest"
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium made this from, with the number of steps after which episodes are truncated.

        None for an environment that was made otherwise.
        """
        return self._spec

    @spec.setter
    def spec(self, given: EnvSpec | None) -> None:
        limit = self.manifest.options["max_episode_steps"]
        if given is not None and given.max_episode_steps is None and limit:
            given = copy(given)
            given.max_episode_steps = limit
        self._spec = given


def register() -> None:
    """`dl2c/Model-v0` takes `model=`; the others are `EXAMPLES`.

    No wrappers: the environments truncate by themselves (option `max_episode_steps`), refuse a
    step before the first reset by themselves, and pass the checker, which would slow every step.
    """
    for name, model in {"Model": None, **EXAMPLES}.items():
        identifier = f"dl2c/{name}-v0"
        if identifier not in gym.registry:
            gym.register(  # pyright: ignore[reportUnknownMemberType] # a bare dict in its signature
                identifier,
                entry_point=ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                order_enforce=False,
                disable_env_checker=True,
                kwargs={} if model is None else {"model": f"example:{model}"},
            )
