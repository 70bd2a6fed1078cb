"""`dl2c verify --policy`: proofs, violations, planted faults, and what is refused."""

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from policy_proof.questions import onnx_file

from dl2c.commands.policy import Asked, report_on
from dl2c.policy.files import write_policy
from dl2c.policy.network import Interface, Layer, Network, NetworkPolicy
from dl2c.policy_proof.verdict import PolicyReport

pytestmark = pytest.mark.usefixtures("unoptimised")

pytest.importorskip("onnx")

TANK = """Theorem "tank"
ProgramVariables
  /* @var: bound=[0:5] */ Real l;
  Real u;
  Real t;
End.
Problem
  0 <= l & l <= 5 -> [{
    u := *; ?0 <= u & u <= 0.6; ?0 <= l + u - 0.25 & l + u - 0.25 <= 5;
    t := 0; {l' = u - 0.25, t' = 1 & t <= 1}
  }*@invariant(0 <= l & l <= 5)] 0 <= l
End.
End.
"""

SWITCH = """Theorem "switch"
ProgramVariables
  /* @var: bound=[-2:2] */ Real x;
End.
Problem
  -2 <= x & x <= 2
    -> [{ {?x <= 1; x := x + 1; ++ ?x >= -1; x := x - 1;} }*@invariant(-2 <= x & x <= 2)] x <= 2
End.
End.
"""


def tank_network(extra: tuple[tuple[float, float, float], ...] = ()) -> Network:
    """u = 0.5 - l / 10, and for each (weight, center, width) a tent of relu that is weight high."""
    rows, biases, last = [[1.0]], [0.0], [-0.125]
    for weight, center, width in extra:
        rows += [[1.0]] * 3
        biases += [width - center, -center, -width - center]
        last += [weight / width, -2 * weight / width, weight / width]
    first = Layer(np.array(rows), np.array(biases), "relu")
    return Network((), (first, Layer(np.array([last]), np.array([0.5]), "identity")))


def tank(tmp_path: Path, network: Network, **asked: Any) -> PolicyReport:
    (tmp_path / "tank.kyx").write_text(TANK)
    file = onnx_file(network, tmp_path / "net.onnx")
    given = Asked(file, inputs="l", outputs=("u=0:0.6",), seconds=20, **asked)
    return report_on(str(tmp_path / "tank.kyx"), given, {})


@pytest.mark.parametrize("arithmetic", ["double", "float32", "real"])
def test_a_good_policy_is_proved(tmp_path: Path, arithmetic: str) -> None:
    report = tank(tmp_path, tank_network(), arithmetic=arithmetic)
    assert (report.answer, report.share) == ("proved", 1.0)


def test_a_bad_policy_is_refuted_with_a_state(tmp_path: Path) -> None:
    report = tank(tmp_path, tank_network(((0.5, 4.9, 0.25),)))
    assert report.answer == "refuted" and report.violation is not None
    level, asked = report.violation.state["l"], report.violation.requests["u"]
    assert level + asked - Fraction(1, 4) > 5 and 0 <= level <= 5


def test_states_that_are_left_out_are_not_counted(tmp_path: Path) -> None:
    spike = tank_network(((0.5, 4.9, 0.25),))
    assert tank(tmp_path, spike, outside="l >= 4.5").answer == "proved"
    assert tank(tmp_path, spike, fixed=("l=4.9",)).answer == "refuted"
    assert tank(tmp_path, spike, fixed=("l=1",)).answer == "proved"


@pytest.mark.parametrize("seed", range(12))
def test_planted_faults_are_never_proved(tmp_path: Path, seed: int) -> None:
    """A tent so narrow that its states are less than a millionth of all."""
    rng = np.random.default_rng(seed)
    width = 2.0 ** -int(rng.integers(18, 22))
    center = float(np.float32(rng.uniform(4.8, 4.95)))
    report = tank(tmp_path, tank_network(((2.0, center, width),)), fixed=())
    assert report.answer != "proved"


