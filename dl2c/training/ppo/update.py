"""How a policy learns from a round of experience. Imports torch: import it only where training happens."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from math import ceil
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.distributions import (
    CategoricalDistribution,
    DiagGaussianDistribution,
    MultiCategoricalDistribution,
)
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.utils import explained_variance
from torch import Tensor, nn

from dl2c.training.ppo.heads import Categorical, Gaussian, Head
from dl2c.training.ppo.networks import Perceptron, perceptron
from dl2c.training.standardised import Standardised

STATISTICS = ("entropy_loss", "policy_gradient_loss", "value_loss", "approx_kl", "clip_fraction", "loss")
"""What is computed of each minibatch, by the names of Stable-Baselines3; the actor's over its decisions."""


@dataclass(frozen=True, slots=True)
class Policy:
    """The parts of a policy of which gradients are known."""

    actor: Perceptron
    critic: Perceptron
    head: Head
    gradients: Tensor
    """Of all parameters, one after the other: each one's `grad` is a part of it."""


@dataclass(frozen=True, slots=True)
class Weights:
    """Of the terms of the loss; and the limits of the ratio of probabilities and the norm of the gradient."""

    entropy: float
    value: float
    clip: float
    most: float


@dataclass(frozen=True, slots=True)
class Batch:
    """Steps to learn from, (n, ...) or (n)."""

    observations: Tensor
    actions: Tensor
    masks: Tensor | None
    log_prob: Tensor
    advantages: Tensor
    returns: Tensor
    decided: Tensor | None
    """Where the policy had a decision to take; None where it always had."""

    def parts(self, size: int) -> Iterator["Batch"]:
        """So many steps each; the last one may have fewer."""
        for first in range(0, len(self.returns), size):
            yield self._some(slice(first, first + size))

    def decisions(self) -> "Batch":
        """The steps with a decision."""
        return self if self.decided is None else self._some(self.decided)

    def _some(self, steps: slice | Tensor) -> "Batch":
        return Batch(
            self.observations[steps],
            self.actions[steps],
            None if self.masks is None else self.masks[steps],
            self.log_prob[steps],
            self.advantages[steps],
            self.returns[steps],
            None if self.decided is None else self.decided[steps],
        )


class ClosedForm:
    """A base before `PPO` or `MaskablePPO`, which acts and learns as that does, by less work of Python and
    without automatic differentiation. What is not known here is left to Stable-Baselines3.
    """

    tapered = False
    """Whether the number of epochs falls in proportion to what is left of the training, down to 1."""

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Fill the buffer with a round of experience. Advantages of steps without a decision are NaN."""
        learner: Any = self
        policy, decided = known(learner.policy), _Decided(learner)
        if policy is not None:
            learner.policy.forward = partial(_act, policy, learner.policy, decided)
        try:
            whole = bool(super().collect_rollouts(*args, **kwargs))  # pyright: ignore # of the class beside this one
        finally:
            learner.policy.__dict__.pop("forward", None)
        if whole:
            decided.mark(learner.rollout_buffer.advantages)
        return whole

    def _update_info_buffer(self, infos: Any, dones: Any) -> None:
        """Only where an episode has ended there is something to note."""
        ended = np.flatnonzero(dones)
        super()._update_info_buffer([infos[i] for i in ended], dones[ended])  # pyright: ignore # likewise

    def train(self) -> None:
        """Learn from the buffer's round."""
        learner: Any = self
        epochs = learner.n_epochs
        if self.tapered:
            learner.n_epochs = max(1, ceil(epochs * learner._current_progress_remaining))
        try:
            self._train(learner)
        finally:
            learner.n_epochs = epochs

    def _train(self, learner: Any) -> None:
        """Learn as many epochs as the learner says now."""
        policy = None if _is_special(learner) else known(learner.policy)
        if policy is None:
            super().train()  # pyright: ignore # of the class beside this one
            return
        learner.policy.set_training_mode(True)
        learner._update_learning_rate(learner.policy.optimizer)
        clip = learner.clip_range(learner._current_progress_remaining)
        weights = Weights(learner.ent_coef, learner.vf_coef, clip, learner.max_grad_norm)
        seen: list[list[Tensor]] = []
        with torch.no_grad(), ThreadPoolExecutor(1) as beside:
            for _ in range(learner.n_epochs):
                batches = shuffled(learner).parts(learner.batch_size)
                seen.append([_learn(policy, batch, weights, learner, beside) for batch in batches])
        learner._n_updates += learner.n_epochs
        _record(learner, seen, clip)


