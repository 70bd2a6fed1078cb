"""PPO in closed form against automatic differentiation in Stable-Baselines3."""

from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv

from dl2c.training.activations import Tanh
from dl2c.training.ppo.update import closed_form, known

contrib = pytest.importorskip("sb3_contrib")

SPACES: tuple[spaces.Space[Any], ...] = (
    spaces.Discrete(1),
    spaces.Discrete(4),
    spaces.MultiDiscrete([3, 2, 4]),
    spaces.Box(-1.0, 1.0, (1,)),
    spaces.Box(-1.0, 1.0, (3,)),
)
ACTIVATIONS = (Tanh, torch.nn.Tanh, torch.nn.ReLU, torch.nn.ELU, torch.nn.Sigmoid)

ROUNDING = 2e-5
"""Of single precision in a few steps of the optimiser, relative to the largest change of a parameter."""


class Noise(gym.Env[Any, Any]):
    """Observations, rewards, ends and masks that are random."""

    def __init__(self, action_space: Any, seed: int) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float64)
        self.action_space = self._actions = action_space
        self._rng = np.random.default_rng(seed)

    def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
        return self._rng.normal(size=3), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        del action
        over = self._rng.random(2) < 0.1
        return self._rng.normal(size=3), float(self._rng.normal()), bool(over[0]), bool(over[1]), {}

    def action_masks(self) -> Any:
        counts = getattr(self._actions, "nvec", None)
        groups: Any = [self._actions.n] if counts is None else counts
        return np.concatenate([self._some(int(n)) for n in groups])

    def _some(self, count: int) -> NDArray[np.bool_]:
        """At least one of so many."""
        return (self._rng.random(count) < 0.5) | (np.arange(count) == self._rng.integers(count))


class Told(DummyVecEnv):
    """Noise that says where there is a decision: where the first entry of the observation is positive."""

    def decides(self) -> NDArray[np.bool_]:
        return self.buf_obs[None][:, 0] > 0


class OnlyDecisions(BaseCallback):
    """Leaves Stable-Baselines3 to learn, in one minibatch a round, from decisions alone."""

    def __init__(self, normal: bool) -> None:
        super().__init__()
        self._normal = normal

    def _on_rollout_end(self) -> None:
        buffer: Any = self.model.rollout_buffer  # pyright: ignore # an algorithm has one here
        decided = buffer.observations[:, :, 0] > 0
        made = buffer.advantages[decided]
        if self._normal and len(made) > 1:
            made = (made - made.mean()) / made.std(ddof=1)
        buffer.advantages[:] = 0.0
        buffer.advantages[decided] = made

    def _on_step(self) -> bool:
        return True


def learned(kind: Any, env: Noise, **hyper: Any) -> tuple[Any, dict[str, torch.Tensor], dict[str, float]]:
    """A learner after one round, its parameters, and what it told its logger."""
    learner = kind("MlpPolicy", env, seed=3, device="cpu", **hyper)
    learner.learn(hyper["n_steps"])
    return learner, learner.policy.state_dict(), dict(learner.logger.name_to_value)


