"""Resets by `initial_distribution="z3"`: a random target, and the initial state nearest to it.

For comparison with the paper only: slow, and not uniform. Where Z3 does not decide in time, or what it
finds does not satisfy the precondition once it is rounded to doubles, the state is drawn uniformly.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dl2c.env.opening import compilation_of
from dl2c.env.state import reset_state
from dl2c.native.binding import Batch
from dl2c.native.errors import ResetFailed
from dl2c.native.manifest import Manifest
from dl2c.options import UnknownOption
from dl2c.source import Source

TIMEOUT_S = 10.0
"""For each reset."""


def check_uniform(manifest: Manifest) -> None:
    """Refuse what only a single environment does. Raises `UnknownOption`."""
    if manifest.options.get("initial_distribution") == "z3":
        raise UnknownOption(
            "`initial_distribution` 'z3' is for single environments, `dl2c.make`; 'target' is for all"
        )


class Targeted:
    """Draws targets and asks for the states nearest to them."""

    def __init__(self, source: Source, options: Mapping[str, Any]) -> None:
        from dl2c.interval.bounded import initial_box

        self._model = compilation_of(source, options).lowered.drawn
        box = {s.name: i for s, i in (initial_box(self._model) or {}).items()}
        self._ranges = {n: (box[n].low, box[n].high) for n in self._model.sampled if n in box}

    def reset(self, manifest: Manifest, batch: Batch, seed: int | None, rng: np.random.Generator) -> str:
        """Begin an episode in such a state, and say how that went: "nearest", "invalid" where rounding
        left the initial states, "unknown" or "unsat"; in these cases no episode was begun."""
        from dl2c.smt.target import nearest

        target = {n: float(rng.uniform(low, high)) for n, (low, high) in self._ranges.items()}
        widths = {n: high - low for n, (low, high) in self._ranges.items()}
        found = nearest(self._model, target, widths, TIMEOUT_S)
        if found.status != "sat":
            return found.status
        rest = {v.name: 0.0 for v in self._model.variables if v.name not in found.state}
        try:
            reset_state(manifest, batch, 0, seed, {**rest, **found.state})
        except ResetFailed:
            return "invalid"
        return "nearest"
