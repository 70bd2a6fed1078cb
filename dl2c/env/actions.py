"""Which form the actions of a model have: `encoding` picks one of encodings.py (semantics 2)."""

import numpy as np

from dl2c.env.encodings import Choices, Encoding, Flat, Floats, Ints, Named, NoDecision, OneChoice, Runs
from dl2c.env.spaces import float_type
from dl2c.native.manifest import Manifest


def encoding(manifest: Manifest, action_format: str | None = None) -> Encoding:
    """How actions are written under `action_format` (default: the model's option).

    Raises `UnknownOption` where the format cannot express the model's decisions.
    """
    counts = np.array([len(c.alternatives) for c in manifest.choices], np.int64)
    match manifest.action_form(action_format):
        case "none":
            return NoDecision()
        case "one choice":
            return OneChoice(int(counts[0]))
        case "choices":
            return Choices(counts)
        case "runs":
            return _runs(manifest, counts)
        case "box":
            return Flat(*_limits(manifest), counts, _squash(manifest))
        case "dict":
            return _named(manifest, counts)


def flat_format(manifest: Manifest) -> str:
    """The action format nearest to the option's that is not a Dict, which learning libraries do not take."""
    chosen = manifest.options["action_format"]
    mixed = bool(manifest.choices) and bool(manifest.inputs)
    return "box" if chosen == "dict" or (chosen == "auto" and mixed) else chosen


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
