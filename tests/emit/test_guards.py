"""Guards of paths become C as often as they stand in it."""

import re
from collections import Counter
from collections.abc import Callable
from fractions import Fraction

import pytest

from dl2c.emit.cfile import BYTE
from dl2c.emit.claim import Claim
from dl2c.emit.leaf import Leaves
from dl2c.ir.model import Formula
from dl2c.options import Options
from dl2c.pipeline import Compilation
from dl2c.source import Source


def model_of(paths: int) -> str:
    """As many alternatives, each with a test."""
    choice = " ++ ".join(f"{{ ?x + y <= {k} + x * y; v := {k}; }}" for k in range(paths))
    return (
        "ProgramVariables Real x; Real y; Real v; Real t; End.\n"
        f"Problem x = 0 & y = 0 & v = 0 & t = 0 -> [{{ {choice} t := 0; "
        "{ x' = v, t' = 1 & t <= 1 } }*] x >= 0 End."
    )


@pytest.mark.parametrize(("paths", "times"), [(2, 2), (BYTE, 1)])
def test_guards_are_computed_where_they_stand(
    paths: int, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Few are tested beside the facts too, many only by themselves."""
    asked: Counter[str] = Counter()
    condition: Callable[..., str] = Leaves.condition

    def counted(leaves: Leaves, name: str, formula: Formula, *rest: object) -> str:
        asked[name] += 1
        return condition(leaves, name, formula, *rest)

    monkeypatch.setattr(Leaves, "condition", counted)
    options = Options(default_bound=(Fraction(-10), Fraction(10)))
    files = Compilation(Source("guards.kyx", model_of(paths)), options).emitted(Claim("guards", ""))
    guards = {name: count for name, count in asked.items() if name.endswith("_guard")}
    assert guards == {f"path{k}_guard": times for k in range(paths)}
    text = next(text for name, text in files.items() if name.endswith(".c"))
    assert len(re.findall(r"(?m)^ .*\bpath0_guard\(", text)) == times
