"""With action_map=squash values are shares of what is admissible: what is proved is that there are such."""

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from selection import quick_among

import dl2c
from dl2c.commands.policy import Asked, checked_certificate, questions_of, report_on
from dl2c.ir.model import Symbol
from dl2c.policy.files import write_policy
from dl2c.policy.network import Interface, Layer, Network, NetworkPolicy
from dl2c.policy_proof.cases import _spread  # pyright: ignore[reportPrivateUsage]
from dl2c.policy_proof.confirm import IMPOSSIBLE
from dl2c.policy_proof.exact import violation
from dl2c.policy_proof.question import Arithmetic, NotCovered, Request

pytestmark = pytest.mark.usefixtures("unoptimised")

PUSH = """Theorem "push"
ProgramVariables
  /* @var: bound=[-2:2] */ Real x;
  /* @var: bound=[-1:1] */ Real u;
  /* @var: bound=[-1:1] */ Real w;
End.
Problem
  -2 <= x & x <= 2 -> [{
    { /* @choice: name="how" */
      { x := x / 2; ++ { u := *; w := *; ?u >= x & {test}; x := x / 4 + u; } ++ { ?x = 0; x := 1; } }
    }
  }*@invariant(-2 <= x & x <= 2)] x <= 2
End.
End.
"""

LATER = """Theorem "later"
ProgramVariables
  /* @var: bound=[-2:2] */ Real x;
  /* @var: bound=[-1:1] */ Real u;
  /* @var: bound=[0:1], role=env */ Real y;
End.
Problem
  -2 <= x & x <= 2 -> [{
    {u := *; y := *; ?u + y <= x;} x := x / 2;
  }*@invariant(-2 <= x & x <= 2)] x <= 2
End.
End.
"""

SQUASH = {"action_map": "squash"}


def model(folder: Path, text: str = PUSH, test: str = "u * w >= x / 2") -> str:
    (folder / "model.kyx").write_text(text.replace("{test}", test))
    return str(folder / "model.kyx")


LIMITS = {"x": (-2.0, 2.0), "u": (-1.0, 1.0), "w": (-1.0, 1.0), "y": (0.0, 1.0)}


def policy(
    folder: Path,
    choice: tuple[float, float] | None = (0.0, 0.0),
    seen: str = "xuw",
    inputs: str = "uw",
    name: str = "push",
) -> Path:
    """Its values are in the middle, its choice, if any, is `slope * x + offset`."""
    outputs = len(inputs) + (choice is not None)
    weight, bias = np.zeros((outputs, len(seen))), np.zeros(outputs)
    if choice is not None:
        weight[-1, 0], bias[-1] = choice
    interface = Interface(
        tuple((n, *LIMITS[n]) for n in seen),
        "float32",
        "box",
        (3,) if choice is not None else (),
        inputs=tuple(f"assign_{u}" for u in inputs),
        low=(-1.0,) * outputs,
        high=(1.0,) * outputs,
        squash=True,
    )
    network = Network((), (Layer(weight, bias, "identity"),))
    return write_policy(NetworkPolicy(name, interface, network, False, {**SQUASH}), folder)


TESTS = ["u * w >= x / 2", "u + w >= 3 * x - 1", "w^2 >= x^2 + u", "abs(u - w) >= x & w < u"]

CHOICES = [(0.0, -1.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.5, 0.25)]


@pytest.mark.parametrize("test", quick_among(TESTS, TESTS[::2]))
def test_states_are_refuted_where_the_environment_is_blocked(tmp_path: Path, test: str) -> None:
    """And nowhere else: what is judged exactly is what happens when the policy acts."""
    path = model(tmp_path, test=test)
    env = dl2c.make(path, **SQUASH, action_format="box")
    for slope, offset in CHOICES:
        _, (question,) = questions_of(path, Asked(policy(tmp_path, (slope, offset))), SQUASH)
        blocked = dict[float, bool]()
        for x in np.arange(-16, 17) / 8:
            env.reset(seed=0, options={"state": {"x": x, "u": 0.0, "w": 0.0}})
            action = np.array([0.0, 0.0, np.clip(slope * x + offset, -1, 1)], np.float32)
            blocked[x] = bool(env.step(action)[4]["blocked"])
            state = {s: Fraction(x if s.name == "x" else 0) for s in question.dimensions}
            assert (violation(question, state) is not None) == blocked[x], x
        assert any(blocked.values()) == (offset != -1.0)


def test_a_proved_policy_is_never_blocked(tmp_path: Path) -> None:
    """It pushes only where it can: where x is small."""
    path, file = model(tmp_path, test="u * w >= x / 2"), policy(tmp_path, (-0.4, -0.6))
    certificate = tmp_path / "proof.json"
    report = report_on(path, Asked(file, seconds=20, certificate=certificate), SQUASH)
    assert report.answer == "proved" and any("shares" in w for w in report.warnings)
    assert checked_certificate(path, Asked(file), SQUASH, certificate).leaves == sum(
        f.boxes - (f.boxes - 1) // 2 for f in report.found
    )


