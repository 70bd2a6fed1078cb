"""One iteration of PPO of skrl, with masks and without. `make test-clients` runs this."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

import dl2c
from dl2c.env.masked import env_creator

pytestmark = pytest.mark.slow
torch: Any = pytest.importorskip("torch")
pytest.importorskip("skrl")

PENALTY = -1e6
ROLLOUT = 64


def layers(inputs: int, outputs: int) -> Any:
    return torch.nn.Sequential(torch.nn.Linear(inputs, 32), torch.nn.Tanh(), torch.nn.Linear(32, outputs))


def models(env: Any) -> dict[str, Any]:
    """A policy that gives no probability to what a mask excludes, and a value."""
    from skrl.models.torch import CategoricalMixin, DeterministicMixin, GaussianMixin, Model
    from skrl.utils.spaces.torch import unflatten_tensorized_space

    discrete = isinstance(env.action_space, gym.spaces.Discrete)

    class Policy(CategoricalMixin if discrete else GaussianMixin, Model):  # type: ignore[misc]
        def __init__(self) -> None:
            Model.__init__(self, observation_space=env.observation_space, action_space=env.action_space)
            if discrete:
                CategoricalMixin.__init__(self)
            else:
                GaussianMixin.__init__(self, clip_actions=True)
                self.log_std = torch.nn.Parameter(torch.zeros(self.num_actions))
            self.net = layers(self.num_observations, self.num_actions)

        def compute(self, inputs: Any, role: str) -> Any:
            output = self.net(inputs["observations"])
            if isinstance(self.observation_space, gym.spaces.Dict):
                parts = unflatten_tensorized_space(self.observation_space, inputs["observations"])
                output = output.masked_fill(parts["action_mask"] == 0, -1e9)
            return output, {} if discrete else {"log_std": self.log_std}

    class Value(DeterministicMixin, Model):
        def __init__(self) -> None:
            Model.__init__(self, observation_space=env.observation_space, action_space=env.action_space)
            DeterministicMixin.__init__(self)
            self.net = layers(self.num_observations, 1)

        def compute(self, inputs: Any, role: str) -> Any:
            return self.net(inputs["observations"]), {}

    return {"policy": Policy(), "value": Value()}


def trained(env: Any, folder: Path) -> Any:
    """The rewards of one iteration, which has changed the policy."""
    from skrl.agents.torch.ppo import PPO
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.memories.torch import RandomMemory
    from skrl.trainers.torch import SequentialTrainer

    wrapped = wrap_env(env)
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=wrapped.num_envs)
    agent = PPO(
        models=models(wrapped),
        memory=memory,
        observation_space=wrapped.observation_space,
        action_space=wrapped.action_space,
        cfg={"rollouts": ROLLOUT, "learning_epochs": 1},
    )
    agent.cfg.experiment.directory = str(folder)
    before = agent.policy.net[0].weight.detach().clone()
    settings = {"timesteps": ROLLOUT, "headless": True, "disable_progressbar": True}
    SequentialTrainer(env=wrapped, agents=agent, cfg=settings).train()
    assert not torch.equal(agent.policy.net[0].weight, before)
    return memory.get_tensor_by_name("rewards")


@pytest.mark.parametrize("model", ["example:waypoint", "example:dubins"])
def test_ppo_trains(model: str, tmp_path: Path) -> None:
    """On discrete and on continuous actions, in a native vector environment."""
    rewards = trained(dl2c.make_vec(model, 4, autoreset_mode="SameStep"), tmp_path)
    assert rewards.shape[:2] == (ROLLOUT, 4) and torch.isfinite(rewards).all()


def test_ppo_trains_with_masks(tmp_path: Path) -> None:
    """A request that the mask excludes would show among the rewards."""
    config = {"model": "example:thermostat", "masked": True, "blocked_penalty": PENALTY}
    env = gym.vector.SyncVectorEnv(
        [lambda: env_creator(config)] * 4, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP
    )
    assert trained(env, tmp_path).min() > PENALTY
