"""PPO of Stable-Baselines3 learns the guards of the waypoint model by itself.

    python examples/train_ppo.py [STEPS]        (`pip install 'dl2c[train]'`; two million steps: some minutes)

The agent sees no masks. While it learns, a request whose guard fails costs 1000, and the robot does what is
possible instead; when it is tested, such a request ends the episode. Nothing here is special to dl2c except
for the first two lines of `main`, so any algorithm of Stable-Baselines3 can take PPO's place.
"""

import sys
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import dl2c

MODEL = "example:waypoint"


class Report(BaseCallback):
    """Prints how many of the last episodes met no guard that failed."""

    def __init__(self) -> None:
        super().__init__()
        self.clean: list[bool] = []

    def _on_training_start(self) -> None:
        self.running = np.ones(self.training_env.num_envs, bool)

    def _on_step(self) -> bool:
        rewards, dones = self.training_env.get_original_reward(), self.locals["dones"]
        self.running &= rewards > -1000
        self.clean += self.running[dones].tolist()
        self.running |= dones
        return True

    def _on_rollout_end(self) -> None:
        if self.clean and self.n_calls % 800 == 0:
            rate = np.mean(self.clean[-1000:])
            print(f"{self.num_timesteps:9} steps: {rate:6.1%} of episodes without a failed guard")


def main(steps: int) -> None:
    """Train, and test without mercy."""
    env = dl2c.make_sb3(MODEL, 256, on_blocked="fallback", blocked_penalty=-1000.0)
    env.seed(1)

    # Observations are metres, seconds, metres per second: normalise them, and the rewards.
    scaled = VecNormalize(VecMonitor(env), gamma=0.01)
    learner = PPO(
        "MlpPolicy",
        scaled,
        n_steps=8,
        batch_size=512,
        n_epochs=3,
        learning_rate=lambda left: 3e-3 * left,
        gamma=0.01,  # whether a guard fails is known at once
        gae_lambda=0.0,
        ent_coef=0.003,
        seed=1,
        device="cpu",
    )
    learner.learn(steps, callback=Report())
    learner.save("waypoint_ppo.zip")
    print(f"{success(learner, scaled):.1%} of 500 new episodes reach the goal area in time")


def success(learner: Any, scaled: VecNormalize, episodes: int = 500) -> float:
    """The fraction of episodes that succeed, one in each environment."""
    env = dl2c.make_sb3(MODEL, episodes, on_blocked="terminate")
    env.seed(10**6)
    observations, succeeded = env.reset(), np.full(episodes, -1)
    while (succeeded < 0).any():
        actions, _ = learner.predict(scaled.normalize_obs(observations), deterministic=True)
        observations, _, dones, infos = env.step(actions)
        for i in np.flatnonzero(dones & (succeeded < 0)):
            succeeded[i] = infos[i]["is_success"]
    env.close()
    return float(succeeded.mean())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2_000_000)
