"""Environments of dl2c under the names that tests of learning libraries make theirs by.

Importing this replaces them. Processes that such tests start import it too, as a preloaded module.
"""

import multiprocessing
import os
from collections.abc import Callable
from copy import deepcopy
from functools import wraps
from pathlib import Path
from typing import Any

import gymnasium as gym
import sb3_contrib.common.envs
import stable_baselines3.common.envs
from gymnasium import spaces

import dl2c
from dl2c.env.masked import MaskedObservations
from dl2c.env.single import Dl2cEnv

USES = "DL2C_STAND_INS_USES"
"""Names a file with one byte for each environment of dl2c that was made or reset, in any process."""

EPISODE = 200

IDS = {
    "CartPole-v1": "dl2c/Waypoint-v0",
    "Pendulum-v1": "dl2c/Dubins-v0",
    "MountainCarContinuous-v0": "dl2c/Dubins-v0",
}
"""Ids of Gymnasium, and ids of dl2c with the same kind of actions."""

TWO_CHOICES = Path(__file__).resolve().parents[1] / "good" / "lift.kyx"
"""A model whose actions are MultiDiscrete."""


class StandIn(gym.Wrapper[Any, Any, Any, Any]):
    """An environment of dl2c whose constructor takes what that of another environment takes."""

    model = "example:static_safety_line"

    def __init__(self, *_: Any, ep_length: int = 100, **__: Any) -> None:
        super().__init__(dl2c.make(self.model, max_episode_steps=ep_length))
        self.ep_length = ep_length

    def action_masks(self) -> Any:
        """As MaskablePPO asks."""
        return self.unwrapped.action_masks()


class Continuous(StandIn):
    """Actions are a Box."""

    model = "example:dubins"


class Several(StandIn):
    """Actions are MultiDiscrete."""

    model = str(TWO_CHOICES)


class DictObservations(gym.Wrapper[Any, Any, Any, Any]):
    """Observations are a Dict."""

    def __init__(self, *_: Any, **__: Any) -> None:
        super().__init__(MaskedObservations(dl2c.make("example:waypoint", max_episode_steps=100)))


def chosen_by_space(space: "spaces.Space[Any]", **_: Any) -> StandIn:
    """For an environment that has one space for both observations and actions."""
    return Continuous() if isinstance(space, spaces.Box) else StandIn()


CLASSES = {
    stable_baselines3.common.envs: {
        "IdentityEnv": StandIn,
        "IdentityEnvBox": Continuous,
        "IdentityEnvMultiDiscrete": Several,
        "SimpleMultiObsEnv": DictObservations,
    },
    sb3_contrib.common.envs: {
        "InvalidActionEnvDiscrete": StandIn,
        "InvalidActionEnvMultiDiscrete": Several,
    },
}
"""By the module they are imported from."""

OWN_CLASSES = {
    "test_vec_envs": {"CustomGymEnv": chosen_by_space},
    "test_lstm": {"CartPoleNoVelEnv": StandIn},
}
"""By the module of tests that has them."""


def replace() -> None:
    """Ids and classes now give environments of dl2c, and uses of these are counted."""
    for theirs, ours in IDS.items():
        spec = deepcopy(gym.spec(ours))
        spec.name, spec.namespace, spec.version = theirs[:-3], None, int(theirs[-1])
        spec.id = theirs
        spec.kwargs["max_episode_steps"] = EPISODE
        gym.registry[theirs] = spec
    for module, classes in CLASSES.items():
        vars(module).update(classes)
    for method in ("__init__", "reset"):
        setattr(Dl2cEnv, method, counted(getattr(Dl2cEnv, method)))
    multiprocessing.set_forkserver_preload([__name__])


def counted(method: Callable[..., Any]) -> Callable[..., Any]:
    """The method, whose calls are uses."""

    @wraps(method)
    def called(*args: Any, **kwargs: Any) -> Any:
        with Path(os.environ[USES]).open("ab") as file:
            file.write(b".")
        return method(*args, **kwargs)

    return called


replace()
