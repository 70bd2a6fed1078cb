"""Observations standardised inside a policy. Imports torch: import it only where training happens."""

from collections.abc import Sequence

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor


class Standardised(BaseFeaturesExtractor):
    """Observations shifted by `center` and divided by `scale`, one number of each per entry.

    Part of the policy, so that a saved policy takes the environment's own observations.
    """

    def __init__(
        self, observation_space: spaces.Box, center: Sequence[float], scale: Sequence[float]
    ) -> None:
        super().__init__(  # pyright: ignore[reportUnknownMemberType] # Space without its parameter
            observation_space, len(center)
        )
        self._center = torch.as_tensor(center, dtype=torch.float32)
        self._scale = torch.as_tensor(scale, dtype=torch.float32)

    @property
    def moments(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Center and scale."""
        return self._center, self._scale

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Standardised observations, of the same shape."""
        return (observations - self._center) / self._scale
