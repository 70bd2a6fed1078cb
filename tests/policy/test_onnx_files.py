"""Networks from ONNX files compute what ONNX's own evaluator computes; what they cannot be is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from conftest import shared

from dl2c.policy.network import PolicyError
from dl2c.policy.onnx_files import read_onnx

onnx = pytest.importorskip("onnx")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402


def saved(path: Path, nodes: list[Any], arrays: dict[str, Any], inputs: int, last: str) -> Path:
    given = helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, inputs])
    result = helper.make_tensor_value_info(last, TensorProto.FLOAT, None)
    constants = [numpy_helper.from_array(np.asarray(a, np.float32), n) for n, a in arrays.items()]
    onnx.save(helper.make_model(helper.make_graph(nodes, "net", [given], [result], constants)), path)
    return path


def evaluated(path: Path, observations: np.ndarray) -> np.ndarray:
    from onnx.reference import ReferenceEvaluator

    return ReferenceEvaluator(str(path)).run(None, {"x": observations.astype(np.float32)})[0]


def mixed(path: Path) -> Path:
    """Every operation that is understood."""
    rng = np.random.default_rng(2)
    arrays = {
        "w0": rng.normal(size=(3, 7)), "b0": rng.normal(size=7), "w1": rng.normal(size=(5, 7)),
        "b1": rng.normal(size=5), "w2": rng.normal(size=(5, 2)), "c": rng.normal(size=2),
        "low": -0.5, "high": 0.75,
    }  # fmt: skip
    node = helper.make_node
    nodes = [
        node("Flatten", ["x"], ["f"]),
        node("MatMul", ["f", "w0"], ["m"]),
        node("Add", ["b0", "m"], ["a"]),
        node("Relu", ["a"], ["r"]),
        node("Gemm", ["r", "w1", "b1"], ["g"], transB=1),
        node("Tanh", ["g"], ["t"]),
        node("Identity", ["t"], ["i"]),
        node("Gemm", ["i", "w2"], ["h"]),
        node("Add", ["h", "c"], ["y"]),
        node("Clip", ["y", "low", "high"], ["z"]),
    ]
    return saved(path, nodes, arrays, 3, "z")


def test_what_is_computed(tmp_path: Path) -> None:
    path = mixed(tmp_path / "net.onnx")
    read, observations = read_onnx(path), np.random.default_rng(0).normal(size=(500, 3))
    assert read.inputs == 3 and read.clip == (-0.5, 0.75)
    ours = np.clip(read.network.outputs(observations.astype(np.float32)), *read.clip)
    assert np.abs(ours - evaluated(path, observations)).max() < 1e-5


@pytest.mark.parametrize("name", ["acc-3000000-64-64", "acc-2000000-64-64-64-64"])
def test_public_networks(name: str) -> None:
    path = shared("oracle/n3v") / f"{name}.onnx"
    observations = np.random.default_rng(1).uniform([0, -200], [100, 200], (50, 2))
    ours = read_onnx(path).network.outputs(observations.astype(np.float32))
    theirs = np.concatenate([_one(path, row) for row in observations])
    assert np.abs(ours - theirs).max() < 1e-2


def _one(path: Path, row: np.ndarray) -> np.ndarray:
    from onnx.reference import ReferenceEvaluator

    given = onnx.load(path).graph.input[0].name
    return ReferenceEvaluator(str(path)).run(None, {given: row[None].astype(np.float32)})[0]


WRONG = {
    "Sigmoid": "it uses Sigmoid",
    "Relu": "it begins with an activation",
}


@pytest.mark.parametrize("operation", WRONG)
def test_what_is_not_understood(tmp_path: Path, operation: str) -> None:
    path = saved(tmp_path / "net.onnx", [helper.make_node(operation, ["x"], ["y"])], {}, 2, "y")
    with pytest.raises(PolicyError, match=WRONG[operation]):
        read_onnx(path)


def test_two_branches_are_no_chain(tmp_path: Path) -> None:
    weight = {"w": np.eye(2)}
    node = helper.make_node
    nodes = [
        node("MatMul", ["x", "w"], ["a"]),
        node("MatMul", ["x", "w"], ["b"]),
        node("Add", ["a", "b"], ["y"]),
    ]
    with pytest.raises(PolicyError, match="one after the other"):
        read_onnx(saved(tmp_path / "net.onnx", nodes, weight, 2, "y"))


def test_files_that_are_broken(tmp_path: Path) -> None:
    path = mixed(tmp_path / "net.onnx")
    content = path.read_bytes()
    for cut in (b"", b"no network", content[: len(content) // 2]):
        path.write_bytes(cut)
        with pytest.raises(PolicyError):
            read_onnx(path)


def test_monitor_takes_onnx(tmp_path: Path, capsys: Any) -> None:
    """A network with the outputs that actions of the model are made of."""
    rng = np.random.default_rng(4)
    arrays = {"w": rng.normal(size=(1, 5)), "b": rng.normal(size=1)}
    nodes = [helper.make_node("Gemm", ["x", "w", "b"], ["y"], transB=1)]
    path = saved(tmp_path / "net.onnx", nodes, arrays, 5, "y")
    folder = tmp_path / "c"
    code, _, err = run(capsys, "monitor", "example:watertank", "--policy", str(path), "-o", str(folder))
    assert code == 0, err
    assert "WEIGHT0" in next(folder.glob("*_policy.c")).read_text()
    code, _, err = run(capsys, "monitor", "example:waypoint", "--policy", str(path), "-o", str(folder))
    assert code == 1 and "gets 11 numbers" in err
