"""One iteration of PPO and SAC of sbx-rl. `make test-clients` runs this. sbx-rl knows no masks."""

from typing import Any

import numpy as np
import pytest

import dl2c

pytestmark = pytest.mark.slow
sbx: Any = pytest.importorskip("sbx")


@pytest.mark.parametrize("model", ["example:waypoint", "example:dubins"])
def test_ppo_trains(model: str) -> None:
    """On discrete and on continuous actions, in the native environments of Stable-Baselines3."""
    policy = sbx.PPO("MlpPolicy", dl2c.make_sb3(model, 4), n_steps=64, batch_size=64, n_epochs=1, seed=0)
    before = first_weights(policy.policy.actor_state)
    policy.learn(256)
    assert policy.num_timesteps == 256
    assert np.any(first_weights(policy.policy.actor_state) != before)


def test_sac_trains_on_an_id() -> None:
    policy = sbx.SAC("MlpPolicy", "dl2c/Dubins-v0", learning_starts=50, seed=0)
    before = first_weights(policy.policy.actor_state)
    policy.learn(100)
    assert np.any(first_weights(policy.policy.actor_state) != before)


def first_weights(state: Any) -> Any:
    import jax

    return np.array(jax.tree_util.tree_leaves(state.params)[1])
