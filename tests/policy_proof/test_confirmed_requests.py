"""A refuted request is asked of the exported C, and saved as an episode: `dl2c verify --policy -o`."""

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from selection import quick_rows

from dl2c.commands.monitor import unit_of
from dl2c.commands.policy import Asked, policy_for, report_on
from dl2c.emit.monitor import network_c
from dl2c.native.program import answers
from dl2c.policy.files import write_policy
from dl2c.policy.network import ActionKind, Interface, Layer, Network, NetworkPolicy
from dl2c.policy_proof.confirm import CONFIRMED, Confirmation, Contradiction, confirmation

pytestmark = pytest.mark.usefixtures("unoptimised")

TANK = """Theorem "tank"
ProgramVariables
  /* @var: bound=[0:5] */ Real l;
  /* @var: bound=[0:1] */ Real u;
  Real t;
End.
Problem
  {begins} -> [{
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
  -2 <= x & x <= 2 -> [{ {?x <= 1; x := x + 1; ++ {other}} }*@invariant(-2 <= x & x <= 2)] x <= 2
End.
End.
"""


def told(capsys: Any, folder: Path, model: str, policy: NetworkPolicy, *words: str) -> tuple[int, Any]:
    """Exit code and report of a policy."""
    (folder / "model.kyx").write_text(model)
    write_policy(policy, folder)
    given = ("--policy", str(folder / "policy.json"), "--json", *words)
    code, out, err = run(capsys, "verify", str(folder / "model.kyx"), *given)
    assert out, err
    return code, json.loads(out)


HIGH = float(np.float32(0.6))


def tank_policy(value: float) -> NetworkPolicy:
    """It always asks for the same, whatever it observes."""
    layer = Layer(np.zeros((1, 2)), np.array([value]), "identity")
    observed = (("l", 0.0, 5.0), ("u", 0.0, 1.0))
    interface = Interface(observed, "float32", "box", inputs=("assign_u",), low=(0.0,), high=(HIGH,))
    return NetworkPolicy("tank", interface, Network((), (layer,)), False, {})


def switch_policy(masked: bool = False, kind: ActionKind = "choice") -> NetworkPolicy:
    """It always takes the first alternative."""
    layer = Layer(np.zeros((2, 1)), np.array([1.0, 0.0]), "identity")
    runs = ((0,), (1,)) if kind == "runs" else ()
    interface = Interface((("x", -2.0, 2.0),), "float32", kind, (2,), runs)
    options = {"action_format": "discrete"} if kind == "runs" else {}
    return NetworkPolicy("switch", interface, Network((), (layer,)), masked, options)


def tank(begins: str = "0 <= l & l <= 5") -> str:
    return TANK.replace("{begins}", begins)


def switch(other: str = "?x >= -1; x := x - 1;") -> str:
    return SWITCH.replace("{other}", other)


@pytest.mark.parametrize("arithmetic", ["double", "float32"])
def test_a_value_is_confirmed_and_replayed(tmp_path: Path, capsys: Any, arithmetic: str) -> None:
    episode = tmp_path / "new" / "step.json"
    words = ("--arithmetic", arithmetic, "-o", str(episode))
    code, report = told(capsys, tmp_path, tank(), tank_policy(0.125), *words)
    assert (code, report["answer"]) == (1, "refuted")
    assert report["confirmation"] == {"confirmed": True, "text": CONFIRMED}
    assert (report["episode"], report["not_saved"]) == (str(episode), None)
    (step,) = json.loads(episode.read_text())["steps"]
    assert step["action"] == [0.125] and step["state"]["u"] > 0.125
    code, out, _ = run(capsys, "replay", str(episode))
    assert "bit for bit" in out


@pytest.mark.parametrize(
    ("kind", "masked"),
    quick_rows(product(("choice", "runs"), (False, True)), (("choice", True), ("runs", False))),
)
def test_an_alternative_is_confirmed_and_replayed(
    tmp_path: Path, capsys: Any, kind: ActionKind, masked: bool
) -> None:
    """What a mask would correct is what is judged: the policy is asked without it."""
    episode = tmp_path / "step.json"
    _, report = told(capsys, tmp_path, switch(), switch_policy(masked, kind), "-o", str(episode))
    assert report["confirmation"]["confirmed"]
    (step,) = json.loads(episode.read_text())["steps"]
    assert step["action"] == 0 and step["blocked"]


