"""PPO with action masks in plain PyTorch, in one file, as CleanRL writes it.

    python examples/train_torch.py [STEPS]                        (`pip install 'dl2c[train]'`)

`dl2c.make_vec` is a Gymnasium VectorEnv that steps all environments in one C call. Masks are in
`env.action_masks()` and in `infos["action_mask"]`; here they are applied to the logits.
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
    for layer in layers[::2]:
        nn.init.orthogonal_(layer.weight, gain if layer is layers[-1] else 2**0.5)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers)


def main(steps: int) -> None:
    """Train and print the success rate of every round."""
    torch.manual_seed(SEED)
    torch.set_num_threads(1)
    envs = dl2c.make_vec(MODEL, ENVS, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=400)
    space = envs.single_observation_space
    center, scale = (torch.as_tensor(x) for x in ((space.high + space.low) / 2, (space.high - space.low) / 2))
    actor = network(space.shape[0], envs.single_action_space.n, 0.01)
    critic = network(space.shape[0], 1, 1.0)
    parameters = [*actor.parameters(), *critic.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=RATE, eps=1e-5)

    def policy(obs: torch.Tensor, masks: torch.Tensor) -> Categorical:
        return Categorical(logits=actor(obs).masked_fill(~masks, -1e9))

    def scaled(raw: np.ndarray) -> torch.Tensor:
        return (torch.as_tensor(raw) - center) / scale

    obs, mask = scaled(envs.reset(seed=SEED)[0]), torch.as_tensor(envs.action_masks())
    began, rounds = time.perf_counter(), max(1, steps // (ENVS * ROUND))
    for number in range(1, rounds + 1):
        kept, ended = [], []
        for _ in range(ROUND):  # experience
            with torch.no_grad():
                choice = policy(obs, mask)
                action = choice.sample()
                value, log = critic(obs)[:, 0], choice.log_prob(action)
            raw, reward, terminated, truncated, infos = envs.step(action.numpy())
            reward, done = torch.as_tensor(reward * REWARD, dtype=torch.float32), terminated | truncated
            if truncated.any():  # a cut episode would have gone on: add what its last state is worth
                last = scaled(np.stack(infos["final_obs"][truncated]))
                with torch.no_grad():
                    reward[torch.as_tensor(truncated)] += GAMMA * critic(last)[:, 0]
            if done.any():
                final = infos["final_info"]
                ended += list(zip(final["is_success"][done], final["cost"][done] > 0, strict=True))
            kept.append((obs, mask, action, log, value, reward, torch.as_tensor(done).float()))
            obs, mask = scaled(raw), torch.as_tensor(envs.action_masks())
        seen, masks, actions, logs, values, rewards, dones = (torch.stack(x) for x in zip(*kept, strict=True))

        advantages, running = torch.zeros_like(rewards), torch.zeros(ENVS)
        with torch.no_grad():
            following = critic(obs)[:, 0]
        for k in reversed(range(ROUND)):  # generalised advantage estimation
            delta = rewards[k] + GAMMA * following * (1 - dones[k]) - values[k]
            advantages[k] = running = delta + GAMMA * LAMBDA * (1 - dones[k]) * running
            following = values[k]
        batch = [x.flatten(0, 1) for x in (seen, masks, actions, logs, advantages, advantages + values)]

        for _ in range(EPOCHS):  # learning
            for index in torch.randperm(ENVS * ROUND).chunk(BATCHES):
                seen, masks, actions, logs, advantages, returns = (x[index] for x in batch)
                advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
                now = policy(seen, masks)
                ratio = (now.log_prob(actions) - logs).exp()
                gain = torch.min(ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages)
                misfit = (critic(seen)[:, 0] - returns).square().mean()
                loss = -gain.mean() + VALUE * misfit - ENTROPY * now.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(parameters, 0.5)
                optimizer.step()

        success, violations = np.mean(ended, axis=0) if ended else (np.nan, np.nan)
        speed = number * ENVS * ROUND / (time.perf_counter() - began)
        print(f"round {number}: success {success:.1%}, violations {violations:.1%}, {speed:,.0f} steps/s")
    envs.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
