"""What models are told that mean something else than their author may think, and what they need not say."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import dl2c
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.lint.check import examine
from dl2c.pipeline import step_model
from dl2c.source import Source


def text_of(body: str, start: str = "0<=x&x<=1&w>=0&w<=10", above: str = "") -> str:
    return (
        'Theorem "m" ProgramVariables Real x; Real u; Real w; Real t; End.\n'
        f"{above} Problem {start} -> [{{ {body} }}*] x >= 0 End. End.\n"
    )


def said(text: str, code: str, **options: Any) -> list[Diagnostic]:
    return [
        d
        for d in examine(Source("m.kyx", text), resolve_options({"default_bound": "-50:50"} | options))
        if d.code == code
    ]


FLOW = "t := 0; {x' = 1, t' = 1 & t <= 1}"


def test_an_if_beside_a_choice_is_pointed_out() -> None:
    choice = "{ if (x <= 1) { w := 1; } else { w := 2; } ++ w := 3; }"
    (found,) = said(text_of(f"{choice} {FLOW}"), "if-in-choice")
    assert "3 alternatives" in found.title
    assert found.span.text == "if (x <= 1) { w := 1; } else { w := 2; }"
    env: Any = dl2c.make(text_of(f"{choice} {FLOW}"), default_bound="-50:50")
    assert env.action_space.n == 3


@pytest.mark.parametrize(
    "choice",
    [
        "if (x <= 1) { w := 1; } else { w := 2; }",
        "if (x <= 1) { w := 1; ++ w := 3; } else { w := 2; }",
        "{ w := 1; ++ w := 2; if (x <= 1) { w := 4; } }",
        "if (x <= 1) { w := 1; } else { if (x <= 2) { w := 2; } else { w := 5; } }",
    ],
)
def test_other_uses_of_if_are_not(choice: str) -> None:
    assert not said(text_of(f"{choice} {FLOW}"), "if-in-choice")


def test_a_strict_clock_is_pointed_out() -> None:
    strict = text_of(FLOW.replace("t <= 1", "t < 2 & x >= -3"))
    (found,) = said(strict, "strict-clock")
    assert found.span.text == "t < 2" and "`<=`" in found.help and "0.1 s" in found.label
    assert not said(strict, "default-dt"), "one is enough"
    assert not said(strict, "strict-clock", dt=0.5)
    assert said(text_of(FLOW.replace("t <= 1", "2 > t")), "strict-clock")
    assert not said(text_of(FLOW.replace("t <= 1", "t < 2 & t <= 3")), "strict-clock")
    assert said(text_of(FLOW.replace("t <= 1", "x >= -3")), "default-dt")


NEAR = f"u := *; ?abs(u - w) <= 2; {FLOW}"


@pytest.mark.parametrize(
    ("start", "above"),
    [
        ("0<=x&x<=1&w>=0&w<=10", ""),
        ("0<=x&x<=1&w>=0&w^2<=100", ""),
    ],
)
def test_an_input_near_a_bounded_name_has_limits(start: str, above: str) -> None:
    env: Any = dl2c.make(text_of(NEAR, start, above))
    box = env.action_space
    assert box.low == pytest.approx([-2], abs=1e-5) and box.high == pytest.approx([12], abs=1e-5)
    env.reset(seed=0)
    w = env.state["w"]
    for asked, given in ((w, w), (-2.0, w - 2), (12.0, w + 2)):
        info = env.step(np.array([asked], dtype=box.dtype))[4]
        assert float(info["executed_action"][0]) == pytest.approx(given, abs=1e-5)


def test_a_declared_bound_of_the_other_name_is_enough() -> None:
    text = text_of(NEAR, "0<=x&x<=1").replace("Real w;", "\n/* @var: bound=[-1:3] */\nReal w;\n")
    box: Any = dl2c.make(text, default_bound="-50:50").action_space
    assert box.low == pytest.approx([-3], abs=1e-5) and box.high == pytest.approx([5], abs=1e-5)


def test_without_any_bound_the_input_is_still_refused() -> None:
    with pytest.raises(CompileError) as refused:
        dl2c.make(text_of(NEAR, "0<=x&x<=1&w>=0"))
    assert "unbounded-input" in {d.code for d in refused.value.diagnostics}


def test_limits_that_tests_alone_imply_stay_as_they_are() -> None:

    _, paths = step_model(
        Source("m.kyx", text_of(f"u := *; ?u <= w & -3 <= u & u <= 4; {FLOW}")), resolve_options({})
    )
    (found,) = paths.inputs
    assert (found.low, found.high) == (Fraction(-3), Fraction(4))