def test_readers_are_told(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "model.kyx").write_text(switch())
    write_policy(switch_policy(), tmp_path)
    given = ("--policy", str(tmp_path), "-o", str(tmp_path / "step.json"))
    code, out, _ = run(capsys, "verify", str(tmp_path / "model.kyx"), *given)
    assert code == 1 and f"\nconfirmed: {CONFIRMED}\n" in out
    assert out.endswith(f"replay it with `dl2c replay {tmp_path / 'step.json'}`\n")


def test_where_no_episode_begins_nothing_is_written(tmp_path: Path, capsys: Any) -> None:
    episode = tmp_path / "step.json"
    _, report = told(capsys, tmp_path, tank("l = 3 & u = 0"), tank_policy(0.125), "-o", str(episode))
    assert report["confirmation"]["confirmed"] and report["episode"] is None
    assert "the environment does not begin there" in report["not_saved"]
    assert not episode.exists()


def test_nothing_is_compiled_for_a_proof(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr("dl2c.policy_proof.confirm.compile_program", None)
    words = ("--fix", "l=2", "-o", str(tmp_path / "step.json"))
    code, report = told(capsys, tmp_path, tank(), tank_policy(0.25), *words)
    assert (code, report["confirmation"], report["episode"]) == (0, None, None)
    assert report["not_saved"] == "no request is refuted"


def test_another_path_to_the_same_state_is_named(tmp_path: Path, capsys: Any) -> None:
    """The first alternative is blocked, but a monitor sees only where a step leads."""
    _, report = told(capsys, tmp_path, switch("x := x + 1;"), switch_policy())
    text = "the exported C asks for the same, but the monitor accepts it, "
    text += "since another control path leads to the same state"
    assert report["confirmation"] == {"confirmed": False, "text": text}


def test_less_than_rounding_is_named(tmp_path: Path, capsys: Any) -> None:
    """In doubles 1/10 + 2/10 is a little more than 3/10; the test is missed by less than that."""
    model = switch().replace("?x <= 1;", "?x/10 + 2/10 > 3/10;")
    _, report = told(capsys, tmp_path, model, switch_policy(), "--fix", "x=1")
    assert report["confirmation"]["text"].endswith("accepts it, since it is violated by less than rounding")


def test_real_numbers_are_not_those_of_c(tmp_path: Path, capsys: Any) -> None:
    _, report = told(capsys, tmp_path, tank(), tank_policy(0.125), "--arithmetic", "real")
    assert report["answer"] == "refuted" and not report["confirmation"]["confirmed"]
    assert "does not compute with real numbers" in report["confirmation"]["text"]


def test_c_that_computes_something_else_is_an_internal_error(
    tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    (tmp_path / "model.kyx").write_text(tank())
    write_policy(tank_policy(0.125), tmp_path)
    monkeypatch.setitem(network_c.FUNCTIONS, "identity", "sum + 0.001")
    code, out, err = run(capsys, "verify", str(tmp_path / "model.kyx"), "--policy", str(tmp_path))
    assert code not in (0, 1, 3) and out == ""
    assert "internal error: Contradiction" in err and "the network gives [0.125]" in err


PLANTED = {
    "the value": ("asks", lambda text: " ".join([text.split()[0], "0.5"])),
    "the verdict": ("controller", lambda text: "0 0"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_every_difference_is_found(tmp_path: Path, monkeypatch: Any, name: str) -> None:
    (tmp_path / "model.kyx").write_text(tank())
    write_policy(tank_policy(0.125), tmp_path)
    model, (word, change) = str(tmp_path / "model.kyx"), PLANTED[name]

    def changed(program: Path, lines: list[str]) -> list[str]:
        pairs = zip(lines, answers(program, lines), strict=True)
        return [change(text) if line.startswith(word) else text for line, text in pairs]

    report = report_on(model, Asked(tmp_path / "policy.json", seconds=20), {})
    policy, options = policy_for(model, tmp_path / "policy.json", {})
    unit = unit_of(model, options, ("controller",))
    assert report.violated is not None
    found = confirmation(*report.violated, unit, policy)
    assert isinstance(found, Confirmation) and found.confirmed
    monkeypatch.setattr("dl2c.policy_proof.confirm.answers", changed)
    with pytest.raises(Contradiction):
        confirmation(*report.violated, unit, policy)
