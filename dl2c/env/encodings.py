"""The forms that actions may have: each form once, from its Gymnasium space to the decisions of a batch.

`write` and `executed` convert the actions of all environments at once; these have one leading axis of length
n, as `gymnasium.vector.utils.batch_space` lays out. `writer` and `reader` do the same for one environment,
without that axis, and look up beforehand all they need. Which form a model has is decided in actions.py.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, cast, final

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from dl2c.policy.network import ActionKind

if TYPE_CHECKING:
    from dl2c.native.binding import Batch

Ints: TypeAlias = NDArray[np.integer[Any]]
Floats: TypeAlias = NDArray[np.floating[Any]]
Write: TypeAlias = Callable[[Any], None]
Read: TypeAlias = Callable[[], Any]


class Encoding(ABC):
    """How actions are written. `kind` is what policies call such actions, None where none can act so."""

    kind: ClassVar[ActionKind | None] = None

    @abstractmethod
    def space(self) -> spaces.Space[Any]:
        """The Gymnasium space of one environment's actions."""

    @abstractmethod
    def write(self, batch: "Batch", actions: Any) -> None:
        """Request n actions in the batch's buffers. Raises `ValueError` for one outside the space."""

    @abstractmethod
    def executed(self, choices: Ints, inputs: Floats) -> Any:
        """The runs taken, as n actions in fresh memory."""

    def masks(self, mask: NDArray[np.int8]) -> NDArray[np.int8]:
        """The action masks of n environments, in fresh memory: one column for each alternative."""
        return mask.copy()

    def writer(self, batch: "Batch") -> Write:
        """`write` for a batch of one."""
        return lambda action: self.write(batch, np.asarray(action)[None])

    def reader(self, batch: "Batch") -> Read:
        """`executed` for a batch of one."""
        choices, inputs = batch.executed_choices, batch.executed_inputs
        return lambda: self.executed(choices, inputs)[0]


@final
class NoDecision(Encoding):
    """Nothing to decide: `Discrete(1)`."""

    kind = "none"

    def space(self) -> spaces.Space[Any]:
        return spaces.Discrete(1)

    def write(self, batch: "Batch", actions: Any) -> None:
        _indices(actions, (len(batch.rewards),), 1)

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        return np.zeros(len(choices), np.int64)

    def reader(self, batch: "Batch") -> Read:
        return lambda: 0


@final
@dataclass(frozen=True, slots=True)
class OneChoice(Encoding):
    """`Discrete(count)`."""

    kind = "choice"
    count: int

    def space(self) -> spaces.Space[Any]:
        return spaces.Discrete(self.count)

    def write(self, batch: "Batch", actions: Any) -> None:
        batch.choices[:, 0] = _indices(actions, (len(batch.rewards),), self.count)

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        return choices[:, 0].astype(np.int64)

    def writer(self, batch: "Batch") -> Write:
        cell, count = cells_of(batch.choices), self.count

        def write_choice(action: Any) -> None:
            if not 0 <= action < count:
                raise ValueError(_outside(action, count))
            cell[0] = action

        return write_choice

    def reader(self, batch: "Batch") -> Read:
        return batch.executed_choices[0].item


@final
@dataclass(frozen=True, slots=True)
class Choices(Encoding):
    """`MultiDiscrete(counts)`."""

    kind = "choices"
    counts: Ints

    def space(self) -> spaces.Space[Any]:
        return spaces.MultiDiscrete(self.counts)

    def write(self, batch: "Batch", actions: Any) -> None:
        batch.choices[:] = _indices(actions, (len(batch.rewards), len(self.counts)), self.counts)

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        return choices.astype(np.int64)

    def writer(self, batch: "Batch") -> Write:
        cells, counts = cells_of(batch.choices), _listed(self.counts)
        limits = list(enumerate(counts))

        def write_choices(action: Any) -> None:
            given = action.tolist() if isinstance(action, np.ndarray) else list(action)
            if len(given) != len(limits):
                raise ValueError(f"expected {len(limits)} integers, not {given}")
            for k, count in limits:
                if not 0 <= given[k] < count:
                    raise ValueError(_outside(given, counts))
                cells[k] = given[k]

        return write_choices

    def reader(self, batch: "Batch") -> Read:
        indices = batch.executed_choices[0]
        return lambda: indices.astype(np.int64)


