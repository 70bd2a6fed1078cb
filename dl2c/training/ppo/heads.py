"""How likely actions are by what a network gives, how uncertain they are, and the gradients of both. Imports
torch: import it only where training happens.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor, nn

IMPOSSIBLE = -1e8
"""The score of an alternative that a mask excludes, as in sb3-contrib."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Of each action, (n): the logarithm of its probability or density, and the entropy of what it was drawn
    from. `gradient` is that of the network's outputs, (outputs, n), given those of the logarithms, (n), and
    of the entropies, one number for all.
    """

    log_prob: Tensor
    entropy: Tensor
    gradient: Callable[[Tensor, float], Tensor]


@dataclass(frozen=True, slots=True)
class Categorical:
    """Alternatives of one or several decisions, so many of each; outputs are their scores."""

    counts: list[int]

    def drawn(self, scores: Tensor, masks: Tensor | None) -> Tensor:
        """Actions (n, decisions) at random, by scores (outputs, n) under masks (n, outputs)."""
        rows = torch.split(self._possible(scores, masks), self.counts)
        return torch.cat([torch.multinomial(torch.softmax(row, 0).t(), 1, True) for row in rows], 1)

    def _possible(self, scores: Tensor, masks: Tensor | None) -> Tensor:
        return scores if masks is None else scores.masked_fill(masks.t() == 0, IMPOSSIBLE)

    def judged(self, scores: Tensor, actions: Tensor, masks: Tensor | None) -> Judged:
        """Of actions (n, decisions), under masks (n, outputs) if there are any."""
        chosen = actions.long().t()
        rows = torch.split(self._possible(scores, masks), self.counts)
        logs = [torch.log_softmax(row, 0) for row in rows]
        chances = [log.exp() for log in logs]
        taken = [log.gather(0, chosen[k : k + 1]).squeeze(0) for k, log in enumerate(logs)]
        spread = [-(p * log).sum(0) for p, log in zip(chances, logs, strict=True)]

        def gradient(of_log_prob: Tensor, of_entropy: float) -> Tensor:
            parts: list[Tensor] = []
            for k, (p, log) in enumerate(zip(chances, logs, strict=True)):
                part = p * (-of_log_prob - of_entropy * (log + spread[k]))
                parts.append(part.scatter_add_(0, chosen[k : k + 1], of_log_prob.unsqueeze(0)))
            whole = parts[0] if len(parts) == 1 else torch.cat(parts)
            return whole if masks is None else whole.masked_fill_(masks.t() == 0, 0.0)

        return Judged(sum(taken[1:], taken[0]), sum(spread[1:], spread[0]), gradient)


@dataclass(frozen=True, slots=True)
class Gaussian:
    """Independent normal distributions, whose means are the outputs. The parameter's `grad` is written to."""

    log_deviation: nn.Parameter

    def drawn(self, means: Tensor, masks: Tensor | None) -> Tensor:
        """Actions (n, outputs) at random, by means (outputs, n); there are no masks."""
        del masks
        means = means.t()
        return means + torch.normal(torch.zeros_like(means), 1.0) * self.log_deviation.exp()

    def judged(self, means: Tensor, actions: Tensor, masks: Tensor | None) -> Judged:
        """Of actions (n, outputs); there are no masks."""
        del masks
        log_deviation = self.log_deviation.unsqueeze(1)
        deviation = log_deviation.exp()
        away = (actions.t() - means) / deviation
        log_prob = -(away.square() / 2 + log_deviation + math.log(2 * math.pi) / 2).sum(0)
        entropy = (log_deviation + (1 + math.log(2 * math.pi)) / 2).sum().expand(len(log_prob))

        def gradient(of_log_prob: Tensor, of_entropy: float) -> Tensor:
            assert self.log_deviation.grad is not None
            torch.sum((away.square() - 1) * of_log_prob + of_entropy, 1, out=self.log_deviation.grad)
            return away / deviation * of_log_prob

        return Judged(log_prob, entropy, gradient)


Head: TypeAlias = Categorical | Gaussian
