"""Timing rows against each other: process CPU time, in rounds that visit every row.

Only ratios within one run mean anything: other programs slow all rows of a round alike, so the
ratio of a row is the median over the rounds of its rate by the baseline's in the same round.
"""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

from dl2c.experiments.bench.rows import BASELINE, Row

ROUNDS = 5
CHUNK = 0.005
"""CPU seconds between two looks at the clock, about."""


@dataclass(frozen=True, slots=True)
class Result:
    """Environment steps per CPU second of a row, their ratio to the baseline, and the ratios' range.

    `rates` are the steps per second of every round.
    """

    key: str
    title: str
    n: int
    rate: float
    ratio: float
    low: float
    high: float
    rates: tuple[float, ...]


def measure(
    rows: Sequence[Row],
    seconds: float,
    rounds: int = ROUNDS,
    note: Callable[[str], None] = lambda _: None,
    baseline: str = BASELINE,
) -> list[Result]:
    """Measure rows for about so many CPU seconds in all. `baseline` is the key of one of them."""
    slot = seconds / (rounds + 1) / len(rows)
    gc.collect()
    gc.freeze()  # what other libraries have made is not for these rows to trace
    try:
        chunks = {row.key: _chunk(row, min(slot, CHUNK)) for row in rows}
        rates: dict[str, list[float]] = {row.key: [] for row in rows}
        for k in range(rounds):
            for row in rows:
                note(f"round {k + 1} of {rounds}: {row.title}")
                rates[row.key].append(_rate(row, chunks[row.key], slot))
    finally:
        gc.unfreeze()
    return [_result(row, rates[row.key], rates[baseline]) for row in rows]


def growth(results: Sequence[Result]) -> dict[int, float]:
    """How much faster an environment step of a batch in C is than one of the smallest batch."""
    batches = [r for r in results if r.key.startswith("batch")]
    return {r.n: r.ratio / batches[0].ratio for r in batches}


def _chunk(row: Row, seconds: float) -> int:
    """How many calls take about so long; finding out warms the row up."""
    calls = 1
    while True:
        start = time.process_time()
        row.run(calls)
        if (elapsed := time.process_time() - start) >= seconds / 2:
            return max(1, round(calls * seconds / elapsed))
        calls *= 2


def _rate(row: Row, chunk: int, seconds: float) -> float:
    """Environment steps per CPU second over about so many."""
    calls, elapsed = 0, 0.0
    start = time.process_time()
    while elapsed < seconds:
        row.run(chunk)
        calls += chunk
        elapsed = time.process_time() - start
    return calls * row.n / elapsed


def _result(row: Row, rates: Sequence[float], baseline: Sequence[float]) -> Result:
    found = ratios(rates, baseline)
    least, most = min(found), max(found)
    return Result(row.key, row.title, row.n, median(rates), median(found), least, most, tuple(rates))


def ratios(rates: Sequence[float], reference: Sequence[float]) -> list[float]:
    """The ratio in every round."""
    return [rate / other for rate, other in zip(rates, reference, strict=True)]