@final
@dataclass(frozen=True, slots=True)
class Runs(Encoding):
    """`Discrete`: the index of a whole control path. `table[r, k]` is its k-th decision, -1 if not met.

    `columns[r, k]` is where the mask of that decision stands; decisions not met point one past the end.
    """

    kind = "runs"
    table: Ints
    columns: Ints

    def space(self) -> spaces.Space[Any]:
        return spaces.Discrete(len(self.table))

    def write(self, batch: "Batch", actions: Any) -> None:
        run = _indices(actions, (len(batch.rewards),), len(self.table))
        batch.choices[:] = np.maximum(self.table[run.astype(np.intp, copy=False)], 0)

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        return ((self.table == choices[:, None]) | (self.table < 0)).all(axis=2).argmax(axis=1)

    def masks(self, mask: NDArray[np.int8]) -> NDArray[np.int8]:
        """One column for each run, which is enabled if each of its decisions is: with several choices an
        over-approximation.
        """
        always = np.ones((len(mask), 1), np.int8)
        return np.concatenate([mask, always], axis=1)[:, self.columns].min(axis=2, initial=1)


@final
@dataclass(frozen=True, slots=True, eq=False)
class Flat(Encoding):
    """`Box`: the continuous decisions, then each choice as a number, clipped and rounded (half to even).

    With `squash` every entry lies in [-1, 1]; for a choice that interval is stretched over its range.
    """

    kind = "box"
    low: Floats
    high: Floats
    counts: Ints
    squash: bool

    def space(self) -> spaces.Space[Any]:
        ones, dtype = np.ones(len(self.counts)), self.low.dtype
        ends = (-ones, ones) if self.squash else (0 * ones, self.counts - 1)
        low, high = np.append(self.low, ends[0]).astype(dtype), np.append(self.high, ends[1]).astype(dtype)
        return spaces.Box(low, high, low.shape, dtype.type)

    def write(self, batch: "Batch", actions: Any) -> None:
        first, last = len(self.low), self.counts - 1
        values = _numbers(actions, (len(batch.rewards), first + len(last)))
        batch.inputs[:] = values[:, :first]
        tail = values[:, first:]
        scaled = (np.clip(tail, -1, 1) + 1) / 2 * last if self.squash else np.clip(tail, 0, last)
        batch.choices[:] = np.rint(scaled)

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        scaled = 2 * choices / np.maximum(self.counts - 1, 1) - 1 if self.squash else choices
        return np.concatenate([inputs, scaled], axis=1).astype(self.low.dtype)

    def writer(self, batch: "Batch") -> Write:
        first, last, squash = len(self.low), _listed(self.counts - 1), self.squash
        row, cells, inputs = np.empty(first + len(last)), cells_of(batch.choices), batch.inputs[0]

        def write_row(action: Any) -> None:
            given = np.asarray(action)
            if given.shape != row.shape:
                raise ValueError(f"expected numbers of shape {row.shape}, not of shape {given.shape}")
            row[:] = given
            numbers: list[float] = row.tolist()
            if any(map(isnan, numbers)):
                raise ValueError(_with_nan(row))
            inputs[:] = row[:first]
            for k, most in enumerate(last):
                number = numbers[first + k]
                scaled = (min(max(number, -1), 1) + 1) / 2 * most if squash else min(max(number, 0), most)
                cells[k] = round(scaled)

        return write_row

    def reader(self, batch: "Batch") -> Read:
        inputs, dtype, squash = batch.executed_inputs[0], self.low.dtype, self.squash
        cells, first, last = cells_of(batch.executed_choices), len(inputs), _listed(self.counts - 1)
        if not last:
            return lambda: inputs.astype(dtype)

        def read_row() -> Any:
            row = np.empty(first + len(last), dtype)
            row[:first] = inputs
            for k, most in enumerate(last):
                row[first + k] = 2 * cells[k] / max(most, 1) - 1 if squash else cells[k]
            return row

        return read_row


