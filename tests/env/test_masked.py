"""Masks inside observations, as RLlib and TorchRL read them."""

import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from dl2c.env.masked import MaskedObservations, env_creator


def test_observations_hold_the_mask() -> None:
    env = env_creator({"model": "example:waypoint", "masked": True, "max_episode_steps": 50})
    plain = env_creator({"model": "example:waypoint", "max_episode_steps": 50})
    assert isinstance(env, MaskedObservations)
    (obs, info), (bare, _) = env.reset(seed=3), plain.reset(seed=3)
    for _ in range(60):
        assert env.observation_space.contains(obs)
        assert np.array_equal(obs["observations"], bare)
        assert np.array_equal(obs["action_mask"], info["action_mask"])
        action = int(np.flatnonzero(info["action_mask"])[0])
        obs, reward, terminated, truncated, info = env.step(action)
        bare, *rest = plain.step(action)
        assert [reward, terminated, truncated] == rest[:3]
        if terminated or truncated:
            break


def test_gymnasiums_checker_is_silent(recwarn: pytest.WarningsRecorder) -> None:
    check_env(env_creator({"model": "example:waypoint", "masked": True}), skip_render_check=True)
    assert not [w for w in recwarn if "unwrapped" not in str(w.message)]


def test_a_creator_and_its_environments_can_be_sent_to_workers() -> None:
    creator: Any = pickle.loads(pickle.dumps(env_creator))
    env = pickle.loads(pickle.dumps(creator({"model": "example:waypoint", "masked": True})))
    assert set(env.reset(seed=1)[0]) == {"observations", "action_mask"}


def test_without_decisions_there_is_nothing_to_mask() -> None:
    with pytest.raises(ValueError, match="no discrete decisions"):
        env_creator({"model": "example:dubins", "masked": True})