class _Decided:
    """Notes in which steps of a round the policy had a decision to take, where the environments tell and the
    rules of learning are known here.
    """

    def __init__(self, learner: Any) -> None:
        self._decides: Callable[[], NDArray[np.bool_]] | None
        self._decides = None if _is_special(learner) else getattr(learner.env.unwrapped, "decides", None)
        self._rows: list[NDArray[np.bool_]] = []

    def note(self) -> None:
        """A step is about to be made."""
        if self._decides is not None:
            self._rows.append(self._decides())

    def mark(self, advantages: NDArray[np.float32]) -> None:
        """Of the round, (steps, n): NaN where there was no decision."""
        if self._rows:
            advantages[~np.stack(self._rows)] = np.nan


def _is_special(learner: Any) -> bool:
    """Whether it learns by rules that are left to Stable-Baselines3."""
    return learner.clip_range_vf is not None or learner.target_kl is not None


@cache
def closed_form(learner: type[Any]) -> type[Any]:
    """`PPO` of Stable-Baselines3, or `MaskablePPO`, with `ClosedForm` before it."""
    return type(learner.__name__, (ClosedForm, learner), {})


def known(policy: Any) -> Policy | None:
    """The parts of a policy, ready for gradients; None for one whose gradient is not known."""
    actor = perceptron(policy.mlp_extractor.policy_net, policy.action_net)
    critic = perceptron(policy.mlp_extractor.value_net, policy.value_net)
    head = _head(policy)
    parameters: list[nn.Parameter] = list(policy.parameters())
    flat = type(policy.features_extractor) in (FlattenExtractor, Standardised)
    if actor is None or critic is None or head is None or not (flat and policy.share_features_extractor):
        return None
    own = {p for net in (actor, critic) for layer in net.layers for p in layer.parameters()}
    own |= {head.log_deviation} if isinstance(head, Gaussian) else set()
    if own != set(parameters) or any(p.dtype != torch.float32 for p in parameters):
        return None
    gradients, first = torch.zeros(sum(p.numel() for p in parameters)), 0
    for p in parameters:
        p.grad = gradients[first : first + p.numel()].view_as(p)
        first += p.numel()
    return Policy(actor, critic, head, gradients)


def _head(policy: Any) -> Head | None:
    """How actions are drawn; those of sb3-contrib have other classes, with the same attributes."""
    distribution = policy.action_dist
    if type(distribution) is DiagGaussianDistribution:
        return Gaussian(policy.log_std)
    name = type(distribution).__name__.removeprefix("Maskable")
    if name == CategoricalDistribution.__name__:
        return Categorical([int(distribution.action_dim)])
    if name == MultiCategoricalDistribution.__name__:
        return Categorical([int(n) for n in distribution.action_dims])
    return None


