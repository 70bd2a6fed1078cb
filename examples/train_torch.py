"""PPO with action masks in plain PyTorch, in one file, as CleanRL writes it.

    python examples/train_torch.py [STEPS]                        (`pip install 'dl2c[train]'`)

`dl2c.make_vec` is a Gymnasium VectorEnv that steps all environments in one C call; the masks of
`envs.action_masks()` are applied to the logits.
"""

import sys
import time

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import nn
from torch.distributions import Categorical

import dl2c

MODEL = "example:static_safety_line"
SEED, ENVS, ROUND, EPOCHS, BATCHES = 1, 64, 128, 4, 8
RATE, GAMMA, LAMBDA, CLIP, ENTROPY, VALUE = 1e-3, 0.995, 0.95, 0.2, 0.003, 0.5
REWARD = 0.01  # rewards times this are of the order of 1


def network(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    """Two hidden layers; the last one starts near zero where `gain` is small."""
    layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
    nn.init.orthogonal_(layers[-1].weight, gain)
    return nn.Sequential(*layers)


class Agent(nn.Module):
    """Actor and critic, which see observations scaled to [-1, 1]."""

    def __init__(self, space, actions: int) -> None:
        super().__init__()
        self.center, self.scale = (torch.as_tensor((space.high + s * space.low) / 2) for s in (1, -1))
        self.actor, self.critic = network(space.shape[0], actions, 0.01), network(space.shape[0], 1, 1.0)

    def policy(self, obs: torch.Tensor, masks: torch.Tensor) -> Categorical:
        """A distribution that gives masked actions no probability."""
        return Categorical(logits=self.actor((obs - self.center) / self.scale).masked_fill(~masks, -1e9))

    def value(self, obs: torch.Tensor) -> torch.Tensor:
        """Rewards still to come."""
        return self.critic((obs - self.center) / self.scale)[:, 0]


@torch.no_grad()
def experience(agent: Agent, envs, obs: torch.Tensor):
    """ROUND steps of every environment, how their episodes ended, and the observations to go on from."""
    kept, ended = [], []
    for _ in range(ROUND):
        mask = torch.as_tensor(envs.action_masks())
        choice = agent.policy(obs, mask)
        action = choice.sample()
        following, reward, terminated, truncated, infos = envs.step(action.numpy())
        reward, done = torch.as_tensor(reward * REWARD, dtype=torch.float32), terminated | truncated
        if truncated.any():  # a cut episode would have gone on: add what its last state is worth
            last = torch.as_tensor(np.stack(infos["final_obs"][truncated]))
            reward[torch.as_tensor(truncated)] += GAMMA * agent.value(last)
        if done.any():
            final = infos["final_info"]
            ended += zip(final["is_success"][done], final["cost"][done] > 0, strict=True)
        kept.append(
            (obs, mask, action, choice.log_prob(action), agent.value(obs), reward, np.float32(1) - done)
        )
        obs = torch.as_tensor(following)
    return [torch.stack(list(map(torch.as_tensor, x))) for x in zip(*kept, strict=True)], ended, obs


def advantages_of(values: torch.Tensor, rewards: torch.Tensor, going: torch.Tensor, following: torch.Tensor):
    """Generalised advantage estimation."""
    advantages, running = torch.zeros_like(rewards), torch.zeros(ENVS)
    for k in reversed(range(ROUND)):
        delta = rewards[k] + GAMMA * following * going[k] - values[k]
        advantages[k] = running = delta + GAMMA * LAMBDA * going[k] * running
        following = values[k]
    return advantages


def learn(agent: Agent, optimizer: torch.optim.Optimizer, batch: list[torch.Tensor]) -> None:
    """The update of PPO."""
    for _ in range(EPOCHS):
        for index in torch.randperm(ENVS * ROUND).chunk(BATCHES):
            obs, masks, actions, logs, advantages, returns = (x[index] for x in batch)
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
            policy = agent.policy(obs, masks)
            ratio = (policy.log_prob(actions) - logs).exp()
            gain = torch.min(ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages)
            misfit = (agent.value(obs) - returns).square().mean()
            loss = -gain.mean() + VALUE * misfit - ENTROPY * policy.entropy().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()


def main(steps: int) -> None:
    """Train, and print the success rate of every round."""
    torch.manual_seed(SEED)
    torch.set_num_threads(1)
    envs = dl2c.make_vec(MODEL, ENVS, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=400)
    agent = Agent(envs.single_observation_space, int(envs.single_action_space.n))
    optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)
    obs, began = torch.as_tensor(envs.reset(seed=SEED)[0]), time.perf_counter()
    for number in range(1, max(1, steps // (ENVS * ROUND)) + 1):
        (*seen, values, rewards, going), ended, obs = experience(agent, envs, obs)
        with torch.no_grad():
            advantages = advantages_of(values, rewards, going, agent.value(obs))
        learn(agent, optimizer, [x.flatten(0, 1) for x in (*seen, advantages, advantages + values)])
        success, violations = np.mean(ended, axis=0) if ended else (np.nan, np.nan)
        speed = number * ENVS * ROUND / (time.perf_counter() - began)
        print(f"round {number}: success {success:.1%}, violations {violations:.1%}, {speed:,.0f} steps/s")
    envs.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
