"""Predicates hold within tolerance, alike in lanes and one by one."""

import numpy as np
import pytest

from dl2c.env.opening import batch_options, open_library
from dl2c.source import Source

MODEL = """
Definitions
  /* @const: bound=[1:9] */ Real a;
  /* @safety: penalty=-1, on_failure=continue */
  Bool low(Real x) <-> x <= 1;
  /* @safety: penalty=-2, on_failure=continue */
  Bool still(Real x, Real y) <-> (y = 0 | x / a > 5);
  /* @stability: penalty=-4, on_failure=continue */
  Bool sure(Real x, Real y) <-> x / y < 1000;
  /* @progress: reward=8, on_success=continue */
  Bool there(Real x) <-> x > 2;
End.
ProgramVariables
  /* @var: bound=[0:1] */ Real x;
  /* @var: bound=[0:1] */ Real y;
End.
Problem
  0 <= x & x <= 1 & y = 0 -> [{ x := x; }*@invariant(low(x) & still(x, y) & sure(x, y) & there(x))]true
End.
"""
SOURCE = Source("relaxed.kyx", MODEL)

STATES = (
    (0.5, 0.0, -4.0),
    (1.0 + 5e-10, 0.0, -4.0),
    (1.0 + 5e-8, 0.0, -5.0),
    (0.5, 1e-10, -4.0),
    (0.5, 1e-3, -2.0),
    (0.5, -1e-3, -2.0),
    (60.0, 1.0, 7.0),
    (60.0, -1.0, 7.0),
    (2.0 - 1e-10, 0.0, 3.0),
    (np.nextafter(1.0, 2.0), -1e-10, 0.0),
)
"""Values of x and y, and what a step earns there."""


@pytest.mark.parametrize("n", [1, 7, 70])
def test_within_tolerance_a_predicate_holds(n: int) -> None:
    library = open_library(SOURCE, {})
    batch = library.batch(n, autoreset="disabled", **batch_options(library.manifest))
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    for first in range(len(STATES)):
        rows = [STATES[(first + i) % len(STATES)] for i in range(n)]
        for i, (x, y, _) in enumerate(rows):
            batch.set_state(i, [x, y], [3.0])
        batch.step()
        assert batch.rewards.tolist() == [earned for _, _, earned in rows]
