"""A step of a single environment, from an action to what Gymnasium returns, and a step of many.

In goes a batch; out comes a function of the action, in C where that can be built and else in Python. Both
return the same objects, fresh at every step; both look up once what they need of the model.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.env.encodings import Choices, Encoding, Flat, Named, OneChoice
from dl2c.env.infos import ENTRIES, IS_SUCCESS, NUMBERS, STATUS, SUCCESS, reason_names
from dl2c.native.results import OUTCOME, OUTCOME_NAMES
from dl2c.native.stepping import stepping

if TYPE_CHECKING:
    from dl2c.native.binding import Batch
    from dl2c.native.manifest import Manifest

Step: TypeAlias = tuple[NDArray[Any], float, bool, bool, dict[str, Any]]
"""Observation, reward, terminated, truncated, info."""

Returned: TypeAlias = NDArray[Any] | tuple[NDArray[Any], np.dtype[Any]]
"""An array that is copied, or one with the type of its copy."""

Infos: TypeAlias = list[dict[str, Any]]

Column: TypeAlias = NDArray[Any] | tuple[NDArray[Any], Sequence[Any] | Mapping[int, Any]]
"""An entry of the infos of n environments: numbers (n), rows (n, k), or numbers (n) and their names."""

Origin: TypeAlias = NDArray[Any] | Callable[[], Any]
"""Where an entry of `info` comes from: an array that is copied, or a function that makes it."""

INDEX = np.dtype(np.int64)
"""Of choices in actions."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What a step is made of. `extras` are the entries of `info` that not all models have; `ended` is
    told that the episode is over.
    """

    manifest: "Manifest"
    batch: "Batch"
    encoding: Encoding
    extras: Mapping[str, Origin]
    ended: Callable[[], None]


def step_function(parts: Parts) -> Callable[[Any], Step]:
    """One step, in the fastest form there is. Raises `ValueError` for an action outside the action space."""
    return compiled_step(parts) or python_step(parts)


def compiled_step(parts: Parts) -> Callable[[Any], Step] | None:
    """The step in C; None where it cannot be built."""
    batch, encoding = parts.batch, parts.encoding
    plain = _plain(encoding, batch)
    origins = {"executed_action": plain.executed, **parts.extras}
    return batch.step_in_c(
        "one",
        encoding.writer(batch),
        any(flow.kernel != "exact" for flow in parts.manifest.flows),
        batch.memory,
        batch.choices,
        batch.inputs,
        plain.count,
        plain.width,
        plain.named,
        parts.ended,
        batch.obs[0],
        (*NUMBERS, IS_SUCCESS),
        _uneventful(parts.extras),
        STATUS,
        reason_names(parts.manifest),
        tuple(chain.from_iterable(origins.items())),
    )


@dataclass(frozen=True, slots=True)
class _Plain:
    """What cgen/python/stepping.c needs to request and report actions of a plain form itself."""

    executed: Any
    count: int = 0
    width: int = 0
    named: tuple[Any, ...] = ()


def _plain(encoding: Encoding, batch: "Batch") -> _Plain:
    match encoding:
        case OneChoice(count):
            return _Plain(encoding.reader(batch), count)
        case Flat(low, _, counts) if not len(counts):
            return _Plain((batch.executed_inputs[0], low.dtype), width=len(low))
        case Named(inputs, choices, low, _, counts):
            values = [(batch.executed_inputs[0, i : i + 1], low.dtype) for i in range(len(inputs))]
            taken = [(batch.executed_choices[0, i : i + 1].reshape(()), INDEX) for i in range(len(choices))]
            named = [(k, i, 0) for i, k in enumerate(inputs)]
            named += [(k, i, int(counts[i])) for i, k in enumerate(choices)]
            executed = dict(zip((*inputs, *choices), (*values, *taken), strict=True))
            return _Plain(executed, named=tuple(chain.from_iterable(named)))
        case _:
            return _Plain(encoding.reader(batch))


def _uneventful(extras: Mapping[str, Origin]) -> dict[str, Any]:
    """`info` of a step of which nothing is to be said, with all its keys in order."""
    return {name: entry.quiet for name, entry in ENTRIES.items()} | dict.fromkeys(extras)


def python_step(parts: Parts) -> Callable[[Any], Step]:
    """The step in Python."""
    batch, ended, reasons = parts.batch, parts.ended, reason_names(parts.manifest)
    write, executed = parts.encoding.writer(batch), parts.encoding.reader(batch)
    step_batch, observe = batch.step, batch.obs[0].copy
    outcome, read = batch.memory.data, OUTCOME.unpack_from
    extras = {k: o.copy if isinstance(o, np.ndarray) else o for k, o in parts.extras.items()}

    def step(action: Any) -> Step:
        write(action)
        step_batch()
        found = dict(zip(OUTCOME_NAMES, read(outcome), strict=True))
        status, end, cut = found["status"], found["terminated"], found["truncated"]
        found |= {"status": STATUS[status], "reason": reasons[found["reason"]], "executed_action": executed()}
        info = {name: found[name] for name in ENTRIES}
        for key, fresh in extras.items():
            info[key] = fresh()
        if end or cut:
            ended()
            info[IS_SUCCESS] = status == SUCCESS
        return observe(), found["rewards"], end, cut, info

    return step


def steps_function(
    encoding: Encoding, batch: "Batch", *returned: Returned
) -> Callable[[Any], tuple[NDArray[Any], ...]]:
    """One step of many environments, in the fastest form there is, which returns copies of arrays of the
    batch. Raises `ValueError` for actions outside the action space.
    """
    return compiled_steps(encoding, batch, *returned) or python_steps(encoding, batch, *returned)


def compiled_steps(
    encoding: Encoding, batch: "Batch", *returned: Returned
) -> Callable[[Any], tuple[NDArray[Any], ...]] | None:
    """The step in C; None where it cannot be built."""
    requests, counts = _requests(encoding, batch)
    return batch.step_in_c("many", partial(encoding.write, batch), True, requests, counts, returned)


def _requests(encoding: Encoding, batch: "Batch") -> tuple[NDArray[Any] | None, NDArray[np.int64]]:
    """Where actions of a plain form go as they are, and how many alternatives each choice has."""
    match encoding:
        case OneChoice(count):
            return batch.choices.reshape(-1), np.array([count], INDEX)
        case Choices(counts):
            return batch.choices, counts.astype(INDEX)
        case Flat(_, _, counts) if not len(counts):
            return batch.inputs, np.empty(0, INDEX)
        case _:
            return None, np.empty(0, INDEX)


def python_steps(
    encoding: Encoding, batch: "Batch", *returned: Returned
) -> Callable[[Any], tuple[NDArray[Any], ...]]:
    """The step in Python."""

    def step(actions: Any) -> tuple[NDArray[Any], ...]:
        encoding.write(batch, actions)
        batch.step()
        return tuple(s[0].astype(s[1]) if isinstance(s, tuple) else s.copy() for s in returned)

    return step


def infos_function() -> Callable[[NDArray[np.bool_], Mapping[str, Column]], Infos]:
    """`python_infos`, in the fastest form there is."""
    return python_infos if (extension := stepping()) is None else extension.infos


def python_infos(told: NDArray[np.bool_], columns: Mapping[str, Column]) -> Infos:
    """An info for each environment: empty but where it is told, which takes its entries of the columns."""
    infos: Infos = [{} for _ in told]
    for i in np.flatnonzero(told).tolist():
        infos[i] = {key: _entry(column, i) for key, column in columns.items()}
    return infos


def _entry(column: Column, i: int) -> Any:
    if isinstance(column, tuple):
        array, names = column
        return names[array[i].item()]
    return column[i].item() if column.ndim == 1 else column[i].copy()
