"""The entries of `info` that are one number of a step: their names, types, and values where nothing happened.

They stand here once, in the order of `info`. A batch has a buffer of each name.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dl2c.native.manifest import Manifest

STATUS = ("none", "success", "failure")
"""`info["status"]` by code."""

SUCCESS, FAILURE = 1, 2

_REASONS = ("", "blocked", "deadlock", "numerical", "solver", "stalled", "diverged", "time_limit", "end")
FIRST_PREDICATE = 16
"""The code of the first predicate of a model."""


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of `info`: its type in vector environments, and its value after an uneventful step."""

    dtype: Any
    quiet: Any


ENTRIES = {
    "status": Entry(np.int8, STATUS[0]),
    "reason": Entry(np.int32, ""),
    "cost": Entry(np.int64, 0),
    "blocked": Entry(np.bool_, False),
    "executed_action": Entry(None, None),  # of the action space
    "duration": Entry(np.float64, 0.0),
    "time": Entry(np.float64, 0.0),
    "postcondition": Entry(np.bool_, True),
    "saturated": Entry(np.bool_, False),
}

NUMBERS = tuple(name for name, entry in ENTRIES.items() if entry.dtype is not None)
"""In the order in which cgen/python/stepping.c numbers them."""

IS_SUCCESS = "is_success"
"""Only where an episode ends."""


def reason_names(manifest: Manifest) -> dict[int, str]:
    """`info["reason"]` by code; an episode that a predicate ended names the predicate."""
    names = dict(enumerate(_REASONS))
    return names | {FIRST_PREDICATE + i: p.name for i, p in enumerate(manifest.predicates)}
