"""Between the action space a user sees and the decisions a batch reads.

`encoding` picks the space (semantics 2); the rest converts between its actions and the
`choices`, `inputs`, `executed_*` and `mask` buffers, for all environments at once. Actions of
a batch have one leading axis of length n, as `gymnasium.vector.utils.batch_space` lays out.
"""

from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any, TypeAlias, assert_never

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from dl2c.env.spaces import float_type
from dl2c.native.manifest import Manifest
from dl2c.options import UnknownOption

if TYPE_CHECKING:
    from dl2c.native.binding import Batch

Ints: TypeAlias = NDArray[np.integer[Any]]
Floats: TypeAlias = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class NoDecision:
    """Nothing to decide: `Discrete(1)`."""


@dataclass(frozen=True, slots=True)
class OneChoice:
    """`Discrete(count)`."""

    count: int


@dataclass(frozen=True, slots=True)
class Choices:
    """`MultiDiscrete(counts)`."""

    counts: Ints


@dataclass(frozen=True, slots=True)
class Runs:
    """`Discrete`: the index of a whole control path. `table[r, k]` is its k-th decision, -1 if not met.

    `columns[r, k]` is where the mask of that decision stands; decisions not met point one past the end.
    """

    table: Ints
    columns: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Flat:
    """`Box`: the continuous decisions, then each choice as a number that is rounded and clipped.

    With `squash` every entry lies in [-1, 1]; for a choice that interval is stretched over its range.
    """

    low: Floats
    high: Floats
    counts: Ints
    squash: bool


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """`Dict`: `assign_<variable>` a Box of one entry, `choice_<k>` a Discrete."""

    input_keys: tuple[str, ...]
    choice_keys: tuple[str, ...]
    low: Floats
    high: Floats
    counts: Ints


Encoding: TypeAlias = NoDecision | OneChoice | Choices | Runs | Flat | Named


def encoding(manifest: Manifest, action_format: str | None = None) -> Encoding:
    """How actions are written under `action_format` (default: the model's option).

    Raises `UnknownOption` where the format cannot express the model's decisions.
    """
    counts = np.array([len(c.alternatives) for c in manifest.choices], np.int64)
    if not manifest.choices and not manifest.inputs:
        return NoDecision()
    match action_format or manifest.options["action_format"]:
        case "auto":
            mixed = bool(manifest.choices) and bool(manifest.inputs)
            return _named(manifest, counts) if mixed else _plain(manifest, counts)
        case "dict":
            return _named(manifest, counts)
        case "box":
            low, high = _limits(manifest)
            return Flat(low, high, counts, _squash(manifest))
        case "discrete":
            _refuse_inputs(manifest, "discrete")
            return _runs(manifest, counts)
        case "multidiscrete":
            _refuse_inputs(manifest, "multidiscrete")
            return Choices(counts)
        case other:
            raise AssertionError(other)


def flat_format(manifest: Manifest) -> str:
    """The action format nearest to the option's that is not a Dict, which learning libraries do not take."""
    chosen = manifest.options["action_format"]
    mixed = bool(manifest.choices) and bool(manifest.inputs)
    return "box" if chosen == "dict" or (chosen == "auto" and mixed) else chosen


def _plain(manifest: Manifest, counts: Ints) -> Encoding:
    if manifest.inputs:
        low, high = _limits(manifest)
        return Flat(low, high, counts, _squash(manifest))
    return OneChoice(int(counts[0])) if len(counts) == 1 else Choices(counts)


def _named(manifest: Manifest, counts: Ints) -> Named:
    low, high = _limits(manifest)
    return Named(
        tuple(i.key for i in manifest.inputs), tuple(c.key for c in manifest.choices), low, high, counts
    )


def _runs(manifest: Manifest, counts: Ints) -> Runs:
    table = np.array(manifest.runs, np.int64).reshape(len(manifest.runs), len(counts))
    first = np.cumsum(counts) - counts
    return Runs(table, np.where(table < 0, counts.sum(), first + table))


def _squash(manifest: Manifest) -> bool:
    return manifest.options["action_map"] == "squash"


def _limits(manifest: Manifest) -> tuple[Floats, Floats]:
    """Limits of the continuous entries, in the type of the space."""
    dtype = float_type(manifest)
    if _squash(manifest):
        return -np.ones(len(manifest.inputs), dtype), np.ones(len(manifest.inputs), dtype)
    return (
        np.array([i.low for i in manifest.inputs]).astype(dtype),
        np.array([i.high for i in manifest.inputs]).astype(dtype),
    )


def _refuse_inputs(manifest: Manifest, name: str) -> None:
    if manifest.inputs:
        keys = ", ".join(i.key for i in manifest.inputs)
        raise UnknownOption(
            f"action_format={name!r} cannot express the inputs {keys}; use 'auto', 'dict' or 'box'"
        )


# Spaces -----------------------------------------------------------------------


