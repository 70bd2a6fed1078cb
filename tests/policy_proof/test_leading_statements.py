"""Policies that observe what the environment decides, draws and computes before: proofs and violations."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dl2c.commands.monitor import unit_of
from dl2c.commands.policy import Asked, policy_for, report_on
from dl2c.ir.evaluate import evaluate
from dl2c.ir.model import Add, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.policy.files import write_policy
from dl2c.policy.network import Interface, Layer, Network, NetworkPolicy
from dl2c.policy_proof.computed import dimension
from dl2c.policy_proof.confirm import CONFIRMED, confirmation
from dl2c.policy_proof.question import Arithmetic, NotCovered
from dl2c.policy_proof.verdict import PolicyReport
from dl2c.source import NOWHERE

BEFORE = """Theorem "before"
ProgramVariables
  /* @var: bound=[-5:5] */ Real x;
  /* @var: bound=[-5:5], role=env */ Real y;
  /* @var: bound=[-20:20] */ Real seen;
End.
Problem x = 0 & y = 0 & seen = 0 -> [{
  y := *; ?-5 <= y & y <= 5;
  if (y > x) { seen := {term}; } else {
    /* @choice: name="mode", role=env */ { seen := y^2 / 7; ++ seen := x / 2; }
  }
  { {?{test}; x := x / 2 + seen / 8; ++ x := x / 2;} }
}*](x <= 50)
End.
End.
"""


def report(
    folder: Path,
    weights: list[float],
    bias: list[float],
    term: str = "(y - x) / 3",
    test: str = "seen < 4",
    arithmetic: str = "double",
) -> tuple[PolicyReport, Any]:
    """What is found of a policy that takes the first alternative where its first sum is the larger one, and
    what the exported C says of a violation.
    """
    model = str(folder / "before.kyx")
    Path(model).write_text(BEFORE.replace("{term}", term).replace("{test}", test))
    layer = Layer(np.array([weights, [0.0, 0.0, 0.0]]), np.array(bias), "identity")
    observed = (("x", -5.0, 5.0), ("y", -5.0, 5.0), ("seen", -20.0, 20.0))
    interface = Interface(observed, "float32", "choice", (2,))
    file = write_policy(NetworkPolicy("before", interface, Network((), (layer,)), False, {}), folder)
    found = report_on(model, Asked(file, arithmetic, seconds=20), {})
    if found.violated is None:
        return found, None
    policy, options = policy_for(model, file, {})
    return found, confirmation(*found.violated, unit_of(model, options, ("controller",)), policy)


@pytest.mark.parametrize("arithmetic", ["double", "float32", "real"])
def test_what_is_computed_is_a_dimension(tmp_path: Path, arithmetic: str) -> None:
    """The test holds where the first alternative is taken, since the policy observes what it is about."""
    careful = [0.0, 0.0, -1.0], [1.5, 0.0]
    found, _ = report(tmp_path, *careful, test="seen < 2", arithmetic=arithmetic)
    assert found.answer == "proved" and len(found.covers) == 3
    assert all("observed seen" in covers for covers in found.covers)


CARELESS = {
    "computed": ([0.0, 0.0, -1.0], [2.25, 0.0], "(y + 6) / 3", "seen < 2 | y <= x", {}),
    "an alternative": ([1.0, 0.0, 0.0], [0.0, 0.0], "(y - 6) / 12", "seen < 1", {"choice_0": 0}),
    "another": ([0.0, 0.0, -1.0], [0.0, 0.0], "(y + 6) / 3", "seen >= 0", {"choice_0": 1}),
}


@pytest.mark.parametrize("name", CARELESS)
def test_violations_are_those_of_the_exported_c(tmp_path: Path, name: str) -> None:
    """Its network is given the same number, to the last bit: else this would raise."""
    weights, bias, term, test, lead = CARELESS[name]
    found, said = report(tmp_path, weights, bias, term, test)
    assert found.answer == "refuted" and found.violated is not None
    assert dict(found.violated[0].lead) == lead
    assert said.text == CONFIRMED
    assert found.to_json()["counterexample"]["environment"] == lead


@pytest.mark.parametrize(("arithmetic", "answer"), [("double", "unknown"), ("real", "proved")])
def test_numbers_that_the_program_computes_are_rounded(tmp_path: Path, arithmetic: str, answer: str) -> None:
    """x + 10^6 - 10^6 is 0.1 for real numbers, and less than what the policy compares it with in doubles."""
    model, term = str(tmp_path / "before.kyx"), "(x + 1000000) - 1000000"
    Path(model).write_text(BEFORE.replace("{term}", term).replace("{test}", "seen < 0.09999999999"))
    layer = Layer(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]), np.array([0.09999999998, 0.0]), "identity")
    observed = (("x", -5.0, 5.0), ("y", -5.0, 5.0), ("seen", -20.0, 20.0))
    interface = Interface(observed, "float64", "choice", (2,))
    policy = NetworkPolicy("before", interface, Network((), (layer,)), False, {"obs_dtype": "float64"})
    asked = Asked(write_policy(policy, tmp_path), arithmetic, seconds=2, fixed=("x=0.1",))
    assert (0.1 + 1e6) - 1e6 < 0.09999999998 and report_on(model, asked, {}).answer == answer


REFUSED = {
    "1 / y": "by a division, perhaps by 0",
    "(x^2 + y^2)^(1/2)": "with a function that is not computed exactly",
}


@pytest.mark.parametrize("term", REFUSED)
def test_what_has_no_bound_of_its_error_is_refused(tmp_path: Path, term: str) -> None:
    with pytest.raises(NotCovered) as refused:
        report(tmp_path, [0.0, 0.0, 1.0], [0.0, 0.0], term=term)
    assert REFUSED[term] in refused.value.diagnostics[0].label


X, Y = Symbol("x", "variable"), Symbol("y", "variable")
BOX = {X: (Fraction(-3), Fraction(7)), Y: (Fraction(1), Fraction(1000))}


def a_term(rng: np.random.Generator, depth: int) -> Term:
    if depth == 0:
        number = Number(Fraction(int(rng.integers(-900, 900)), int(rng.integers(1, 90))))
        return [X, Y, number][int(rng.integers(3))]
    a, b = a_term(rng, depth - 1), a_term(rng, depth - 1)
    made = [
        Add(a, b),
        Sub(a, b),
        Mul(a, b),
        Div(a, Y),
        Pow(a, 3),
        Neg(a),
        Call("abs", (a,)),
        Call("max", (a, b)),
    ]
    return made[int(rng.integers(len(made)))]


@pytest.mark.parametrize("seed", range(40))
def test_no_value_is_further_from_its_term(seed: int) -> None:
    """In doubles, and in single precision, whose operations numpy rounds likewise."""
    rng = np.random.default_rng(seed)
    term = a_term(rng, int(rng.integers(1, 4)))
    kinds: list[tuple[Arithmetic, Any]] = [("double", float), ("float32", np.float32)]
    for arithmetic, number in kinds:
        made = dimension("seen", term, BOX, arithmetic, NOWHERE)
        for _ in range(200):
            point = {s: Fraction(float(rng.uniform(float(a), float(b)))) for s, (a, b) in BOX.items()}
            exact = evaluate(term, point, exact=True)
            held = {s: number(float(v)) for s, v in point.items()}
            found = Fraction(float(evaluate(term, held)))
            assert made.range[0] <= found <= made.range[1]
            slack = made.range[1] - made.range[0]
            assert abs(found - exact) <= slack


def etcs_policy(folder: Path, choice: float) -> Path:
    """It asks for full acceleration and always takes the same alternative."""
    import dl2c
    from dl2c.env.interface import interface_of

    env = dl2c.make_sb3("example:etcs", 1)
    interface = interface_of(env.manifest)
    layer = Layer(np.zeros((2, len(interface.observations))), np.array([0.5, choice]), "identity")
    return write_policy(NetworkPolicy(env.manifest.name, interface, Network((), (layer,)), False, {}), folder)


@pytest.mark.parametrize(("choice", "answer"), [(0.0, "refuted"), (1.0, "proved")])
def test_the_train_is_decided(tmp_path: Path, choice: float, answer: str) -> None:
    """Braking is always possible, another acceleration is not."""
    pytest.importorskip("stable_baselines3")
    found = report_on("example:etcs", Asked(etcs_policy(tmp_path, choice), seconds=20), {})
    assert found.answer == answer


def test_a_trained_train_is_confirmed(tmp_path: Path) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    import dl2c

    model = sb3.PPO("MlpPolicy", dl2c.make_sb3("example:etcs", 1), n_steps=64, seed=1, device="cpu")
    model.learn(128).save(tmp_path / "policy.zip")
    found = report_on("example:etcs", Asked(tmp_path / "policy.zip", seconds=10), {})
    assert found.answer == "refuted" and found.violated is not None
    policy, options = policy_for("example:etcs", tmp_path, {})
    unit = unit_of("example:etcs", options, ("controller",))
    assert confirmation(*found.violated, unit, policy).text == CONFIRMED
