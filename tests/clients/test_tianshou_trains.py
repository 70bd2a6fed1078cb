"""One iteration of PPO and DQN of Tianshou, with masks and without. `make test-clients` runs this."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import dl2c
from dl2c.env.masked import env_creator

pytestmark = pytest.mark.slow
torch: Any = pytest.importorskip("torch")
pytest.importorskip("tianshou")

PENALTY = -1e6


def with_masks() -> "gym.Env[Any, Any]":
    """The thermostat, with observations as Tianshou's DQN looks for masks."""
    config = {"model": "example:thermostat", "masked": True, "blocked_penalty": PENALTY}
    env = env_creator(config)
    space = gym.spaces.Dict(
        {"obs": env.observation_space["observations"], "mask": gym.spaces.MultiBinary(2)}  # type: ignore[index]
    )
    return gym.wrappers.TransformObservation(
        env, lambda o: {"obs": o["observations"], "mask": o["action_mask"].astype(np.bool_)}, space
    )


class Net(torch.nn.Module):
    """Logits, or values, of observations that may hold a mask."""

    def __init__(self, inputs: int, outputs: int, masked: bool = True) -> None:
        super().__init__()
        self.net = torch.nn.Sequential(
            torch.nn.Linear(inputs, 32), torch.nn.Tanh(), torch.nn.Linear(32, outputs)
        )
        self.masked = masked

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        output = self.net(torch.as_tensor(getattr(obs, "obs", obs), dtype=torch.float32))
        if self.masked and hasattr(obs, "mask"):
            output = output.masked_fill(~torch.as_tensor(obs.mask), -1e9)
        return output, state


class Critic(Net):
    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        return super().forward(obs)[0]


class Gaussian(Net):
    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        mean, _ = super().forward(obs)
        return (mean, torch.ones_like(mean)), state


def normal(parameters: Any) -> Any:
    return torch.distributions.Independent(torch.distributions.Normal(*parameters), 1)


def policy_and_critic(env: Any) -> Any:
    from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy, ProbabilisticActorPolicy

    space, observed = env.action_space, env.observation_space
    size = (observed["obs"] if isinstance(observed, gym.spaces.Dict) else observed).shape[0]
    critic = Critic(size, 1, masked=False)
    if isinstance(space, gym.spaces.Discrete):
        return DiscreteActorPolicy(actor=Net(size, int(space.n)), action_space=space), critic
    actor = Gaussian(size, space.shape[0])
    return ProbabilisticActorPolicy(actor=actor, dist_fn=normal, action_space=space), critic


def trained(make: Any) -> Any:
    """The rewards of one iteration of PPO, which has changed the policy."""
    from tianshou.algorithm import PPO
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv
    from tianshou.trainer import OnPolicyTrainerParams

    policy, critic = policy_and_critic(make())
    algorithm = PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=1e-3))
    buffer = VectorReplayBuffer(256, 4)
    collector = Collector(algorithm, DummyVectorEnv([make] * 4), buffer)
    before = policy.actor.net[0].weight.detach().clone()
    kept: list[Any] = []
    collect = collector.collect

    def keeping(*args: Any, **kwargs: Any) -> Any:
        stats = collect(*args, **kwargs)
        kept.append(buffer.sample(0)[0].rew.copy())
        return stats

    collector.collect = keeping  # the buffer is emptied after each update
    found = algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=256,
            collection_step_num_env_steps=256,
            verbose=False,
            show_progress=False,
        )
    )
    assert found.train_step == 256
    assert not torch.equal(policy.actor.net[0].weight, before)
    return np.concatenate(kept)


@pytest.mark.parametrize("model", ["example:waypoint", "example:dubins"])
def test_ppo_trains(model: str) -> None:
    """On discrete and on continuous actions."""
    assert np.isfinite(trained(lambda: dl2c.make(model))).all()


def test_ppo_trains_with_masks() -> None:
    """A request that the mask excludes would show among the rewards."""
    rewards = trained(with_masks)
    assert len(rewards) == 256 and rewards.min() > PENALTY


def test_dqn_finds_the_masks() -> None:
    """By itself: its observations have them as `mask`, for greedy and for random actions."""
    from tianshou.algorithm import DQN
    from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv
    from tianshou.trainer import OffPolicyTrainerParams

    env = with_masks()
    model = Net(env.observation_space["obs"].shape[0], 2, masked=False)  # type: ignore[index]
    policy = DiscreteQLearningPolicy(
        model=model, action_space=env.action_space, observation_space=env.observation_space, eps_training=0.5
    )
    algorithm = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3))
    buffer = VectorReplayBuffer(512, 4)
    collector = Collector(algorithm, DummyVectorEnv([with_masks] * 4), buffer, exploration_noise=True)
    before = model.net[0].weight.detach().clone()
    algorithm.run_training(
        OffPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=256,
            collection_step_num_env_steps=64,
            verbose=False,
            show_progress=False,
        )
    )
    assert not torch.equal(model.net[0].weight, before)
    assert len(buffer) == 256 and buffer.rew[: len(buffer)].min() > PENALTY