def action_space(encoding: Encoding) -> spaces.Space[Any]:
    """The Gymnasium space of one environment's actions."""
    match encoding:
        case NoDecision():
            return spaces.Discrete(1)
        case OneChoice(count):
            return spaces.Discrete(count)
        case Choices(counts):
            return spaces.MultiDiscrete(counts)
        case Runs(table):
            return spaces.Discrete(len(table))
        case Flat(low, high, counts, squash):
            ones = np.ones(len(counts))
            ends = (-ones, ones) if squash else (0 * ones, counts - 1)
            low, high = np.append(low, ends[0]).astype(low.dtype), np.append(high, ends[1]).astype(low.dtype)
            return spaces.Box(low, high, low.shape, low.dtype.type)
        case Named(input_keys, choice_keys, low, high, counts):
            boxes = {k: spaces.Box(low[i], high[i], (1,), low.dtype.type) for i, k in enumerate(input_keys)}
            choices = {k: spaces.Discrete(int(counts[i])) for i, k in enumerate(choice_keys)}
            return spaces.Dict({**boxes, **choices})
        case _:
            assert_never(encoding)


# Actions to requests ----------------------------------------------------------


def write(encoding: Encoding, batch: "Batch", actions: Any) -> None:
    """Request `actions` (n of them) in the batch's buffers. Raises `ValueError` for one outside the space."""
    n = len(batch.rewards)
    match encoding:
        case NoDecision():
            _indices(actions, (n,), np.array(1))
        case OneChoice(count):
            batch.choices[:, 0] = _indices(actions, (n,), np.array(count))
        case Choices(counts):
            batch.choices[:] = _indices(actions, (n, len(counts)), counts)
        case Runs(table):
            run = _indices(actions, (n,), np.array(len(table)))
            batch.choices[:] = np.maximum(table[run.astype(np.intp, copy=False)], 0)
        case Flat(low, _, counts, squash):
            values = _numbers(actions, (n, len(low) + len(counts)))
            batch.inputs[:] = values[:, : len(low)]
            tail = values[:, len(low) :]
            scaled = (np.clip(tail, -1, 1) + 1) / 2 * (counts - 1) if squash else np.clip(tail, 0, counts - 1)
            batch.choices[:] = np.rint(scaled)
        case Named(input_keys, choice_keys, _, _, counts):
            _check_keys(actions, (*input_keys, *choice_keys))
            for i, key in enumerate(input_keys):
                batch.inputs[:, i] = _numbers(actions[key], (n, 1))[:, 0]
            for i, key in enumerate(choice_keys):
                batch.choices[:, i] = _indices(actions[key], (n,), counts[i])
        case _:
            assert_never(encoding)


def _indices(actions: ArrayLike, shape: tuple[int, ...], counts: Ints) -> Ints:
    given = np.asarray(actions)
    if given.shape != shape or given.dtype.kind not in "iub":
        raise ValueError(f"expected integers of shape {shape}, not {given.dtype} of shape {given.shape}")
    if ((given < 0) | (given >= counts)).any():
        raise ValueError(outside(given.tolist(), counts.tolist()))
    return given


def _numbers(actions: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    given = np.asarray(actions, np.float64)
    if given.shape != shape:
        raise ValueError(f"expected numbers of shape {shape}, not of shape {given.shape}")
    _refuse_nan(given.reshape(-1))
    return given


def _refuse_nan(row: NDArray[np.float64]) -> None:
    if isnan(row.dot(row)):  # quicker than isnan().any()
        raise ValueError(with_nan(row))


def with_nan(row: NDArray[np.float64]) -> str:
    return f"an action must not contain NaN: {row.tolist()}"


def _check_keys(actions: Any, keys: tuple[str, ...]) -> None:
    if set(actions) != set(keys):
        raise ValueError(
            f"expected an action with the keys {', '.join(keys)}, not {', '.join(map(str, actions))}"
        )


def outside(action: Any, count: Any) -> str:
    return f"action {action} is outside the action space: each entry must be at least 0 and less than {count}"


# Results to actions -----------------------------------------------------------


def executed(encoding: Encoding, choices: Ints, inputs: Floats) -> Any:
    """The runs taken, as n actions in fresh memory."""
    match encoding:
        case NoDecision():
            return np.zeros(len(choices), np.int64)
        case OneChoice():
            return choices[:, 0].astype(np.int64)
        case Choices():
            return choices.astype(np.int64)
        case Runs(table):
            return ((table == choices[:, None]) | (table < 0)).all(axis=2).argmax(axis=1)
        case Flat(low, _, counts, squash):
            scaled = 2 * choices / np.maximum(counts - 1, 1) - 1 if squash else choices
            return np.concatenate([inputs, scaled], axis=1).astype(low.dtype)
        case Named(input_keys, choice_keys, low):
            taken = {k: inputs[:, i : i + 1].astype(low.dtype) for i, k in enumerate(input_keys)}
            return taken | {k: choices[:, i].astype(np.int64) for i, k in enumerate(choice_keys)}
        case _:
            assert_never(encoding)


def masks(encoding: Encoding, mask: NDArray[np.int8]) -> NDArray[np.int8]:
    """The action masks of n environments, in fresh memory: one column per alternative, per run for `Runs`.

    A run is enabled if each of its decisions is: with several choices an over-approximation.
    """
    match encoding:
        case Runs(_, columns):
            always = np.ones((len(mask), 1), np.int8)
            return np.concatenate([mask, always], axis=1)[:, columns].min(axis=2, initial=1)
        case _:
            return mask.copy()
