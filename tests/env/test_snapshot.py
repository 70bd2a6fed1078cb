"""Snapshots: what follows one depends on it and the actions alone, whatever happened in between."""

import math
import pickle
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import dl2c

pytestmark = pytest.mark.usefixtures("unoptimised")

MODELS = ["waypoint", "static_safety", "dubins", "bouncing_ball"]
CHANCE = """Theorem "chance"
ProgramVariables
  /* @var: bound=[-9:9] */ Real x;
  Real u;
End.
Problem
  x = 0 -> [{
    /* @choice: role=env */ { x := x + 1; ++ x := x - 1; }
    { u := 1; ++ u := 2; }
    {x' = u & x <= 9}
  }*] true
End.
End.
"""
"""The environment decides before the agent, when the step before returns."""


def play(env: Any, actions: list[Any]) -> list[Any]:
    """What steps return, up to the end of the episode."""
    seen: list[Any] = []
    for action in actions:
        seen.append(env.step(action))
        if seen[-1][2] or seen[-1][3]:
            break
    return seen


def same(one: list[Any], other: list[Any]) -> bool:
    """Equal to the bit, where NaN, which stands for what chance did not decide, equals NaN."""
    return data_equivalence(numbered(tuple(one)), numbered(tuple(other)), exact=True)


def numbered(value: Any) -> Any:
    match value:
        case dict():
            return {key: numbered(part) for key, part in value.items()}
        case tuple():
            return tuple(map(numbered, value))
        case float() if math.isnan(value):
            return "NaN"
        case _:
            return value


@pytest.mark.parametrize("model", [*(f"example:{m}" for m in MODELS), CHANCE])
def test_what_follows_a_snapshot_is_always_the_same(model: str) -> None:
    env = dl2c.make(model, max_episode_steps=40)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(60)]
    for seed in range(3):
        env.reset(seed=seed)
        play(env, actions[:7])
        kept = env.save()
        first = play(env, actions[7:])
        env.reset(seed=77)
        play(env, actions[:11])
        obs, info = env.restore(kept)
        assert np.array_equal(obs, env.observation_space.low) or env.observation_space.contains(obs)
        assert ("action_mask" in info) == bool(env.manifest.choices)
        assert env.state == kept.state
        assert same(play(env, actions[7:]), first)
        other = dl2c.make(model, max_episode_steps=40)
        other.restore(pickle.loads(pickle.dumps(kept)))
        assert same(play(other, actions[7:]), first)
        env.restore(kept)


@pytest.mark.parametrize("model", ["example:waypoint", CHANCE])
def test_a_transition_is_a_function_and_leaves_the_episode_alone(model: str) -> None:
    env, planner = dl2c.make(model), dl2c.make(model)
    env.action_space.seed(2)
    env.reset(seed=4)
    path = [env.save()]
    rewards: list[float] = []
    for _ in range(20):
        action = env.action_space.sample()
        ahead = planner.transition(path[-1], action)
        for _ in range(3):
            planner.transition(path[0], env.action_space.sample())
        assert same([ahead[1:]], [env.transition(path[-1], action)[1:]])
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        assert same([ahead[1:]], [(reward, terminated, truncated, info)])
        assert ahead[0] == env.save()
        path.append(env.save())
        if terminated or truncated:
            break
    assert len(path) > 5 and all(a != b for a, b in pairwise(path))
    with pytest.raises(gym.error.ResetNeeded):
        planner.step(env.action_space.sample())


def test_an_ended_episode_stays_ended() -> None:
    env = dl2c.make("example:waypoint", max_episode_steps=2)
    env.reset(seed=1)
    running = env.save()
    assert not running.ended
    while True:
        _, _, terminated, truncated, _ = env.step(0)
        if terminated or truncated:
            break
    over = env.save()
    assert over.ended
    env.reset(seed=2)
    env.restore(over)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(0)
    with pytest.raises(gym.error.ResetNeeded):
        env.transition(over, 0)


def test_environments_of_a_batch_exchange_places() -> None:
    envs = dl2c.make_vec("example:waypoint", 3, autoreset_mode="SameStep")
    envs.reset(seed=5)
    actions = np.zeros(envs.action_space.shape, np.int64)
    envs.step(actions)
    a, b = envs.save(0), envs.save(2)
    envs.restore(0, b)
    envs.restore(2, a)
    swapped = envs.step(actions)
    envs.restore(0, a)
    envs.restore(2, b)
    straight = envs.step(actions)
    for one, other in zip(swapped[:4], straight[:4], strict=True):
        assert np.array_equal(one[[2, 0]], other[[0, 2]])


def test_snapshots_of_other_builds_are_refused() -> None:
    env, other = dl2c.make("example:waypoint"), dl2c.make("example:waypoint", obs_dtype="float64")
    other.reset(seed=1)
    with pytest.raises(gym.error.ResetNeeded):
        env.save()
    with pytest.raises(ValueError, match="another build"):
        env.restore(other.save())