@final
@dataclass(frozen=True, slots=True, eq=False)
class Named(Encoding):
    """`Dict`: `assign_<variable>` a Box of one entry, `choice_<k>` a Discrete."""

    input_keys: tuple[str, ...]
    choice_keys: tuple[str, ...]
    low: Floats
    high: Floats
    counts: Ints

    def space(self) -> spaces.Space[Any]:
        dtype = self.low.dtype.type
        limits = zip(self.input_keys, self.low, self.high, strict=True)
        boxes = {key: spaces.Box(low, high, (1,), dtype) for key, low, high in limits}
        choices = zip(self.choice_keys, _listed(self.counts), strict=True)
        return spaces.Dict({**boxes, **{key: spaces.Discrete(count) for key, count in choices}})

    def write(self, batch: "Batch", actions: Any) -> None:
        n = len(batch.rewards)
        if set(actions) != {*self.input_keys, *self.choice_keys}:
            wanted, given = ", ".join((*self.input_keys, *self.choice_keys)), ", ".join(map(str, actions))
            raise ValueError(f"expected an action with the keys {wanted}, not {given}")
        for i, key in enumerate(self.input_keys):
            _put_numbers(actions[key], batch.inputs[:, i : i + 1])
        for i, key in enumerate(self.choice_keys):
            batch.choices[:, i] = _indices(actions[key], (n,), int(self.counts[i]))

    def executed(self, choices: Ints, inputs: Floats) -> Any:
        taken = {k: inputs[:, i : i + 1].astype(self.low.dtype) for i, k in enumerate(self.input_keys)}
        return taken | {k: choices[:, i].astype(np.int64) for i, k in enumerate(self.choice_keys)}

    def writer(self, batch: "Batch") -> Write:
        quick = self._sampled_writer(batch)

        def write_named(action: Any) -> None:
            given = dict(action)
            if not quick(given):
                self.write(batch, {k: np.asarray(v)[None] for k, v in given.items()})

        return write_named

    def _sampled_writer(self, batch: "Batch") -> Callable[[dict[str, Any]], bool]:
        """Writes an action whose entries are of the types that the space samples, and says if it was one."""
        inputs, choices = list(enumerate(self.input_keys)), list(enumerate(self.choice_keys))
        numbers, cells = cells_of(batch.inputs), cells_of(batch.choices)
        counts, keys = _listed(self.counts), {*self.input_keys, *self.choice_keys}

        def write_sampled(action: dict[str, Any]) -> bool:
            if action.keys() != keys:
                return False
            for i, key in inputs:
                entry = cast("Floats", action[key])
                if type(entry) is not np.ndarray or entry.shape != (1,) or entry.dtype.char not in "fd":
                    return False
                numbers[i] = number = entry.item()
                if isnan(number):
                    return False
            for i, key in choices:
                given = action[key]
                if not isinstance(given, np.integer | int) or not 0 <= given < counts[i]:
                    return False
                cells[i] = given
            return True

        return write_sampled

    def reader(self, batch: "Batch") -> Read:
        dtype, cells = self.low.dtype, cells_of(batch.executed_choices)
        entries = [(k, batch.executed_inputs[0, i : i + 1]) for i, k in enumerate(self.input_keys)]
        taken = list(enumerate(self.choice_keys))
        return lambda: {
            **{k: entry.astype(dtype) for k, entry in entries},
            **{k: np.int64(cells[i]) for i, k in taken},
        }


def cells_of(array: NDArray[Any]) -> Any:
    """A flat view of an array whose entries are plain Python numbers, not numpy's."""
    return array.reshape(-1).data


def _listed(counts: Ints) -> list[int]:
    return counts.tolist()


def _indices(actions: ArrayLike, shape: tuple[int, ...], counts: int | Ints) -> Ints:
    """Integers of that shape, each at least 0 and less than `counts` (of its column)."""
    given = np.asarray(actions)
    if given.shape != shape or given.dtype.kind not in "iub":
        raise ValueError(f"expected integers of shape {shape}, not {given.dtype} of shape {given.shape}")
    bits = np.bitwise_or.reduce(given)  # negative where an entry is, else no less than the largest one
    inside = 0 <= bits < counts if isinstance(counts, int) else ((bits >= 0) & (bits < counts)).all()
    if not inside and ((given < 0) | (given >= counts)).any():
        raise ValueError(_outside(given.tolist(), np.asarray(counts).tolist()))
    return given


def _numbers(actions: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    given = np.asarray(actions, np.float64)
    if given.shape != shape:
        raise ValueError(_not_shaped(given, shape))
    _check_numbers(given.reshape(-1))
    return given


def _put_numbers(actions: ArrayLike, column: NDArray[np.float64]) -> None:
    """Writes numbers into a column (n, 1)."""
    given = np.asarray(actions)
    if given.shape != column.shape:
        raise ValueError(_not_shaped(given, column.shape))
    column[:] = given
    _check_numbers(column[:, 0])


def _check_numbers(row: NDArray[np.float64]) -> None:
    if isnan(row.dot(row)):  # quicker than isnan().any()
        raise ValueError(_with_nan(row))


def _not_shaped(given: NDArray[Any], shape: tuple[int, ...]) -> str:
    return f"expected numbers of shape {shape}, not of shape {given.shape}"


def _with_nan(row: NDArray[np.float64]) -> str:
    return f"an action must not contain NaN: {row.tolist()}"


def _outside(action: Any, count: Any) -> str:
    return f"action {action} is outside the action space: each entry must be at least 0 and less than {count}"
