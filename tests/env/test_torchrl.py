"""TorchRL's checker on every example, alone and as a batch. `make test-ray` runs this.

Batches are in the mode that TorchRL prefers. In SAME_STEP it accepts no environment with infos (0.14.1;
Gymnasium's Taxi neither), and in batches no Dict of actions.
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode

import dl2c
from dl2c.env.masked import env_creator

pytestmark = pytest.mark.slow
envs: Any = pytest.importorskip("torchrl.envs")
check_env_specs: Any = pytest.importorskip("torchrl.envs.utils").check_env_specs

FOLDER = Path(__file__).resolve().parents[2] / "examples"
NAMES = sorted(path.stem for path in FOLDER.glob("*.kyx"))


@pytest.mark.parametrize("name", NAMES)
def test_torchrl_accepts_it(name: str) -> None:
    env = dl2c.make(f"example:{name}")
    check_env_specs(envs.GymWrapper(env))
    mixed = isinstance(env.action_space, gym.spaces.Dict)
    options: dict[str, Any] = {"action_format": "box"} if mixed else {}
    batch = dl2c.make_vec(f"example:{name}", 3, autoreset_mode=AutoresetMode.DISABLED, **options)
    check_env_specs(envs.GymWrapper(batch))


def test_masks_reach_torchrl() -> None:
    """Random actions of its own keep to the mask, so none of them blocks."""
    env = envs.GymWrapper(
        env_creator({"model": "example:waypoint", "masked": True, "on_blocked": "terminate"}),
        categorical_action_encoding=True,
    )
    masked = envs.TransformedEnv(env, envs.ActionMask())
    env.set_seed(0)
    for _ in range(5):
        rollout = masked.rollout(200)
        assert rollout["next", "reward"].max() == 1000, "success of every episode"
