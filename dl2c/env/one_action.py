"""An action of a single environment: what `dl2c.env.actions` does for n of them, quick for one.

In goes the batch of one that is stepped; out come functions that looked up all they need.
"""

from collections.abc import Callable
from math import isnan
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dl2c.env.actions import (
    Choices,
    Encoding,
    Flat,
    Floats,
    Ints,
    Named,
    NoDecision,
    OneChoice,
    executed,
    outside,
    with_nan,
    write,
)
from dl2c.env.spaces import cells_of

if TYPE_CHECKING:
    from dl2c.native.binding import Batch


def writer(encoding: Encoding, batch: "Batch") -> Callable[[Any], None]:
    """`write` for a batch of one, taking an action without its leading axis; quick where it matters."""
    match encoding:
        case OneChoice(count):
            cell = cells_of(batch.choices.reshape(-1))

            def write_choice(action: Any) -> None:
                if not 0 <= action < count:
                    raise ValueError(outside(action, count))
                cell[0] = action

            return write_choice
        case Choices(counts):
            cells, limits = cells_of(batch.choices.reshape(-1)), list(enumerate(_listed(counts)))

            def write_choices(action: Any) -> None:
                given = action.tolist() if isinstance(action, np.ndarray) else list(action)
                if len(given) != len(limits):
                    raise ValueError(f"expected {len(limits)} integers, not {given}")
                for k, count in limits:
                    if not 0 <= given[k] < count:
                        raise ValueError(outside(given, _listed(counts)))
                    cells[k] = given[k]

            return write_choices
        case Flat():
            return _row_writer(encoding, batch)
        case Named():
            quick = _sampled_writer(encoding, batch)

            def write_named(action: Any) -> None:
                given = dict(action)
                if not quick(given):
                    write(encoding, batch, {k: np.asarray(v)[None] for k, v in given.items()})

            return write_named
        case _:
            return lambda action: write(encoding, batch, np.asarray(action)[None])


def _row_writer(encoding: Flat, batch: "Batch") -> Callable[[Any], None]:
    """Writes a row of numbers: inputs, then choices, which are clipped and rounded (half to even)."""
    first, last = len(encoding.low), [count - 1 for count in _listed(encoding.counts)]
    row, cells = np.empty(first + len(last)), cells_of(batch.choices.reshape(-1))
    inputs, squash = batch.inputs[0], encoding.squash

    def write_row(action: Any) -> None:
        given = np.asarray(action)
        if given.shape != row.shape:
            raise ValueError(f"expected numbers of shape {row.shape}, not of shape {given.shape}")
        row[:] = given
        numbers: list[float] = row.tolist()
        if any(map(isnan, numbers)):
            raise ValueError(with_nan(row))
        inputs[:] = row[:first]
        for k, most in enumerate(last):
            number = numbers[first + k]
            scaled = (min(max(number, -1), 1) + 1) / 2 * most if squash else min(max(number, 0), most)
            cells[k] = round(scaled)

    return write_row


def _sampled_writer(encoding: Named, batch: "Batch") -> Callable[[dict[str, Any]], bool]:
    """Writes an action whose entries are of the types that the space samples, and says if it was one."""
    inputs, choices = list(enumerate(encoding.input_keys)), list(enumerate(encoding.choice_keys))
    numbers, cells = cells_of(batch.inputs.reshape(-1)), cells_of(batch.choices.reshape(-1))
    counts, keys = _listed(encoding.counts), {*encoding.input_keys, *encoding.choice_keys}

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


def reader(encoding: Encoding, batch: "Batch") -> Callable[[], Any]:
    """`executed` for a batch of one, without the leading axis."""
    match encoding:
        case NoDecision():
            return lambda: 0
        case OneChoice():
            return batch.executed_choices[0].item
        case Choices():
            indices = batch.executed_choices[0]
            return lambda: indices.astype(np.int64)
        case Flat():
            return _row_reader(encoding, batch)
        case Named(input_keys, choice_keys, low):
            dtype, cells = low.dtype, cells_of(batch.executed_choices.reshape(-1))
            entries = [(k, batch.executed_inputs[0, i : i + 1]) for i, k in enumerate(input_keys)]
            taken = list(enumerate(choice_keys))
            return lambda: {
                **{k: entry.astype(dtype) for k, entry in entries},
                **{k: np.int64(cells[i]) for i, k in taken},
            }
        case _:
            choices, inputs = batch.executed_choices, batch.executed_inputs
            return lambda: executed(encoding, choices, inputs)[0]


def _row_reader(encoding: Flat, batch: "Batch") -> Callable[[], Any]:
    inputs, dtype = batch.executed_inputs[0], encoding.low.dtype
    last = [count - 1 for count in _listed(encoding.counts)]
    if not last:
        return lambda: inputs.astype(dtype)
    cells, first, squash = cells_of(batch.executed_choices.reshape(-1)), len(inputs), encoding.squash

    def read_row() -> Any:
        row = np.empty(first + len(last), dtype)
        row[:first] = inputs
        for k, most in enumerate(last):
            row[first + k] = 2 * cells[k] / max(most, 1) - 1 if squash else cells[k]
        return row

    return read_row


def _listed(counts: Ints) -> list[int]:
    return counts.tolist()