def test_ties_count(tmp_path: Path) -> None:
    """Equal logits choose the first alternative, which is blocked for x > 1."""
    answers: list[str] = []
    for first in ([0.0, 0.0], [-1.0, 1.0]):
        layer = Layer(np.array([[first[0]], [first[1]]]), np.zeros(2), "identity")
        interface = Interface((("x", -2.0, 2.0),), "float32", "choice", (2,))
        policy = NetworkPolicy("switch", interface, Network((), (layer,)), False, {})
        write_policy(policy, tmp_path)
        (tmp_path / "switch.kyx").write_text(SWITCH)
        report = report_on(str(tmp_path / "switch.kyx"), Asked(tmp_path / "policy.json", seconds=20), {})
        answers.append(report.answer)
        if report.violation is not None:
            assert report.violation.state["x"] > 1
    assert answers == ["refuted", "proved"]


def test_nothing_is_proved_of_no_state(tmp_path: Path) -> None:
    report = tank(tmp_path, tank_network(), outside="l >= -1")
    assert any("says nothing" in w for w in report.warnings)


def test_json_and_exit_codes(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    given = ["--takes", "l", "--gives", "u=0:0.6", "--json"]
    for extra, code in (((), 0), (((0.5, 4.9, 0.25),), 1)):
        file = onnx_file(tank_network(extra), tmp_path / "net.onnx")
        found, out, _ = run(capsys, "verify", str(tmp_path / "tank.kyx"), "--policy", str(file), *given)
        data = json.loads(out)
        assert found == code and data["answer"] == data["claims"]["admissible"]
        follows = "not checked" if code else "proved"
        assert data["claims"]["kept"] == data["claims"]["for ever"] == follows
        assert (data["counterexample"] is None) == (code == 0)


WRONG = {
    ("--gives", "u"): "--gives takes NAME=LOW:HIGH",
    ("--gives", "w=0:1"): "no variable `w`",
    ("--gives", "u=0:1", "--takes", "l,u"): "takes 1 numbers; --takes names 2",
    ("--gives", "u=0:1", "--fix", "w=1"): "no name `w`",
    ("--gives", "u=0:1", "--fix", "l=9"): "outside the bounds",
    ("--gives", "u=0:1", "--fix", "l=a"): "--fix takes NAME=VALUE",
    ("--gives", "u=0:1", "--arithmetic", "half"): "no arithmetic 'half'",
    ("--gives", "u=0:1", "--except", "w > 1"): "w",
    ("--gives", "u=0:1", "--except", "l >"): "--except",
    ("--gives", "u=0:1", "--except", "1 / l > 0"): "without a value",
    ("--gives", "t=0:1"): "gives `u` its value",
}


@pytest.mark.parametrize("given", WRONG, ids=" ".join)
def test_mistakes_are_named(tmp_path: Path, capsys: Any, given: tuple[str, ...]) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    file = onnx_file(tank_network(), tmp_path / "net.onnx")
    code, _, err = run(capsys, "verify", str(tmp_path / "tank.kyx"), "--policy", str(file), *given)
    assert code == 1 and WRONG[given] in err


def test_options_of_policies_need_one(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    code, _, err = run(capsys, "verify", str(tmp_path / "tank.kyx"), "--fix", "l=1")
    assert code == 1 and "goes with --policy" in err


def test_what_the_environment_decides_afterwards_is_not_covered(tmp_path: Path, capsys: Any) -> None:
    late = TANK.replace("Real t;\n", "Real t;\n  /* @var: role=env, bound=[0:1] */ Real w;\n")
    late = late.replace("t := 0;", "w := *; ?0 <= w & w <= 1; t := 0;")
    (tmp_path / "late.kyx").write_text(late)
    file = onnx_file(tank_network(), tmp_path / "net.onnx")
    given = ("--policy", str(file), "--takes", "l", "--gives", "u=0:0.6")
    code, _, err = run(capsys, "verify", str(tmp_path / "late.kyx"), *given)
    assert code == 1 and "after the policy" in err
