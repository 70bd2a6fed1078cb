"""How far states miss what is proved of them (proved_states.py)."""

from dataclasses import replace
from fractions import Fraction

import pytest
from proved_states import FURTHER, ULPS, Promise, promise_of, told

from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import Compilation
from dl2c.source import Source

LOOP = "[{{x' = 1, y' = 2*x & x <= 1}}*@invariant(x >= 0)] y = x^2"


LIMITED = replace(Options(), default_bound=(Fraction(-1), Fraction(1)))


def promised(conclusion: str, precondition: str = "x = 0 & y = 0") -> Promise | None:
    declared = 'ArchiveEntry "M"\nProgramVariables\n  Real x, y;\nEnd.\nProblem\n'
    text = f"{declared}{precondition} -> {conclusion}\nEnd.\nEnd.\n"
    archive, _ = parse_archive(Source("m.kyx", text))
    return promise_of(Compilation(archive.entries[0], LIMITED))


@pytest.mark.parametrize(
    ("state", "miss", "word"),
    [
        ((0.5, 0.25), Fraction(0), "exact"),
        ((0.1, 0.1 * 0.1), ULPS, "ulps"),
        ((0.5, 0.25 + 1e-11), Fraction(1, 10**9), "1e-09"),
        ((-1e-13, 0.0), Fraction(1, 10**12), "1e-12"),
        ((0.5, 0.75), FURTHER, "missed"),
    ],
)
def test_misses_of_postcondition_and_invariant(state: tuple[float, float], miss: Fraction, word: str) -> None:
    promise = promised(LOOP)
    assert promise is not None
    assert promise.missed(state, ()) == miss
    assert told([Fraction(0), miss]) == word


@pytest.mark.parametrize(
    "conclusion", ["<{x := 1;}*> x = 1", "[{x := 1;}*] sin(x) <= y", "\\exists c [{x := c;}*] x = c"]
)
def test_what_is_not_proved_of_boxes_or_has_no_exact_arithmetic_promises_nothing(conclusion: str) -> None:
    assert promised(conclusion) is None
