"""Every example behind every front end: Gymnasium's vector environments in each autoreset mode, and
Stable-Baselines3 with its wrappers and learners. Checkers of single environments are in test_examples.py.
"""

import os
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from agreement import assert_batch_equals_singles
from gymnasium.vector import AutoresetMode

import dl2c

FOLDER = Path(__file__).resolve().parents[2] / "examples"
QUICK = ("acc", "bouncing_ball", "waypoint")
"""With a Dict, with stretches without a decision, with a choice; the others are slow tests."""
NAMES = [
    pytest.param(path.stem, marks=[] if path.stem in QUICK else [pytest.mark.slow])
    for path in sorted(FOLDER.glob("*.kyx"))
]


@pytest.mark.parametrize("name", NAMES)
def test_vector_environments_are_gymnasiums(name: str) -> None:
    """Observations, rewards, ends and infos with their masks `_key` are those of SyncVectorEnv."""
    for mode in AutoresetMode:
        assert_batch_equals_singles(f"example:{name}", mode, n=2, steps=30)


@pytest.mark.parametrize("name", NAMES)
def test_without_copy_the_values_are_the_same(name: str) -> None:
    copied, bare = (dl2c.make_vec(f"example:{name}", 3, copy=copy) for copy in (True, False))
    copied.action_space.seed(0)
    assert np.array_equal(copied.reset(seed=2)[0], bare.reset(seed=2)[0])
    kept: list[Any] = []
    for _ in range(20):
        actions = copied.action_space.sample()
        one, other = copied.step(actions), bare.step(actions)
        assert all(np.array_equal(a, b) for a, b in zip(one[:4], other[:4], strict=True))
        assert not any(np.shares_memory(one[0], earlier) for earlier in kept)
        assert np.shares_memory(other[0], bare.batch.obs)
        kept.append(one[0])


@pytest.mark.parametrize("name", NAMES)
def test_stable_baselines_learns_on_it(name: str) -> None:
    """Under VecMonitor and VecNormalize: MaskablePPO where all decisions are discrete, else PPO."""
    contrib = pytest.importorskip("sb3_contrib")
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    bare = dl2c.make_sb3(f"example:{name}", 4)
    env = VecNormalize(VecMonitor(bare))
    discrete = not isinstance(bare.action_space, gym.spaces.Box)
    assert discrete == (not bare.manifest.inputs)
    algorithm = contrib.MaskablePPO if discrete and bare.manifest.choices else PPO
    model = algorithm("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu", seed=1)
    model.learn(128)
    assert model.num_timesteps == 128
    assert np.isfinite(env.get_original_obs()).all() and np.isfinite(env.obs_rms.mean).all()


@pytest.mark.parametrize("name", NAMES)
def test_users_may_make_errors_of_numpy_exceptions(name: str) -> None:
    """As many do who look for NaNs, `np.seterr(all="raise")`."""
    pytest.importorskip("stable_baselines3")
    with np.errstate(all="raise"):
        one, several = dl2c.make(f"example:{name}"), dl2c.make_vec(f"example:{name}", 3)
        one.action_space.seed(0)
        learner = dl2c.make_sb3(f"example:{name}", 1)
        one.reset(seed=0)
        several.reset(seed=0)
        learner.reset()
        for _ in range(5):
            several.step(several.action_space.sample())
            learner.step(np.array([learner.action_space.sample()]))
        assert one.observation_space.contains(one.step(one.action_space.sample())[0])


@pytest.mark.parametrize(("model", "costly"), [("watertank", False), ("dubins", True)])
def test_threads_are_as_many_as_pay(model: str, costly: bool) -> None:
    """Which does not change what they compute."""
    pytest.importorskip("stable_baselines3")
    from dl2c.env.sb3 import MOST_THREADS, Dl2cVecEnv, threads_that_pay

    envs = [Dl2cVecEnv(f"example:{model}", 130, num_threads=count) for count in (None, 1)]
    assert threads_that_pay(envs[0].manifest) == (min(os.cpu_count() or 1, MOST_THREADS) if costly else 1)
    rng = np.random.default_rng(0)
    for env in envs:
        env.seed(3)
    assert np.array_equal(*(env.reset() for env in envs))
    space: Any = envs[0].action_space
    for _ in range(20):
        actions = rng.uniform(space.low, space.high, (130, *space.shape))
        (obs, rewards, *_), (same, as_much, *_) = (env.step(actions) for env in envs)
        assert np.array_equal(obs, same) and np.array_equal(rewards, as_much)
