"""The network of a policy of PPO, fitted to what is wanted of it in many states.

Imports torch: import this module only where training happens.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy

from dl2c.training.lessons import Lesson, Teacher
from dl2c.training.states import Doubles

BATCH, RATE = 2048, 1e-2

STRICT = 3.0
"""How much more it counts that a request is admissible than that it is the one that is wanted."""

WORST = 0.05
"""The share of a batch whose mean error counts as much as that of all."""


@dataclass(frozen=True, slots=True)
class Pupil:
    """A policy of Stable-Baselines3 whose network is fitted to lessons of a teacher."""

    policy: Any
    teacher: Teacher
    rng: np.random.Generator
    idle: tuple[int, ...] = ()

    def ignore(self) -> None:
        """Make the network ignore the `idle` observations: they count as their centers."""
        with torch.no_grad():
            self.policy.mlp_extractor.policy_net[0].weight[:, list(self.idle)] = 0.0

    def outputs(self, observations: Doubles) -> Doubles:
        """What the network gives for observations (n, nobs)."""
        with torch.no_grad():
            return self._forward(observations).numpy().astype(np.float64)

    def fit(self, lesson: Lesson, steps: int) -> None:
        """Fit the network to a lesson, in so many steps."""
        parts = (lesson.wanted, lesson.fine, lesson.weight)
        wanted, fine, weight = (torch.as_tensor(_single(a)) for a in parts)
        trained = self.policy.mlp_extractor.policy_net, self.policy.action_net
        optimizer: Any = torch.optim.Adam([p for module in trained for p in module.parameters()], lr=RATE)
        schedule: Any = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        for _ in range(steps):
            rows = self.rng.integers(0, len(wanted), BATCH)
            far, wrong = self._errors(self._forward(lesson.observations[rows]), wanted[rows], fine[rows])
            worst = wrong.topk(max(1, int(WORST * BATCH))).values
            optimizer.zero_grad()
            error: Any = (weight[rows] * far).mean() + STRICT * (wrong.mean() + worst.mean())
            error.backward()
            optimizer.step()
            schedule.step()
            self.ignore()

    def _forward(self, observations: Doubles) -> torch.Tensor:
        given = torch.as_tensor(observations, dtype=torch.float32)
        features = self.policy.extract_features(given, self.policy.pi_features_extractor)
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))

    def _errors(
        self, outputs: torch.Tensor, wanted: torch.Tensor, fine: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """How far outputs are from what is wanted, and from what is admissible with a margin."""
        if self.teacher.question.requests:
            low, high = torch.as_tensor(_single(self.teacher.ends))
            size = torch.clamp(high - low, min=1e-12)
            return _beyond(outputs, wanted, size), _beyond(outputs, fine, size)
        scores = outputs[:, torch.as_tensor(self.teacher.winners)].sum(dim=2)
        best = scores.masked_fill(~fine, -torch.inf).amax(dim=1)
        other = scores.masked_fill(fine, -torch.inf).amax(dim=1)
        return cross_entropy(scores, wanted, reduction="none"), torch.relu(other - best + 1).square()


def _beyond(outputs: torch.Tensor, intervals: torch.Tensor, size: torch.Tensor) -> torch.Tensor:
    """The squared distances of outputs (n, m) from intervals (n, m, 2), summed up."""
    low, high = intervals[..., 0], intervals[..., 1]
    return ((torch.relu(low - outputs) + torch.relu(outputs - high)) / size).square().sum(dim=1)


def _single(values: Any) -> Any:
    """Doubles as torch's default."""
    return values.astype(np.float32) if values.dtype == np.float64 else values
