"""MaskablePPO of sb3-contrib learns to stop close to an obstacle, and cannot hit it.

    python examples/train_maskable_ppo.py [STEPS]      (`pip install 'dl2c[train]'`; less than a minute)

The tests of the model are the mask of its actions, so whatever the network says, the robot does what was
proved safe: no episode violates `isSafe`, not even the first. What is left to learn is the task.
"""

import sys

import numpy as np
from sb3_contrib import MaskablePPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import dl2c

MODEL = "example:static_safety_line"


class Report(BaseCallback):
    """Prints what became of the episodes of each round."""

    def __init__(self) -> None:
        super().__init__()
        self.ended: list[tuple[bool, bool]] = []

    def _on_step(self) -> bool:
        infos = [info for info, done in zip(self.locals["infos"], self.locals["dones"], strict=True) if done]
        self.ended += [(info["is_success"], info["cost"] > 0) for info in infos]
        return True

    def _on_rollout_end(self) -> None:
        if self.ended:
            success, violations = np.mean(self.ended, axis=0)
            print(f"{self.num_timesteps:9} steps: success {success:6.1%}, violations {violations:.1%}")
        self.ended.clear()


def main(steps: int) -> None:
    """Train, then drive one episode and print it."""
    env = dl2c.make_sb3(MODEL, 64, max_episode_steps=400)
    env.seed(1)
    scaled = VecNormalize(VecMonitor(env), gamma=0.995)
    learner = MaskablePPO(
        "MlpPolicy",
        scaled,
        n_steps=128,
        batch_size=1024,
        n_epochs=6,
        learning_rate=1e-3,
        gamma=0.995,
        seed=1,
        device="cpu",
    )
    learner.learn(steps, callback=Report())  # finds the masks through `env.action_masks()`
    learner.save("static_safety_line.zip")

    single = dl2c.make(MODEL, max_episode_steps=400)
    observation, info = single.reset(seed=7)
    print("one episode:\n    time / s   speed / (m/s)   distance / m   action")
    ended = False
    while not ended:
        action, _ = learner.predict(
            scaled.normalize_obs(observation), deterministic=True, action_masks=single.action_masks()
        )
        observation, _, terminated, truncated, info = single.step(int(action))
        state, ended = single.state, terminated or truncated
        distance = state["xo"] - state["x"]
        print(f"{info['time']:12.2f} {state['v']:15.3f} {distance:14.3f}   {int(action)}")
    print(f"{info['status']}: {info['reason']}")
    single.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
