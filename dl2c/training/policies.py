"""Policies as functions from observations and masks to actions, for n environments at once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.env.encodings import Choices, Encoding, Flat, NoDecision, OneChoice, Runs
from dl2c.policy.files import JSON, read_policy
from dl2c.policy.network import PolicyError

__all__ = ["Masks", "Policy", "PolicyError", "policy_of", "saved_policy"]

Masks: TypeAlias = NDArray[np.bool_]
Policy: TypeAlias = Callable[[NDArray[Any], Masks], NDArray[Any]]
"""Observations (n, nobs) and masks (n, columns of `action_masks`) to actions (n, ...)."""


def policy_of(name: str | Path | Policy, code: Encoding, masked: bool, seed: int) -> Policy:
    """The policy called `random` or `first`, one that `dl2c train` wrote as JSON (the file or its folder),
    or one that Stable-Baselines3 saved to a zip file.

    `random` draws uniformly from what the mask allows, `first` takes the first of it in program order;
    continuous decisions are drawn uniformly, or 0 where that is allowed. Unless `masked`, the masks
    are taken to allow everything.
    """
    if callable(name):
        return name
    match str(name):
        case "random":
            rng = np.random.default_rng(seed)
            policy = _choosing(code, lambda mask: (rng.random(mask.shape) * mask).argmax(axis=1), rng)
        case "first":
            policy = _choosing(code, lambda mask: mask.argmax(axis=1), None)
        case path if Path(path).is_dir() or path.endswith(".json"):
            return data_policy(Path(path, JSON) if Path(path).is_dir() else Path(path), code, masked)
        case path:
            return saved_policy(Path(path), masked)
    return policy if masked else lambda observations, masks: policy(observations, np.ones_like(masks))


def _choosing(
    code: Encoding, pick: Callable[[Masks], NDArray[np.intp]], rng: np.random.Generator | None
) -> Policy:
    """A policy that picks one alternative of each choice from its mask."""
    space: Any = code.space()
    match code:
        case NoDecision():
            return lambda observations, _: np.zeros(len(observations), np.int64)
        case OneChoice() | Runs():
            return lambda _, masks: pick(masks)
        case Choices(counts):
            ends = np.cumsum(counts)[:-1]
            return lambda _, masks: np.stack([pick(m) for m in np.split(masks, ends, axis=1)], axis=1)
        case Flat():
            low, high = space.low, space.high
            if rng is None:
                return lambda observations, _: np.tile(np.clip(0, low, high), (len(observations), 1))
            return lambda observations, _: rng.uniform(low, high, (len(observations), len(low)))
        case _:
            raise AssertionError("policies act on flat spaces")


def data_policy(path: Path, code: Encoding, masked: bool) -> Policy:
    """A policy in a file without code; it acts deterministically. Raises `OSError`, `PolicyError`."""
    policy = read_policy(path)
    io, wanted = policy.interface, code.kind
    if io.kind != wanted or io.squash != (isinstance(code, Flat) and code.squash):
        raise PolicyError(f"{path} gives actions of kind {io.kind}, the environment takes {wanted}")

    def act(observations: NDArray[Any], masks: Masks) -> NDArray[Any]:
        if observations.shape[1] != len(io.observations):
            raise PolicyError(f"{path} observes {len(io.observations)} numbers, not {observations.shape[1]}")
        return policy.act(observations, masks if masked else np.ones_like(masks))

    return act


def saved_policy(path: Path, masked: bool) -> Policy:
    """A policy that Stable-Baselines3 saved, with the statistics of VecNormalize beside it if there are any;
    it acts deterministically. Raises `OSError`, `PolicyError`.
    """
    from dl2c.training.saved import load_learner, scaling_saved, statistics_beside

    algo, model = load_learner(path)
    statistics, shape = statistics_beside(path), model.observation_space.shape
    scaling = None if statistics is None else scaling_saved(statistics, shape[0])

    def act(observations: NDArray[Any], masks: Masks) -> NDArray[Any]:
        given = observations if scaling is None else scaling.of(observations).astype(observations.dtype)
        kept = {"action_masks": masks} if masked and algo == "maskable-ppo" else {}
        return model.predict(given, deterministic=True, **kept)[0]

    return act
