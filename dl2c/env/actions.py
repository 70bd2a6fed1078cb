"""Which form the actions of a model have: `encoding` picks one of encodings.py (semantics 2)."""

import numpy as np

from dl2c.env.encodings import Choices, Encoding, Flat, Floats, Ints, Named, NoDecision, OneChoice, Runs
from dl2c.env.spaces import float_type
from dl2c.native.manifest import Manifest
from dl2c.options import UnknownOption


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
