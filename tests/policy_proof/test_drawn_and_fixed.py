"""Policies of models in which the environment draws before they observe, names have one value, or nothing is
left to decide.
"""

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from policy_proof.questions import onnx_file

from dl2c.commands.policy import Asked, report_on
from dl2c.policy.network import Layer, Network
from dl2c.policy_proof.question import NotCovered
from dl2c.policy_proof.verdict import decimal, percent

pytest.importorskip("onnx")

LED = """Theorem "Led"
ProgramVariables
  /* @var: bound=[{x}] */ Real x;
  /* @var: bound=[{w}], role=env */ Real w;
  /* @var: bound=[0:2] */ Real u;
  Real t;
End.
Problem
  0 <= x & x <= 10 & 0 <= w & w <= 1 -> [{{
    w := *; ?0 <= w & w <= 1;
    u := *; ?0 <= u & u <= 2 & w - 0.1 <= u & u <= w + 0.5;
    t := 0; {{t' = 1 & t <= 1}}
  }}*@invariant(0 <= x & x <= 10)] 0 <= x
End.
End.
"""

OVERWRITTEN = """Theorem "Overwritten"
ProgramVariables
  /* @var: bound=[0:1], role=env */ Real w;
  /* @var: bound=[0:1], role=env */ Real z;
  /* @var: bound=[0:1] */ Real x;
  /* @var: bound=[0:2], observe=false */ Real u;
  Real t;
End.
Problem
  0 <= w & w <= 0.75 & 0 <= z & z <= 1 & 0 <= x & x <= 1 -> [{
    /* @choice: name="radio", role=env */ {?true; ++ {z := w; w := 1;}}
    u := *; ?0 <= u & u <= 2 & (w < 1 | z <= 0.3 | u >= 1 + x); w := 0.5 * z;
    t := 0; {t' = 1 & t <= 1}
  }*@invariant(0 <= w & w <= 0.75)] w <= 1
End.
End.
"""

NOTHING = """Theorem "Nothing"
ProgramVariables
  /* @var: bound=[0:1], role=env */ Real w;
  /* @var: bound=[0:2], observe=false */ Real u;
  Real t;
End.
Problem
  w = 0 -> [{
    {/* @choice: name="radio", role=env */ {w := 1; ++ {w := *; ?0 <= w & w <= 1;}}}
    u := *; ?0 <= u & u <= 2 & w + 0.5 <= u & u <= w + 1;
    t := 0; {t' = 1 & t <= 1}
  }*@invariant(0 <= w & w <= 1)] 0 <= w
End.
End.
"""


def affine(folder: Path, weight: list[float], bias: float) -> Path:
    """A network with one output, which is no less than 0."""
    layers = (Layer(np.array([weight]), np.array([bias]), "relu"), Layer(np.eye(1), np.zeros(1), "identity"))
    return onnx_file(Network((), layers), folder / "net.onnx")


def led(folder: Path, x: str = "0:10", w: str = "0:1") -> str:
    (folder / "led.kyx").write_text(LED.format(x=x, w=w))
    return str(folder / "led.kyx")


def asked(net: Path, inputs: str = "x,w", **given: Any) -> Asked:
    return Asked(net, inputs=inputs, outputs=("u=0:2",), seconds=10, **given)


def test_a_name_whose_bounds_are_equal_has_one_value(tmp_path: Path) -> None:
    """1/10 is no double: a box around it has none of the states."""
    model = led(tmp_path, x="0.1:0.1")
    report = report_on(model, asked(affine(tmp_path, [0.0, 0.0], 0.9)), {})
    assert report.answer == "refuted" and report.violation is not None
    assert report.violation.state["x"] == Fraction(1, 10)
    fixed = report_on(model, asked(affine(tmp_path, [0.0, 0.0], 0.9), fixed=("x=0.1",)), {})
    assert fixed.violation == report.violation
    assert report_on(model, asked(affine(tmp_path, [0.0, 1.0], 0.1)), {}).answer == "proved"


@pytest.mark.parametrize("w", ["0.25:0.25", "0:1"])
def test_what_is_drawn_may_have_one_value_too(tmp_path: Path, w: str) -> None:
    """By its bounds, or by --fix, which is about what the policy observes."""
    model, net = led(tmp_path, w=w), affine(tmp_path, [0.0, 0.0], 0.5)
    fixed = () if w == "0.25:0.25" else ("w=0.25",)
    report = report_on(model, asked(net, fixed=fixed), {})
    assert report.answer == "proved" and "w = 0.25" in report.covers[0]
    wrong = report_on(model, asked(affine(tmp_path, [0.0, 0.0], 0.8), fixed=fixed), {})
    assert wrong.answer == "refuted" and wrong.violation is not None
    assert wrong.violation.state["w"] == Fraction(1, 4)
    if fixed:
        assert report_on(model, asked(net), {}).answer == "refuted"


