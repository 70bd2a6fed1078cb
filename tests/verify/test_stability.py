"""Theorems about stability: witnesses are found, and nothing false is proved with them."""

import pytest

from dl2c.options import Options
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove
from dl2c.verify.report import Report

STABLE = (
    r"\forall eps (eps > 0 -> \exists del (del > 0 & \forall x \forall y"
    r" (x^2 + y^2 < del^2 -> [{%s}*] x^2 + y^2 < eps^2)))"
)
ATTRACTED = (
    r"\forall del (del > 0 -> \forall eps (eps > 0 -> \exists T (T >= 0 & \forall x \forall y"
    r" (x^2 + y^2 < del^2 -> [t := 0; {%s}*] (t >= T -> x^2 + y^2 < eps^2)))))"
)
FALLING = "{x' = -x + y, y' = -x - 2*y, t' = 1} ++ {x' = -3*x, y' = -y, t' = 1}"
TURNING = "{x' = -y, y' = x, t' = 1}"
HALVES = (
    "{x' = -x/8 - y, y' = 2*x - y/8, t' = 1 & x >= 0} ++ {x' = -x/8 - 2*y, y' = x - y/8, t' = 1 & x <= 0}"
)
GROWING = "{x' = x/9, y' = -y, t' = 1}"
ELLIPSES = "Real f(Real x, Real y) = 2*x^2 + y^2; Real g(Real x, Real y) = x^2/2 + y^2;"


def answer(problem: str, definitions: str = "", seconds: float = 20.0) -> Report:
    text = f'ArchiveEntry "S"\nDefinitions {definitions} End.\nProgramVariables Real x, y, t; End.\n'
    return prove(Source("s.kyx", f"{text}Problem {problem} End.\nEnd.\n"), Options(), Limits(5.0, seconds, 1))


@pytest.mark.parametrize(
    ("problem", "definitions"),
    [
        (STABLE % FALLING, ""),
        (ATTRACTED % FALLING, ""),
        (STABLE % TURNING, ""),
        (STABLE % HALVES, ELLIPSES),
        (ATTRACTED % HALVES, ELLIPSES),
        (STABLE.replace("{%s}*", "%s") % TURNING, ""),
    ],
)
def test_witnesses_are_found(problem: str, definitions: str) -> None:
    found = answer(problem, definitions)
    assert found.answer == "proved" and found.invented
    assert any(text.startswith(("del = ", "T = ")) for text in found.invariants)


def test_a_tactic_may_name_the_functions() -> None:
    listed = 'Tactic "T" stabilityStateMLF("2*x^2+y^2::x^2/2+y^2::nil") End.\n'
    text = 'ArchiveEntry "S"\nProgramVariables Real x, y, t; End.\n'
    source = Source("s.kyx", f"{text}Problem {STABLE % HALVES} End.\n{listed}End.\n")
    assert prove(source, Options(), Limits(5.0, 20.0, 1)).answer == "proved"


@pytest.mark.parametrize(
    ("problem", "definitions"),
    [
        (STABLE % GROWING, ""),
        (ATTRACTED % GROWING, ""),
        (ATTRACTED % TURNING, ""),
        (STABLE % f"{FALLING} ++ {GROWING}", ""),
        (ATTRACTED % f"{FALLING} ++ {TURNING}", ""),
        (STABLE % HALVES.replace(" & x >= 0", "").replace(" & x <= 0", ""), ELLIPSES),  # switched at will
        (STABLE % f"{FALLING}; x := 2*x", ""),
        (
            ATTRACTED.replace("[t := 0;", "[t := 0; T := t - 1;") % FALLING,
            "",
        ),  # T is not the witness any more
        (ATTRACTED.replace("{%s}*", "{?t < 1; %s}*; x := x + 1") % FALLING, ""),
        (STABLE.replace("del > 0 &", "del > 2*eps &") % FALLING, ""),
        (STABLE.replace("eps > 0 ->", "eps >= 0 ->") % FALLING, ""),
        (ATTRACTED.replace("eps > 0 ->", "eps^2 >= 0 ->") % FALLING, ""),  # the witness divides by eps
        (r"\exists x (x > 0 & [{x' = -1 & x >= -1}] x > 0)", ""),
        (r"\exists x \forall y (y > 0 -> [{y' = -1}] y > x)", ""),
    ],
)
def test_nothing_false_is_proved(problem: str, definitions: str) -> None:
    assert answer(problem, definitions, 8.0).answer not in ("proved", "proved-if-defined")
