"""Many environments: the same as single ones, bit for bit, in every autoreset mode."""

from functools import partial
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from agreement import assert_batch_equals_singles
from generators.toy_library import use_toy
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.utils.passive_env_checker import data_shares_objects
from gymnasium.vector import AutoresetMode

from dl2c.env.registration import register
from dl2c.env.vector import Dl2cVectorEnv

MODEL = "a model\nof two lines"
MODES = list(AutoresetMode)
DECISIONS = [((3,), 0), ((3, 2), 0), ((), 2), ((2, 3), 1)]


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes every model the toy library, with these decisions."""
    use_toy(monkeypatch)
    return partial(use_toy, monkeypatch)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("counts", "inputs"), DECISIONS)
def test_a_batch_equals_single_environments(toy: Any, mode: AutoresetMode, counts: Any, inputs: int) -> None:
    toy(counts, inputs)
    assert assert_batch_equals_singles(MODEL, mode) > 3


@pytest.mark.parametrize("mode", MODES)
def test_nothing_returned_is_handed_out_twice(mode: AutoresetMode) -> None:
    env = Dl2cVectorEnv(MODEL, 3, autoreset_mode=mode)
    seen = [env.reset(seed=1)]
    for _ in range(4):
        result = env.step(np.array([2, 1, 0]))
        seen.append((result[:4], result[4]))
    for one, other in pairwise(seen):
        assert not data_shares_objects(one[1], other[1])
        assert not any(np.shares_memory(a, b) for a, b in zip(one[0], other[0], strict=False))


def test_without_copy_the_buffers_themselves() -> None:
    env = Dl2cVectorEnv(MODEL, 3, copy=False)
    env.reset(seed=1)
    first = env.step(np.zeros(3, int))[0]
    assert first is env.step(np.zeros(3, int))[0]


def test_stepping_an_ended_environment_asks_for_a_reset() -> None:
    env = Dl2cVectorEnv(MODEL, 2, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=1)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(2, int))
    env.reset(seed=1)
    env.step(np.zeros(2, int))
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1\]"):
        env.step(np.zeros(2, int))
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\]"):
        env.step(np.zeros(2, int))


@pytest.mark.parametrize("mask", [np.ones(3, bool), np.ones(2), [1, 0]])
def test_a_reset_mask_of_another_kind_is_refused(mask: Any) -> None:
    with pytest.raises(ValueError, match="reset_mask"):
        Dl2cVectorEnv(MODEL, 2).reset(options={"reset_mask": mask})


def test_seeds_may_be_given_one_by_one() -> None:
    env = Dl2cVectorEnv(MODEL, 3)
    shuffled, _ = env.reset(seed=[9, 7, 8])
    plain, _ = env.reset(seed=7)
    assert np.array_equal(shuffled, plain[[2, 0, 1]])
    with pytest.raises(ValueError, match="2 seeds for 3"):
        env.reset(seed=[1, 2])


def test_gymnasium_makes_it(recwarn: pytest.WarningsRecorder) -> None:
    register()
    for mode in MODES:
        env = gym.make_vec("dl2c/Model-v0", 3, model=MODEL, autoreset_mode=mode, max_episode_steps=5)
        assert isinstance(env, Dl2cVectorEnv)
        assert env.metadata["autoreset_mode"] == mode
        assert env.manifest.options["max_episode_steps"] == 5
        env.reset(seed=1)
        env.close()
        env.close()
    assert not recwarn.list


def test_a_pickled_one_behaves_the_same() -> None:
    import pickle

    env = Dl2cVectorEnv(MODEL, 3, autoreset_mode=AutoresetMode.SAME_STEP)
    twin = pickle.loads(pickle.dumps(env))
    results = []
    for e in (env, twin):
        e.reset(seed=4)
        results.append([e.step(np.array([2, 1, 0])) for _ in range(12)])
    assert data_equivalence(*results, exact=True)


def test_masks_and_states() -> None:
    env = Dl2cVectorEnv(MODEL, 2, render_mode="ansi")
    _, infos = env.reset(seed=1)
    assert (infos["action_mask"].dtype, infos["action_mask"].shape) == (np.int8, (2, 3))
    assert env.action_masks().dtype == np.bool_
    assert env.state(1).keys() == {"x", "k"}
    lines = env.render()
    assert lines is not None and len(lines) == 2
