"""PPO with a Lagrange multiplier learns to keep the cost of its episodes within a budget.

    python examples/train_lagrangian.py [STEPS]        (`pip install 'dl2c[train]'`; twice a minute)

The room of thermostat.kyx without its tests, and all that its rewards ask for is little heating: that it is
too cold or too hot stands in `info["cost"]` alone. A policy that is not told of it lets the room freeze. Here
the cost of a step, times a multiplier, is subtracted from its reward. After each round of experience the
multiplier rises if episodes cost more than the budget, and falls if they cost less: gradient ascent on the
Lagrangian of "as much return as possible, within the budget".
"""

import sys
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor, VecNormalize

import dl2c
from dl2c.env.opening import source_of
from dl2c.source import Source
from dl2c.training.evaluation import mean

LENGTH = 240
"""Steps of an episode, of a minute each."""

BUDGET = 5.0
"""How many of them may be too cold or too hot, on average."""

RATE = 0.002
"""How much a step above or below the budget changes the multiplier."""

CHANGES = {
    "?after(x, cold) >= lo;": "",
    "?after(x, hot) <= hi;": "",
    "@safety: penalty=-100, on_failure=terminate:failure": "@safety",
    "-abs(x - goal) / 5 - 0.1 * (e - cold) / (hot - cold)": "-(e - cold) / (hot - cold)",
}


def heater() -> Source:
    """The thermostat without tests, where only heating is paid for, and the cost ends nothing."""
    text = source_of("example:thermostat").text
    for old, new in CHANGES.items():
        assert old in text
        text = text.replace(old, new)
    return Source("heater.kyx", text)


class Priced(VecEnvWrapper):
    """Subtracts the multiplier times the cost from rewards, and keeps the costs of a round of experience."""

    def __init__(self, venv: Any) -> None:
        super().__init__(venv)
        self.multiplier = 0.0
        self.costs: list[float] = []

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        costs = self.unwrapped.batch.cost  # `info["cost"]` of all environments
        self.costs.append(float(costs.mean()))
        return observations, rewards - self.multiplier * costs, dones, infos


class Ascent(BaseCallback):
    """Moves the multiplier after each round of experience."""

    def __init__(self, priced: Priced) -> None:
        super().__init__()
        self.priced = priced

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        excess = LENGTH * float(np.mean(self.priced.costs)) - BUDGET
        self.priced.multiplier = max(0.0, self.priced.multiplier + RATE * excess)
        self.priced.costs.clear()


def trained(steps: int, constrained: bool, seed: int = 1) -> tuple[PPO, VecNormalize, float]:
    """A policy, the statistics of its observations, and the multiplier in the end."""
    env = dl2c.make_sb3(heater(), 64, max_episode_steps=LENGTH)
    env.seed(seed)
    priced = Priced(VecMonitor(env))
    scaled = VecNormalize(priced, gamma=0.98)
    learner = PPO("MlpPolicy", scaled, n_steps=60, batch_size=960, gamma=0.98, seed=seed, device="cpu")
    learner.learn(steps, callback=Ascent(priced) if constrained else None)
    return learner, scaled, priced.multiplier


def episodes(learner: PPO, scaled: VecNormalize, n: int = 500) -> tuple[Any, Any]:
    """Return and cost of n episodes, one in each environment."""
    env = dl2c.make_sb3(heater(), n, max_episode_steps=LENGTH)
    env.seed(10**6)
    observations, returns, costs = env.reset(), np.zeros(n), np.zeros(n)
    for _ in range(LENGTH):
        actions, _ = learner.predict(scaled.normalize_obs(observations), deterministic=True)
        observations, rewards, _, _ = env.step(actions)
        returns += rewards
        costs += env.batch.cost
    env.close()
    return returns, costs


def main(steps: int) -> None:
    """Train without the constraint and with it, and compare."""
    for name, constrained in (("unconstrained", False), ("constrained", True)):
        learner, scaled, multiplier = trained(steps, constrained)
        found, cost = (mean(values).shown(".1f") for values in episodes(learner, scaled))
        print(f"{name}: cost per episode {cost}, return {found}, multiplier {multiplier:.2f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300_000)