def test_what_the_environment_computes_is_not_fixed(tmp_path: Path) -> None:
    (tmp_path / "m.kyx").write_text(OVERWRITTEN)
    net = affine(tmp_path, [0.0], 0.5)
    with pytest.raises(NotCovered) as refused:
        report_on(str(tmp_path / "m.kyx"), asked(net, "x", fixed=("w=0.5",)), {})
    assert "the environment computes `w`" in str(refused.value)


def test_the_state_of_a_violation_is_one_that_is_assumed(tmp_path: Path) -> None:
    """Though the policy observes something else in it."""
    (tmp_path / "m.kyx").write_text(OVERWRITTEN)
    net = affine(tmp_path, [0.0, 0.0], 0.5)
    report = report_on(str(tmp_path / "m.kyx"), asked(net, "w,x"), {})
    assert report.answer == "refuted" and report.violation is not None
    assert Fraction(3, 10) < report.violation.state["w"] <= Fraction(3, 4)


def test_there_is_no_picture_of_a_question_without_names(tmp_path: Path) -> None:
    """Here the first one, which is refuted, has none; the second one has w."""
    pytest.importorskip("matplotlib")
    (tmp_path / "m.kyx").write_text(NOTHING.replace("@invariant(0 <= w & w <= 1)", "@invariant(0 < 1)"))
    net = affine(tmp_path, [0.5], 0.2)
    picture = tmp_path / "seen.png"
    report = report_on(str(tmp_path / "m.kyx"), asked(net, "w", picture=picture), {})
    assert report.answer == "refuted" and picture.exists()


UNDECIDED = """Theorem "undecided"
ProgramVariables
  /* @var: bound=[0:1] */ Real x;
End.
Problem x = 0 -> [{{x' = 1 & x <= 1}}*] x <= 1 End.
End.
"""


ALL_KNOWN = NOTHING.replace("w := *; ?0 <= w & w <= 1;", "w := 0;").replace("0 <= w & w <= 1)", "0 < 1)")


@pytest.mark.parametrize("text", [UNDECIDED, ALL_KNOWN])
def test_a_benchmark_without_anything_to_judge_is_refused(tmp_path: Path, capsys: Any, text: str) -> None:
    (tmp_path / "m.kyx").write_text(text)
    model = str(tmp_path / "m.kyx")
    code, _, err = run(capsys, "bench", model, "--verify", "--seconds", "0.1")
    assert code == 1 and "there is nothing to measure" in err
    code, _, err = run(capsys, "bench", model, "--seconds", "0")
    assert code == 2 and "--seconds" in err


def test_outputs_are_looked_at_before_the_search(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    model, net = led(tmp_path), affine(tmp_path, [0.0, 1.0], 0.1)
    about = ("verify", model, "--policy", str(net), "--takes", "x,w", "--gives", "u=0:2")
    same = str(tmp_path / "one.json")
    monkeypatch.setattr("dl2c.commands.policy.report_on", lambda *_: pytest.fail("it searches"))
    code, _, err = run(capsys, *about, "--certificate", same, "--resume", same)
    assert code == 1 and "two outputs would be written there" in err
    code, _, err = run(capsys, *about, "--certificate", str(tmp_path))
    assert code == 1 and "a folder of this name is there" in err
    code, _, err = run(capsys, *about, "--check", same, "--certificate", str(tmp_path / "b.json"))
    assert code == 1 and "--certificate" in err


def test_ctrl_c_after_the_proof_keeps_it(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    model, net = led(tmp_path), affine(tmp_path, [0.0, 1.0], 0.1)

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dl2c.policy_proof.onward._answers", interrupted)
    certificate = tmp_path / "c.json"
    report = report_on(model, asked(net, certificate=certificate), {})
    assert report.answer == "proved" and report.interrupted and json.loads(certificate.read_text())
    assert report.claims["kept"] == "not checked"


@pytest.mark.parametrize("share, text", [(1.0, "100 %"), (1 - 1e-12, "99.99 %"), (0.5, "50 %"), (0.0, "0 %")])
def test_only_all_is_shown_as_all(share: float, text: str) -> None:
    assert percent(share) == text


def test_small_numbers_are_not_shown_as_zero() -> None:
    assert decimal(Fraction(1, 10**400)) != "0.0" and decimal(Fraction(1, 3)) == "1/3"