def compare(kind: Any, space: spaces.Space[Any], seed: int, **hyper: Any) -> None:
    before = kind("MlpPolicy", Noise(space, seed), seed=3, device="cpu", **hyper).policy.state_dict()
    other, wanted, told = learned(kind, Noise(space, seed), **hyper)
    own, found, said = learned(closed_form(kind), Noise(space, seed), **hyper)
    assert known(own.policy) is not None
    assert own._n_updates == other._n_updates
    moved = max(float((wanted[name] - before[name]).abs().max()) for name in wanted)
    assert moved > 1e-4
    for name in wanted:
        assert torch.allclose(found[name], wanted[name], rtol=0.0, atol=ROUNDING * max(1.0, moved)), name
    trained = {name: value for name, value in told.items() if name.startswith("train/")}
    assert {name: value for name, value in said.items() if name.startswith("train/")} == pytest.approx(
        trained, rel=1e-3, abs=1e-5, nan_ok=True
    )


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    space=st.sampled_from(SPACES),
    activation=st.sampled_from(ACTIVATIONS),
    layers=st.sampled_from(([], [5], [8, 6], [4, 4, 4])),
    batch_size=st.sampled_from((16, 24, 64)),
    normal=st.booleans(),
)
def test_as_much_is_learned(
    seed: int, space: Any, activation: Any, layers: list[int], batch_size: int, normal: bool
) -> None:
    policy = {"net_arch": layers, "activation_fn": activation}
    compare(
        PPO,
        space,
        seed,
        policy_kwargs=policy,
        n_steps=64,
        batch_size=batch_size,
        n_epochs=2,
        ent_coef=0.1,
        normalize_advantage=normal,
    )


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), space=st.sampled_from(SPACES[1:3]))
def test_as_much_is_learned_under_masks(seed: int, space: Any) -> None:
    compare(contrib.MaskablePPO, space, seed, n_steps=64, batch_size=24, n_epochs=2, ent_coef=0.1)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    space=st.sampled_from(SPACES[1:]),
    steps=st.sampled_from((2, 3, 32)),
    normal=st.booleans(),
)
def test_only_decisions_teach_the_policy(seed: int, space: Any, steps: int, normal: bool) -> None:
    """Rounds with no, one or many decisions; the values are learned from all steps."""
    hyper = {"n_steps": steps, "batch_size": steps, "n_epochs": 2, "seed": 3}
    found: list[dict[str, torch.Tensor]] = []
    for kind, ready, callback in (
        (PPO, False, OnlyDecisions(normal)),
        (closed_form(PPO), normal, None),
    ):
        env = Told([partial(Noise, space, seed)])
        learner = kind("MlpPolicy", env, normalize_advantage=ready, device="cpu", **hyper)
        learner.learn(2 * steps, callback=callback)
        found.append(learner.policy.state_dict())
    for name in found[0]:
        assert torch.allclose(found[1][name], found[0][name], rtol=0.0, atol=ROUNDING), name


@pytest.mark.parametrize("special", [{"target_kl": 1e-3}, {"clip_range_vf": 0.1}, {"use_sde": True}])
@pytest.mark.parametrize("make", [Noise, lambda space, seed: Told([partial(Noise, space, seed)])])
def test_what_is_not_known_is_left_to_the_library(make: Any, special: dict[str, Any]) -> None:
    hyper = {"n_steps": 64, "batch_size": 32, "n_epochs": 2} | special
    _, wanted, _ = learned(PPO, make(SPACES[3], 0), **hyper)
    _, found, _ = learned(closed_form(PPO), make(SPACES[3], 0), **hyper)
    for name in wanted:
        assert torch.equal(found[name], wanted[name])


def test_other_networks_are_not_known() -> None:
    def parts(**policy: Any) -> Any:
        return known(PPO("MlpPolicy", Noise(SPACES[1], 0), policy_kwargs=policy, device="cpu").policy)

    assert parts() is not None
    assert parts(activation_fn=torch.nn.LeakyReLU) is None
    assert parts(share_features_extractor=False) is None
    assert parts(net_arch={"pi": [4], "vf": [4, 4]}) is not None


@pytest.mark.parametrize("special", [{}, {"target_kl": 1e3}])
def test_epochs_fall_with_what_is_left(special: dict[str, Any], tmp_path: Path) -> None:
    """After rounds that leave 3/4, 1/2, 1/4 and nothing, of four epochs at first; saved learners go on so."""
    made: list[int] = []

    class Count(BaseCallback):
        def _on_rollout_start(self) -> None:
            made.append(self.model._n_updates)

        def _on_step(self) -> bool:
            return True

    kind = closed_form(PPO)
    learner = kind("MlpPolicy", Noise(SPACES[3], 0), n_steps=8, batch_size=8, n_epochs=4, **special)
    learner.tapered = True
    learner.learn(32, callback=Count())
    assert np.diff([*made, learner._n_updates]).tolist() == [3, 2, 1, 1]
    assert learner.n_epochs == 4
    learner.save(tmp_path / "learner.zip")
    assert kind.load(tmp_path / "learner.zip").tapered
    assert not kind("MlpPolicy", Noise(SPACES[3], 0)).tapered
