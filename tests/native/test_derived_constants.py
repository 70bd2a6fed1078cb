"""Quotients and functions of constants that steps read instead of computing them."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from dl2c.emit.derived import MOST, derived_constants
from dl2c.env.opening import batch_options, open_library
from dl2c.ir.printer import print_term
from dl2c.options import Options
from dl2c.pipeline import Compilation
from dl2c.source import Source

TEXT = """
Definitions
  /* @const: bound=[1:9] */ Real a;
  /* @const: bound=[1:9] */ Real b;
  /* @const: bound=[-1:1] */ Real c;
End.
ProgramVariables
  /* @var: bound=[0:1] */ Real x;
  /* @var: bound=[0:1] */ Real y;
End.
Problem
  0 <= x & x <= 1 & 0 <= y & y <= 1 -> [
    {
      { ?x <= 100 * a / b; x := x + 1; } ++ { ?x > 100 * a / b; x := 0; }
    }*
  ](y < c / a & a / 2 < 5 & x * c / (a * c) < y)
End.
"""


def derived_of(text: str) -> list[str]:
    build = Compilation(Source("model.kyx", text), Options()).planned.build
    return [print_term(term) for term in derived_constants(build.model, build.paths).symbols]


def test_only_what_is_always_finite_is_derived() -> None:
    assert derived_of(TEXT) == ["c / a", "100 * a / b"]


def test_there_are_no_more_than_fit() -> None:
    atoms = " & ".join(f"y < {k + 2} + a / (b + {k + 2})" for k in range(MOST + 4))
    assert len(derived_of(TEXT.replace("y < c / a", atoms))) == MOST


REWARDED = """
Definitions
  /* @const: bound=[1:9] */ Real a;
  /* @const: bound=[1:9] */ Real b;
  /* @safety: reward=a/b-sqrt(b), on_failure=continue */
  Bool fine(Real x) <-> x <= 100 * a / b;
End.
ProgramVariables
  /* @var: bound=[0:1] */ Real x;
End.
Problem
  0 <= x & x <= 1 -> [{ x := x + 1; }*@invariant(fine(x))]true
End.
"""


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
@pytest.mark.parametrize("n", [1, 5, 70])
def test_every_episode_has_its_own(n: int, mode: str) -> None:
    """However its constants came: drawn one by one or in lanes, given, set or restored."""
    library = open_library(Source("rewarded.kyx", REWARDED), {"max_episode_steps": 4})
    batch = library.batch(n, autoreset=mode, **batch_options(library.manifest))

    def stepped(rows: Iterable[int]) -> None:
        constants = [batch.get_state(i)[1] for i in range(n)]
        batch.step()
        for i in rows:
            a, b = constants[i]
            assert batch.rewards[i] == a / b - math.sqrt(b)

    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    for step in range(20):
        begins = mode == "next_step" and step % 5 == 4
        stepped(() if begins else range(n))
    last = n - 1
    batch.reset()
    batch.reset_to(last, 1, [0.5], [2.0, 7.0])
    stepped([last])
    kept = batch.save(last)
    batch.set_state(last, [0.25], [9.0, 1.5])
    stepped([last])
    batch.restore(last, kept)
    assert list(batch.get_state(last)[1]) == [2.0, 7.0]
    stepped([last])