def _act(
    policy: Policy,
    owner: Any,
    decided: _Decided,
    observations: Tensor,
    deterministic: bool = False,
    action_masks: Any = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """What `forward` of a policy gives: actions at random, values (n, 1), logarithms of probabilities (n)."""
    assert not deterministic
    decided.note()
    masks = None if action_masks is None else torch.as_tensor(action_masks).view(len(observations), -1)
    features = owner.extract_features(observations)
    outputs, values = policy.actor.forward(features)[1], policy.critic.forward(features)[1]
    actions = policy.head.drawn(outputs, masks)
    log_prob = policy.head.judged(outputs, actions, masks).log_prob
    return actions.view(-1, *owner.action_space.shape), values.t(), log_prob


def shuffled(learner: Any) -> Batch:
    """All steps of the buffer in a random order, observations as the networks take them."""
    found = next(learner.rollout_buffer.get(None))
    decided = ~found.advantages.isnan()
    return Batch(
        learner.policy.extract_features(found.observations),
        found.actions,
        getattr(found, "action_masks", None),
        found.old_log_prob,
        found.advantages,
        found.returns,
        None if decided.all() else decided,
    )


def _learn(policy: Policy, batch: Batch, weights: Weights, learner: Any, beside: Executor) -> Tensor:
    """One step of the optimiser. Gives `STATISTICS`. The critic learns from all steps, the actor from its
    decisions: the other steps could teach it only noise. The two have no parameters in common: the gradient
    of the critic is computed `beside` that of the actor.
    """
    n = len(batch.returns)
    value_loss = beside.submit(_differentiate_values, policy.critic, batch, 2 * weights.value / n)
    made = batch.decisions()
    advantages, count = made.advantages, max(1, len(made.returns))
    if learner.normalize_advantage and count > 1:
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    acted, outputs = policy.actor.forward(made.observations)
    judged = policy.head.judged(outputs, made.actions, made.masks)
    log_ratio = judged.log_prob - made.log_prob
    ratio = log_ratio.exp()
    plain = advantages * ratio
    clipped = advantages * ratio.clamp(1 - weights.clip, 1 + weights.clip)
    of_log_prob = torch.where(plain <= clipped, plain, 0.0) / -n
    policy.actor.backward(acted, judged.gradient(of_log_prob, -weights.entropy / n))
    entropy, gain = judged.entropy.sum() / count, torch.minimum(plain, clipped).sum() / count
    lost = (-entropy, -gain, value_loss.result())

    norm = policy.gradients.square().sum().sqrt()
    policy.gradients.mul_(torch.clamp(weights.most / (norm + 1e-6), max=1.0))
    learner.policy.optimizer.step()

    divergence = (ratio - 1 - log_ratio).sum() / count
    fraction = ((ratio - 1).abs() > weights.clip).sum() / count
    whole = lost[1] + weights.entropy * lost[0] + weights.value * lost[2]
    return torch.stack((*lost, divergence, fraction, whole))


@torch.no_grad()
def _differentiate_values(critic: Perceptron, batch: Batch, weight: float) -> Tensor:
    """Set the gradients of the values' squared errors, (n), each times half the weight. Gives their mean."""
    valued, values = critic.forward(batch.observations)
    error = values.squeeze(0) - batch.returns
    critic.backward(valued, (error * weight).unsqueeze(0))
    return error.square().mean()


def _record(learner: Any, seen: list[list[Tensor]], clip: float) -> None:
    """Tell the logger what Stable-Baselines3 tells it: means over all minibatches, but for the divergence, of
    the last epoch, and the loss, of the last minibatch.
    """
    rows = torch.stack([row for epoch in seen for row in epoch]).double().numpy()
    told: dict[str, float] = dict(zip(STATISTICS, rows.mean(axis=0), strict=True))
    told["approx_kl"] = rows[-len(seen[-1]) :, STATISTICS.index("approx_kl")].mean()
    told["loss"] = rows[-1, STATISTICS.index("loss")]
    buffer = learner.rollout_buffer
    told["explained_variance"] = float(explained_variance(buffer.values.flatten(), buffer.returns.flatten()))
    if hasattr(learner.policy, "log_std"):
        told["std"] = float(np.exp(learner.policy.log_std.detach().numpy()).mean())
    for name, value in told.items():
        learner.logger.record(f"train/{name}", value)
    learner.logger.record("train/n_updates", learner._n_updates, exclude="tensorboard")
    learner.logger.record("train/clip_range", clip)
