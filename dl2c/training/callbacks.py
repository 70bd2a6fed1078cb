"""What happens while Stable-Baselines3 learns: the learning curve, evaluations, checkpoints, the end.

Imports stable_baselines3: import this module only where training happens.
"""

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback

from dl2c.training.run import Point, Progress

if TYPE_CHECKING:
    from dl2c.training.folders import Training


class Every(BaseCallback):
    """Does something each time so many further steps have been made."""

    def __init__(self, steps: int, action: Callable[[], None]) -> None:
        super().__init__()
        self._steps, self._action = steps, action
        self._next = 0

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps // self._steps + 1

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._next * self._steps:
            self._next = self.num_timesteps // self._steps + 1
            self._action()
        return True


class Watch(BaseCallback):
    """Adds a point to the learning curve after each round of experience of at least `least` steps, tells
    `progress` and TensorBoard, and ends the training once `stopped` is set.
    """

    def __init__(
        self, training: "Training", progress: Progress | None, stopped: threading.Event, least: int
    ) -> None:
        super().__init__()
        self._training, self._progress, self._stopped, self._least = training, progress, stopped, least
        self._blocked = np.zeros(training.env.num_envs, np.bool_)
        self._ended: list[tuple[bool, bool, bool, float]] = []
        self._began, self._first, self._last = 0.0, 0, 0

    def _on_training_start(self) -> None:
        self._began, self._first, self._last = time.perf_counter(), self.num_timesteps, self.num_timesteps

    def _on_step(self) -> bool:
        self._blocked |= self._training.env.batch.blocked
        dones: NDArray[np.bool_] = self.locals["dones"]
        for i in np.flatnonzero(dones).tolist():
            info = self.locals["infos"][i]
            blocked, total = bool(self._blocked[i]), float(info["episode"]["r"])
            self._ended.append((info["is_success"], info["cost"] > 0, blocked, total))
        self._blocked &= ~dones
        return not self._stopped.is_set()

    def _on_rollout_end(self) -> None:
        if self.num_timesteps - self._last < self._least:
            return
        self._last = self.num_timesteps
        n = len(self._ended)
        rates = np.mean(self._ended, axis=0) if n else np.full(4, np.nan)
        success, violations, blocked, total = (float(r) for r in rates)
        speed = (self.num_timesteps - self._first) / (time.perf_counter() - self._began)
        point = Point(self.num_timesteps, n, success, violations, blocked, total, speed)
        self._ended.clear()
        self._training.curve.append(point)
        if n:
            for name in ("success", "violations", "blocked"):
                self.logger.record(f"dl2c/{name}", getattr(point, name))
        if self._progress is not None:
            self._progress(point)
