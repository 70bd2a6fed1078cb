"""Exported ONNX files compute what policies compute, and are read again."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands.test_cli import run
from policy_proof.questions import layers

from dl2c.env.interface import interface_of
from dl2c.env.opening import compilation_of
from dl2c.native.describe import manifest_of
from dl2c.policy.files import write_policy
from dl2c.policy.network import ACTIVATIONS, Activation, Interface, Layer, Network, NetworkPolicy, Scaling

pytest.importorskip("onnx")
from dl2c.policy.onnx_export import onnx_of
from dl2c.policy.onnx_files import read_onnx

NAMES = (("x", -3.0, 3.0), ("y", -1.0, 4.0), ("z", 0.0, 1.0))


def policy(activation: Activation, scaled: bool = False, bounded: bool = False) -> NetworkPolicy:
    rng = np.random.default_rng(4)
    interface = Interface(
        NAMES, "float64", "box", inputs=("assign_a", "assign_b"), low=(-2.0, 0.0), high=(2.0, 5.0)
    )
    scaling = Scaling(np.array([0.5, 1.0, 0.2]), np.array([2.0, 0.25, 1.5]), 1.25)
    network = Network((scaling,) if scaled else (), layers(rng, [3, 32, 17, 2], activation), bounded)
    return NetworkPolicy("Model", interface, network, False, {})


def requests(p: NetworkPolicy, observations: np.ndarray) -> np.ndarray:
    """What the policy asks for, before it is clipped."""
    values = p.network.outputs(observations)
    low, high = np.array(p.interface.low), np.array(p.interface.high)
    return low + (values + 1) / 2 * (high - low) if p.network.bounded else values


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(("scaled", "bounded"), [(False, False), (True, True)])
def test_onnxruntime_computes_the_same(activation: Activation, scaled: bool, bounded: bool) -> None:
    runtime = pytest.importorskip("onnxruntime")
    made = policy(activation, scaled, bounded)
    observations = np.random.default_rng(5).uniform(-4, 4, (10_000, 3))
    session = runtime.InferenceSession(onnx_of(made), providers=["CPUExecutionProvider"])
    (found,) = session.run(None, {"observations": observations})
    assert np.abs(found - requests(made, observations)).max() < (1e-5 if activation == "elu" else 1e-12)


@pytest.mark.parametrize("bounded", [False, True])
def test_what_is_read_again_is_the_same(tmp_path: Path, bounded: bool) -> None:
    made = policy("tanh", bounded=bounded)
    (tmp_path / "net.onnx").write_bytes(onnx_of(made))
    read = read_onnx(tmp_path / "net.onnx")
    observations = np.random.default_rng(6).uniform(-4, 4, (10_000, 3))
    assert read.clip is None and read.inputs == 3
    assert np.abs(read.network.outputs(observations) - requests(made, observations)).max() < 1e-12


def test_files_from_elsewhere_compute_what_onnxruntime_computes(tmp_path: Path) -> None:
    """In single precision, which such files have."""
    runtime = pytest.importorskip("onnxruntime")
    from policy_proof.questions import onnx_file

    network = Network((), layers(np.random.default_rng(7), [3, 64, 64, 1], "relu"))
    path = onnx_file(network, tmp_path / "net.onnx")
    observations = np.random.default_rng(8).uniform(-4, 4, (10_000, 3)).astype(np.float32)
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    found = np.concatenate([session.run(None, {"x": row[None]})[0] for row in observations])
    ours = read_onnx(path).network.outputs(observations)
    assert np.abs(found - ours).max() < 1e-5 * (1 + np.abs(ours).max())


def test_the_file_does_not_depend_on_when_it_is_written() -> None:
    assert onnx_of(policy("relu")) == onnx_of(policy("relu"))


def test_a_network_of_one_layer() -> None:
    interface = Interface(NAMES[:1], "float64", "choice", counts=(3,))
    made = NetworkPolicy(
        "M", interface, Network((), (Layer(np.ones((3, 1)), np.zeros(3), "identity"),)), False, {}
    )
    assert onnx_of(made)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A policy is exported for the environment that it is for, and verified from the file."""
    model, folder = "example:watertank", tmp_path / "m"
    manifest = manifest_of(compilation_of(model, {}).planned.build, "", {})
    interface = interface_of(manifest)
    network = Network((), layers(np.random.default_rng(1), [len(interface.observations), 8, 1], "relu"))
    write_policy(NetworkPolicy(manifest.name, interface, network, False, manifest.options), tmp_path)
    code, out, _ = run(capsys, "monitor", model, "--policy", str(tmp_path), "-o", str(folder), "--onnx")
    assert code == 0 and "Water_tank_policy.onnx" in out
    answers = [
        json.loads(run(capsys, "verify", model, "--policy", str(path), "--json")[1])
        for path in (tmp_path, folder / "Water_tank_policy.onnx")
    ]
    assert answers[0]["boxes"] == answers[1]["boxes"] and answers[0]["answer"] == answers[1]["answer"]


def test_onnx_goes_with_a_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = run(capsys, "monitor", "example:watertank", "-o", str(tmp_path / "m"), "--onnx")
    assert code == 1 and "--onnx goes with --policy" in said
