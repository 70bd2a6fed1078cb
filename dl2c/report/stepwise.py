"""A recorded episode checked step by step, each from the state before it.

For episodes of pages: WebAssembly has no sin or exp of its own, so that a page brings functions along whose
last bits are not those of this machine. One step hides no larger error behind a chaotic motion.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from dl2c.emit.cexpr import INEXACT
from dl2c.env.actions import encoding
from dl2c.env.infos import STATUS, reason_names
from dl2c.env.opening import batch_options, compilation_of, open_library
from dl2c.env.state import read_state, reset_state
from dl2c.native.binding import Batch
from dl2c.report.episode import WEB, Episode, Moment, action_of

TOLERANCE = 1e-12
"""Relative to the size of a number, absolute below 1."""


def is_inexact(episode: Episode) -> bool:
    """Whether it may be of other bits here, since it comes from a page and its model calls such functions."""
    if episode.engine != WEB:
        return False
    found = compilation_of(episode.source, episode.options)
    return any(INEXACT.search(text) for text in found.emitted(found.claim()).values())


def stepwise_difference(episode: Episode) -> str:
    """Where a step leads elsewhere than was recorded, by more than the tolerance; "" where none does.

    Raises what `Dl2cEnv` and its reset raise.
    """
    library = open_library(episode.source, episode.options)
    batch = library.batch(1, autoreset="disabled", **batch_options(library.manifest))
    try:
        return next(_differences(episode, batch), "")
    finally:
        batch.close()


def _differences(episode: Episode, batch: Batch) -> Iterator[str]:
    manifest = batch.library.manifest
    write, reasons = encoding(manifest).writer(batch), reason_names(manifest)
    _begin(episode, batch)
    yield from _apart(episode.initial, read_state(manifest, batch), "the initial state")
    names = [q.name for q in manifest.variables], [q.name for q in manifest.constants]
    before = episode.initial
    for k, recorded in enumerate(episode.moments, 1):
        batch.set_state(0, *(np.array([before[n] for n in own]) for own in names))
        write(action_of(recorded.action))
        batch.step()
        yield from _apart(recorded.state, read_state(manifest, batch), f"step {k}")
        yield from _otherwise(recorded, batch, f"step {k}")
        before = recorded.state
    if episode.moments:
        end = STATUS[int(batch.status[0])], reasons[int(batch.reason[0])]
        if end != (episode.status, episode.reason):
            yield f"the end differs: it is {end}, recorded was {(episode.status, episode.reason)}"


def _begin(episode: Episode, batch: Batch) -> None:
    start = episode.start
    if start.state is None:
        batch.reset(seeds=np.array([start.seed], np.uint64))
    else:
        reset_state(batch.library.manifest, batch, 0, start.seed, start.state)


def _apart(recorded: Any, found: Any, where: str) -> Iterator[str]:
    for name, value in recorded.items():
        if not _near(value, found[name]):
            yield f"{where} differs: {name} is {found[name]!r}, recorded was {value!r}"


def _otherwise(recorded: Moment, batch: Batch, where: str) -> Iterator[str]:
    """What was said of a step, but for the time, which sums up."""
    numbers = {"reward": float(batch.rewards[0]), "duration": float(batch.duration[0])}
    yield from _apart({n: getattr(recorded, n) for n in numbers}, numbers, where)
    facts = int(batch.cost[0]), bool(batch.blocked[0]), bool(batch.postcondition[0])
    if facts != (recorded.cost, recorded.blocked, recorded.postcondition):
        yield f"{where} differs: cost, blocked and postcondition are {facts}"


def _near(one: float, other: float) -> bool:
    if not (math.isfinite(one) and math.isfinite(other)):
        return one == other or (math.isnan(one) and math.isnan(other))
    return abs(one - other) <= TOLERANCE * max(1.0, abs(one), abs(other))
