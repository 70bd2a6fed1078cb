"""How slow the processor is just now: limits of seconds are those of a machine of the usual kind."""

import time
from fractions import Fraction

FIXED_WORK_S = 0.1
"""Processor time of `_fixed_work` on such a machine."""


def slowness() -> float:
    """How many times longer than there the fixed work takes; at least 1."""
    times: list[float] = []
    for _ in range(3):
        begun = time.thread_time()
        _fixed_work()
        times.append(time.thread_time() - begun)
    return max(1.0, sorted(times)[1] / FIXED_WORK_S)


def _fixed_work() -> None:
    """Exact arithmetic and tables of tuples, as compiling is made of."""
    known: dict[tuple[int, Fraction], Fraction] = {}
    for k in range(20_000):
        term = Fraction(k % 97 + 1, k % 89 + 1)
        known[k % 1000, term] = known.get((k % 1000, term), Fraction(0)) + term
