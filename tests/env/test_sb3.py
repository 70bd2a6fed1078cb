"""The Stable-Baselines3 VecEnv: its contract, and that its algorithms run on it."""

import pickle
from functools import partial
from typing import Any

import numpy as np
import pytest
from generators.toy_library import use_toy
from gymnasium import spaces

pytest.importorskip("stable_baselines3")

from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.env.single import Dl2cEnv

MODEL = "a model\nof two lines"


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes every model the toy library, with these decisions."""
    use_toy(monkeypatch)
    return partial(use_toy, monkeypatch)


def test_it_equals_a_dummy_vec_env() -> None:
    ours, theirs = Dl2cVecEnv(MODEL, 3), DummyVecEnv([lambda: Dl2cEnv(MODEL)] * 3)
    rng = np.random.default_rng(0)
    for env in (ours, theirs):
        env.seed(5)
    assert np.array_equal(ours.reset(), theirs.reset())
    for _ in range(80):
        actions = rng.integers(3, size=3)
        mine, others = ours.step(actions), theirs.step(actions)
        for a, b in zip(mine[:3], others[:3], strict=True):
            assert a.dtype == b.dtype
            assert np.array_equal(a, b)
        for info, other in zip(mine[3], others[3], strict=True):
            assert np.array_equal(info.pop("terminal_observation", 0), other.pop("terminal_observation", 0))
            assert info.items() <= {k: v for k, v in other.items() if k != "action_mask"}.items()
            assert ("is_success" in info) == ("is_success" in other)
        assert np.array_equal(
            np.stack(ours.env_method("action_masks")), np.stack(theirs.env_method("action_masks"))
        )


def test_the_vec_env_contract() -> None:
    env = Dl2cVecEnv(MODEL, 3)
    env.seed(1)
    env.reset()
    _, rewards, dones, infos = env.step(np.array([2, 2, 2]))
    assert (rewards.dtype, dones.dtype) == (np.float32, np.bool_)
    assert len({id(info) for info in infos}) == 3
    assert env.has_attr("action_masks") and not env.has_attr("nonsense")
    assert [m().tolist() for m in env.get_attr("action_masks", [0, 2])] == [[True] * 3] * 2
    assert len(env.env_method("action_masks", indices=1)) == 1
    assert len(env.env_method("render")) == 3
    assert env.env_is_wrapped(object) == [False] * 3  # type: ignore[arg-type]
    assert env.get_attr("render_mode") == [None] * 3
    with pytest.raises(AttributeError, match="no method"):
        env.env_method("fly")
    env.set_attr("note", 1)
    assert env.get_attr("note") == [1, 1, 1]
    twin = pickle.loads(pickle.dumps(env))
    assert twin.num_envs == 3
    env.close()
    env.close()


def test_no_two_infos_are_the_same_object() -> None:
    env = Dl2cVecEnv(MODEL, 64, max_episode_steps=3)
    env.seed(1)
    env.reset()
    infos = [info for _ in range(7) for info in env.step(np.full(64, 1))[3]]
    last = [info["terminal_observation"] for info in infos if info]
    assert len({id(info) for info in infos}) == 7 * 64 and len(last) == 2 * 64
    last[0][:] = -1
    assert not any(np.shares_memory(last[0], other) for other in last[1:])


def test_the_end_of_an_episode_is_told_once() -> None:
    env = VecMonitor(Dl2cVecEnv(MODEL, 2, max_episode_steps=4))
    env.reset()
    for step in range(8):
        obs, _, dones, infos = env.step(np.zeros(2, int))
        assert dones.tolist() == [step % 4 == 3] * 2
        for i, info in enumerate(infos):
            assert ("episode" in info) == dones[i]
            if dones[i]:
                assert info["TimeLimit.truncated"] and not info["is_success"]
                assert not np.array_equal(info["terminal_observation"], obs[i])


def test_mixed_decisions_become_a_box(toy: Any) -> None:
    toy((3, 2), 2)
    assert Dl2cVecEnv(MODEL, 2).action_space == spaces.Box(
        np.array([-1.5, -1.5, 0, 0], np.float32), np.array([2, 2, 2, 1], np.float32)
    )
    assert isinstance(Dl2cVecEnv(MODEL, 2, action_format="dict").action_space, spaces.Box)


@pytest.mark.parametrize(("counts", "inputs"), [((3,), 0), ((3, 2), 0), ((2,), 1)])
def test_ppo_learns_on_it(toy: Any, counts: Any, inputs: int) -> None:
    from stable_baselines3 import PPO

    toy(counts, inputs)
    env = VecMonitor(Dl2cVecEnv(MODEL, 4))
    PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu", seed=1).learn(128)


@pytest.mark.parametrize("counts", [(3,), (3, 2)])
def test_maskable_ppo_learns_on_it(toy: Any, counts: Any) -> None:
    contrib = pytest.importorskip("sb3_contrib")
    toy(counts)
    env = VecMonitor(Dl2cVecEnv(MODEL, 4))
    contrib.MaskablePPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu", seed=1).learn(
        128
    )
