"""Claims about policies that are false, and mistakes in what is asked that would prove them."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_proof.questions import onnx_file

from dl2c.commands.failures import CommandError
from dl2c.commands.policy import Asked, questions_of, report_on
from dl2c.env.interface import interface_of
from dl2c.env.opening import compilation_of
from dl2c.ir.model import Bound, Div, Mul, Number, Symbol
from dl2c.ir.model import Compare as Atom
from dl2c.lower.observations import observation_limits
from dl2c.native.describe import manifest_of
from dl2c.options import Options
from dl2c.policy.files import write_policy
from dl2c.policy.network import Layer, Network, NetworkPolicy, PolicyError
from dl2c.policy.onnx_files import read_onnx
from dl2c.policy_proof.fixed_point import ONE, UNLIMITED, enclosed, judged
from dl2c.policy_proof.question import NotCovered
from dl2c.policy_proof.verdict import PolicyReport

TANK = """Theorem "tank"
ProgramVariables
  /* @var: bound=[0:5] */ Real l;
  {declared}
  Real t;
End.
Problem
  0 <= l & l <= 5 {assumed} -> [{prefix}{{
    {body}
  }}*@invariant({invariant})] l >= 0
End.
End.
"""
FLOW = "t := 0; {l' = 0, t' = 1 & t <= 1}"


def tank(
    folder: Path,
    body: str,
    declared: str = "/* @var: bound=[0:1] */ Real u;",
    assumed: str = "",
    prefix: str = "",
    invariant: str = "0 <= l & l <= 5",
) -> str:
    text = TANK.format(body=body, declared=declared, assumed=assumed, prefix=prefix, invariant=invariant)
    (folder / "tank.kyx").write_text(text)
    return str(folder / "tank.kyx")


def constant(*outputs: float, inputs: int = 1) -> Network:
    """Gives the same numbers whatever it observes."""
    size = len(outputs)
    return Network((), (Layer(np.zeros((size, inputs)), np.array(outputs), "identity"),))


def policy(
    model: str, outputs: Sequence[float], options: Mapping[str, Any] | None = None, layers: Any = None
) -> Path:
    """A policy of the model that always gives the same, or has these layers."""
    options = options or {}
    manifest = manifest_of(compilation_of(model, options).planned.build, "", {})
    interface = interface_of(manifest)
    network = constant(*outputs, inputs=len(interface.observations))
    network = network if layers is None else Network((), layers)
    write_policy(NetworkPolicy(manifest.name, interface, network, False, options), Path(model).parent)
    return Path(model).parent / "policy.json"


def asked(model: str, path: Path, options: Mapping[str, Any] | None = None, **words: Any) -> PolicyReport:
    return report_on(model, Asked(path, seconds=20.0, threads=1, **words), options or {})


@pytest.mark.parametrize("output", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("bound", ["2:2", "2:2.000000001"])
def test_limits_that_are_equal(tmp_path: Path, bound: str, output: float) -> None:
    """What is above them is clipped to them as well."""
    model = tank(tmp_path, f"u := *; ?u <= l; {FLOW}", f"/* @var: bound=[{bound}] */ Real u;")
    assert asked(model, policy(model, [output])).answer == "refuted"


RUNS = """{ ?true; if (l > 1) { { ?l <= 2; y := 1; ++ ?l > 1.5; y := 2; } } else { y := 3; }
    ++ ?l >= 4; y := 4; }"""


def test_a_run_admits_no_path_that_it_does_not_name(tmp_path: Path) -> None:
    model = tank(tmp_path, f"{RUNS} {FLOW}", "Real y;")
    options = {"action_format": "discrete"}
    manifest = manifest_of(compilation_of(model, options).planned.build, "", {})
    runs = interface_of(manifest).runs
    chosen = [float(run == (0, -1)) for run in runs]
    assert sum(chosen) == 1
    said = asked(model, policy(model, chosen, options), options)
    assert said.answer == "refuted" and said.violation is not None and said.violation.state["l"] > 1


def test_requests_after_the_first_motion_are_not_covered(tmp_path: Path) -> None:
    wide = "/* @var: bound=[0:100] */ Real u;"
    model = tank(tmp_path, f"{FLOW} u := *; ?u <= l; {FLOW}", wide)
    with pytest.raises(NotCovered, match="after the first motion"):
        asked(model, policy(model, [50.0]))
    model = tank(tmp_path, f"u := *; {FLOW} ?u <= l; {FLOW}", wide)
    said = asked(model, policy(model, [50.0]))
    assert any("after the first motion" in warning for warning in said.warnings)


def test_outputs_that_the_network_clips(tmp_path: Path) -> None:
    model = tank(tmp_path, f"u := *; ?u <= 0.3; {FLOW}")
    path = onnx_file(constant(0.0), tmp_path / "n.onnx", clip=(0.5, 0.6))
    with pytest.raises(CommandError, match="clips its outputs"):
        asked(model, path, inputs="l", outputs=("u=0:0.6",))
    assert asked(model, path, inputs="l", outputs=("u",)).answer == "refuted"


def test_limits_of_older_clips_are_read(tmp_path: Path) -> None:
    import onnx
    from onnx import helper

    path = onnx_file(constant(0.0), tmp_path / "n.onnx", clip=(0.5, 0.6))
    file = onnx.load(str(path))
    del file.graph.node[-1].input[1:]
    ends = [helper.make_attribute("min", 0.5), helper.make_attribute("max", 0.75)]
    file.graph.node[-1].attribute.extend(ends)
    onnx.save(file, str(path))
    assert read_onnx(path).clip == (0.5, 0.75)


def test_operations_without_their_inputs_are_refused(tmp_path: Path) -> None:
    import onnx

    path = onnx_file(constant(0.0), tmp_path / "n.onnx")
    file = onnx.load(str(path))
    del file.graph.node[0].input[1:]
    onnx.save(file, str(path))
    with pytest.raises(PolicyError, match="one after the other"):
        read_onnx(path)


def test_a_variable_is_given_one_value(tmp_path: Path) -> None:
    model = tank(tmp_path, f"u := *; ?u <= 0.3; {FLOW}")
    path = onnx_file(constant(5.0, -5.0), tmp_path / "n.onnx")
    with pytest.raises(CommandError, match="names `u` more than once"):
        asked(model, path, inputs="l", outputs=("u=0:1", "u=0:1"))


def test_a_program_before_the_loop_may_leave_the_bounds(tmp_path: Path) -> None:
    body = f"u := *; ?u <= 6 - l; l := 0; {FLOW}"
    model = tank(tmp_path, body, "Real u;", prefix="l := 100; ", invariant="l <= 1000")
    path = onnx_file(constant(0.5), tmp_path / "n.onnx")
    said = asked(model, path, {"default_bound": "-1000:1000"}, inputs="l", outputs=("u=0:0.6",))
    assert said.claims["admissible"] == "proved"
    assert said.claims["for ever"] == "until the bounds are left"


@pytest.mark.parametrize(("most", "lasting"), [("2", "until the bounds are left"), ("1", "proved")])
def test_the_environment_may_leave_the_bounds(tmp_path: Path, most: str, lasting: str) -> None:
    """With what it draws before the policy observes, though no step ends there."""
    model = tank(
        tmp_path,
        f"w := *; ?0 <= w & w <= {most}; u := *; ?u <= 1.2 - w; w := 0; {FLOW}",
        "/* @var: bound=[0:1], role=env */ Real w;\n  Real u;",
        "& w = 0",
        invariant="0 <= l & l <= 5 & w = 0",
    )
    path = onnx_file(constant(0.1, inputs=2), tmp_path / "n.onnx")
    said = asked(model, path, {"default_bound": "-1000:1000"}, inputs="l,w", outputs=("u=0:0.6",))
    assert (said.claims["admissible"], said.claims["for ever"]) == ("proved", lasting)


def test_a_constant_has_one_value(tmp_path: Path) -> None:
    model = tank(tmp_path, f"u := *; ?u <= A * l + 1; {FLOW}")
    defined = "Definitions\n  /* @const: bound=[0:1] */ Real A;\nEnd.\nProgramVariables"
    Path(model).write_text(Path(model).read_text().replace("ProgramVariables", defined))
    path = onnx_file(constant(0.6), tmp_path / "n.onnx")
    words = {"inputs": "l", "outputs": ("u=0:0.6",)}
    for options, fixed in (({"constants": {"A": 0.5}}, ("A=0.7",)), ({}, ("A=0.5", "A=0.7"))):
        with pytest.raises(CommandError, match="`A` has another value already"):
            asked(model, path, options, fixed=fixed, **words)
    assert asked(model, path, {"constants": {"A": 0.5}}, fixed=("A=0.5",), **words).answer == "proved"
    with pytest.raises(CommandError, match="NAME=VALUE"):
        asked(model, path, {}, fixed=("A=1e99999999",), **words)


@pytest.mark.parametrize(("weight", "answer"), [(6e-46, "refuted"), (1e39, "proved")])
def test_numbers_that_float32_does_not_have(tmp_path: Path, weight: float, answer: str) -> None:
    model = tank(tmp_path, f"u := *; ?u >= l / 5 - 0.5; {FLOW}")
    layers = (Layer(np.array([[weight, 0.0]]), np.zeros(1), "identity"),)
    path = policy(model, [], layers=layers)
    with pytest.raises(NotCovered, match="too large or too small for float32"):
        asked(model, path, arithmetic="float32")
    assert asked(model, path).answer == answer


def test_observations_in_float32_are_limited(tmp_path: Path) -> None:
    """The export clips them to the largest float."""
    assumed = "0 <= x & x <= 10^39"
    model = tank(
        tmp_path,
        f"u := *; ?u >= x * 10^(-38) - 0.5; {FLOW}",
        "/* @var: bound=[0:100] */ Real u;\n  /* @var: observe=true */ Real x;",
        f"& {assumed}",
        invariant=assumed,
    )
    weights = [1e-38 if name == "x" else 0.0 for name, _, _ in _observations(model)]
    layers = (Layer(np.array([weights]), np.zeros(1), "identity"),)
    assert asked(model, policy(model, [], layers=layers)).answer == "refuted"


def _observations(model: str) -> Sequence[tuple[str, float, float]]:
    return interface_of(manifest_of(compilation_of(model, {}).planned.build, "", {})).observations


def test_limits_beyond_all_floats_are_open() -> None:
    far = Bound(Fraction(-(10**40)), Fraction(10**40))
    assert observation_limits(far, Options()) == (-np.inf, np.inf)
    largest = float(np.finfo(np.float32).max)
    assert observation_limits(Bound(Fraction(10**40), None), Options()) == (largest, np.inf)


def test_a_step_that_never_comes_to_the_policy_is_not_covered(tmp_path: Path) -> None:
    declared = "/* @var: bound=[0:1], role=env */ Real w;\n  /* @var: bound=[0:1] */ Real u;"
    model = tank(tmp_path, f"w := *; ?(w > 1 & w <= 1); u := *; ?u <= l; {FLOW}", declared)
    path = onnx_file(constant(0.1), tmp_path / "n.onnx")
    with pytest.raises(NotCovered, match="no run of the model comes to where the policy decides"):
        questions_of(model, Asked(path, inputs="l", outputs=("u=0:1",)), {})


def test_what_is_unlimited_stays_so() -> None:
    """However often the checker multiplies it by something small."""
    x = Symbol("x", "variable")
    quotient = Div(Number(Fraction(1)), x)
    box, nonzero = {x: (0, ONE)}, frozenset({x})
    assert enclosed(quotient, box, nonzero) == (ONE, UNLIMITED)
    small: Any = quotient
    for _ in range(100):
        small = Mul(small, Number(Fraction(1, 10**20)))
    found = enclosed(small, box, nonzero)
    assert found is None or found[1] == UNLIMITED
    assert judged(Atom("<=", small, Number(Fraction(1))), box, nonzero) == "open"
