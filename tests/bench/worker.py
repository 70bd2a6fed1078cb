"""What one tree's environments do, asked by `against.py`: rows of one model, in a process of their own.

    python worker.py MODEL

prints the keys of its rows as JSON, then for each key that it reads the environment steps per second of
processor time. PYTHONPATH says which tree is measured.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import dl2c
from dl2c.experiments.bench.rows import POLICY, batch_row, rows, subject
from dl2c.source import Source

KEPT = ("gym", "batch", "scalar", "vector", "sb3_")
"""Rows of dl2c itself begin so."""

SHARED = "shared1024"
"""A vector environment that returns its own arrays."""

DOPRI = "dopri1024"
"""A batch whose flows dopri5 follows, where not all have a closed form."""

SOLVER: dict[str, Any] = {"integrator": "dopri5", "rtol": 1e-6, "atol": 1e-6}

SLICE = 0.08
"""Seconds of processor time for one answer."""

Run = Callable[[int], None]


def rows_of(model: Path) -> dict[str, tuple[int, Run]]:
    """By key: how many environments a call steps, and what makes so many calls."""
    source = Source.read(model)
    what = subject(source, {})
    found, _ = rows(what)
    kept = {row.key: (row.n, row.run) for row in found if row.key.startswith(KEPT)}
    if any(flow.kernel != "exact" for flow in what.library.manifest.flows):
        kept[DOPRI] = (1024, batch_row(subject(source, SOLVER), 1024).run)
    return kept | {SHARED: (1024, _shared(model, 1024))}


def _shared(model: Path, n: int) -> Run:
    env: Any = dl2c.make_vec(model, n, copy=False, **POLICY)
    env.reset(seed=0)
    space = env.action_space
    actions: Any = (
        {key: np.zeros(part.shape, part.dtype) for key, part in space.spaces.items()}
        if hasattr(space, "spaces")
        else np.zeros(space.shape, space.dtype)
    )

    def run(calls: int) -> None:
        for _ in range(calls):
            env.step(actions)

    return run


def calls_of(run: Run) -> int:
    """How many calls take about `SLICE`; finding out warms the row up.

    Of two runs the shorter counts: what happens once, such as a collection of garbage, may take longer than a
    thousand calls.
    """
    calls = 1
    while (took := min(_seconds(run, calls), _seconds(run, calls))) < SLICE / 4:
        calls *= 2
    return max(1, round(calls * SLICE / took))


def _seconds(run: Run, calls: int) -> float:
    """Processor time."""
    begun = time.process_time()
    run(calls)
    return time.process_time() - begun


def main() -> None:
    found = rows_of(Path(sys.argv[1]))
    calls = {key: calls_of(run) for key, (_, run) in found.items()}
    print(json.dumps(list(found)), flush=True)
    for line in sys.stdin:
        key = line.strip()
        n, run = found[key]
        run(1)  # the host of a virtual machine may have to fetch memory that lay idle meanwhile
        print(n * calls[key] / _seconds(run, calls[key]), flush=True)


if __name__ == "__main__":
    main()