def test_a_violation_is_confirmed_and_replayed(tmp_path: Path, capsys: Any) -> None:
    path, file, episode = model(tmp_path), policy(tmp_path, (0.0, 1.0)), tmp_path / "step.json"
    given = ("--policy", str(file), "-o", str(episode))
    code, out, _ = run(capsys, "verify", path, *given)
    assert code == 1 and f"\nconfirmed: {IMPOSSIBLE}\n" in out
    assert "it asks for   choice_0=2\nwhich no control path admits, whatever the values\n" in out
    (step,) = json.loads(episode.read_text())["steps"]
    assert step["blocked"] and step["action"] == [0.0, 0.0, 1.0]
    code, out, _ = run(capsys, "replay", str(episode))
    assert code == 0 and "bit for bit" in out


def test_the_environment_gives_values_that_are_admissible(tmp_path: Path) -> None:
    """Below -1 there are none for u and y together."""
    path, file = model(tmp_path, LATER), policy(tmp_path, None, "xuy", "u", "later")
    report = report_on(path, Asked(file, seconds=20), SQUASH)
    assert report.answer == "refuted" and report.violation is not None
    assert report.violation.state["x"] < -1
    above = report_on(path, Asked(file, seconds=20, outside="x < -1"), SQUASH)
    assert above.answer == "proved"


ONE = """Theorem "one"
ProgramVariables
  /* @var: bound=[-2:2] */ Real x;
  {u}
  /* @var: observe=false */ Real w;
End.
Problem
  -2 <= x & x <= 2 -> [{u := *; ?{test}; w := {w}; x := x / 2;}*@invariant(-2 <= x & x <= 2)] x <= 2
End.
End.
"""


def one(folder: Path, test: str, w: str = "u", bound: str = "bound=[-1:1], ") -> str:
    text = ONE.replace("{u}", f"/* @var: {bound}observe=false */ Real u;").replace("{w}", w)
    return model(folder, text, test)


@pytest.mark.parametrize(("test", "answer"), [("u >= x / 2", "refuted"), ("u != 0 & u <= 1", "proved")])
def test_what_is_computed_has_a_value_whatever_is_given(tmp_path: Path, test: str, answer: str) -> None:
    """The share decides which of the values that pass it is."""
    path, file = one(tmp_path, test, "1 / u"), policy(tmp_path, None, "x", "u", "one")
    assert report_on(path, Asked(file, seconds=20), SQUASH).answer == answer


def test_values_are_looked_for_within_declared_bounds_only(tmp_path: Path) -> None:
    """Others are limited by options, or by what tests say at first."""
    file = policy(tmp_path, None, "x", "u", "one")
    assert report_on(one(tmp_path, "u >= 3 * x"), Asked(file, seconds=20), SQUASH).answer == "refuted"
    with pytest.raises(NotCovered) as refused:
        report_on(one(tmp_path, "u >= 3 * x", bound=""), Asked(file), {**SQUASH, "default_bound": "-1:1"})
    assert "`u` has no bounds" in str(refused.value)


@pytest.mark.parametrize("outside", ["x < -1", "x + 1 < 0"])
def test_a_certificate_may_need_what_is_assumed(tmp_path: Path, outside: str) -> None:
    """The conclusion does not hold in all of any box around -1."""
    path, kept = model(tmp_path, LATER), tmp_path / "proof.json"
    file = policy(tmp_path, None, "xuy", "u", "later")
    asked = Asked(file, seconds=20, outside=outside, certificate=kept)
    assert report_on(path, asked, SQUASH).answer == "proved"
    assert checked_certificate(path, Asked(file, outside=outside), SQUASH, kept).leaves > 0


def test_what_cannot_be_decided_is_said(tmp_path: Path) -> None:
    path, file = model(tmp_path, test="u^3 - u >= x"), policy(tmp_path)
    with pytest.raises(NotCovered) as refused:
        report_on(path, Asked(file), SQUASH)
    assert "has an admissible value is not known in general" in str(refused.value)
    assert "model.kyx:10:" in str(refused.value)


@pytest.mark.parametrize(("arithmetic", "number"), [("double", np.float64), ("float32", np.float32)])
@pytest.mark.parametrize("last", [1, 2, 3, 6, 9])
def test_no_alternative_is_missed_by_rounding(arithmetic: Arithmetic, number: Any, last: int) -> None:
    """Next to where two alternatives meet, and anywhere."""
    rng = np.random.default_rng(last)
    request = Request(Fraction(-1), Fraction(1), False, Symbol("request choice 0", "input"), last)
    premises = [_spread(0, k, request, arithmetic) for k in range(last + 1)]
    ties = number(-1) + 2 * (np.arange(last) + number(0.5)).astype(number) / number(last)
    values = [*rng.uniform(-1, 1, 2000).astype(number), number(-1), number(1)]
    for tie in ties:
        for side in (-np.inf, np.inf):
            near = number(tie)
            for _ in range(20):
                values.append(near)
                near = np.nextafter(near, number(side))
    for value in values:
        taken = int(np.rint((number(value) + number(1)) / number(2) * number(last)))
        premise, exact = premises[taken], Fraction(float(value))
        assert premise.low is None or premise.low <= exact
        assert premise.high is None or exact <= premise.high
