"""Networks from ONNX files: chains of Gemm, MatMul, Add, Relu, Tanh, Identity, Flatten and Clip.

What a file means is computed in doubles, as of any other policy: its numbers are exact there. Needs the
extra `onnx`, which is imported when called.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dl2c.inputs import read_input
from dl2c.policy.files import MAX_ARRAYS
from dl2c.policy.network import Activation, Floats, Layer, Network, PolicyError

LEAST = {"Gemm": 2, "MatMul": 2, "Add": 2, "Relu": 1, "Tanh": 1, "Identity": 1, "Flatten": 1, "Clip": 1}
"""The operations that are read, and how many inputs each has at least."""

ACTIVATIONS: dict[str, Activation] = {"Relu": "relu", "Tanh": "tanh"}
MOST_NODES = 1000


@dataclass(frozen=True, slots=True)
class OnnxNetwork:
    """A network with how many numbers it takes, and the limits that its last operation clips to, if any."""

    network: Network
    inputs: int
    clip: tuple[float, float] | None


def read_onnx(path: Path) -> OnnxNetwork:
    """The network of a file. Raises `PolicyError`, `OSError`, `ModuleNotFoundError`."""
    import onnx
    from google.protobuf.message import DecodeError

    content = read_input(path, MAX_ARRAYS)
    try:
        model: Any = onnx.load_model_from_string(content)
    except (DecodeError, ValueError):
        raise PolicyError(f"{path} is no ONNX file") from None
    try:
        return _Chain(model.graph).read()
    except PolicyError as problem:
        raise PolicyError(f"{path}: {problem}") from None


class _Chain:
    """Operations one after the other, from the only input to the only output."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.constants = {t.name: _numbers(t) for t in graph.initializer}
        self.layers: list[Layer] = []
        self.clip: tuple[float, float] | None = None

    def read(self) -> OnnxNetwork:
        given = [i.name for i in self.graph.input if i.name not in self.constants]
        if len(given) != 1 or len(self.graph.output) != 1:
            raise PolicyError("it does not have one input and one output")
        if len(self.graph.node) > MOST_NODES:
            raise PolicyError(f"it has more than {MOST_NODES} operations")
        current = given[0]
        for node in self.graph.node:
            if node.op_type == "Constant":
                self._constant(node)
                continue
            if node.op_type not in LEAST:
                raise PolicyError(f"it uses {node.op_type}; there is {', '.join(LEAST)}")
            if current not in node.input or len(node.output) != 1 or len(node.input) < LEAST[node.op_type]:
                raise PolicyError("its operations are not one after the other")
            if self.clip is not None:
                raise PolicyError("it clips before its last operation")
            self._apply(node, current)
            current = node.output[0]
        if current != self.graph.output[0].name or not self.layers:
            raise PolicyError("its operations do not lead from the input to the output")
        self._check_sizes()
        return OnnxNetwork(Network((), tuple(self.layers)), self.layers[0].weight.shape[1], self.clip)

    def _check_sizes(self) -> None:
        """Raises `PolicyError` unless each layer takes what the one before gives, in finite numbers."""
        size = self.layers[0].weight.shape[1]
        for layer in self.layers:
            rows, columns = layer.weight.shape
            if columns != size or layer.bias.shape != (rows,) or 0 in (rows, columns):
                raise PolicyError(f"a layer takes {columns} numbers and is given {size}")
            if not (np.isfinite(layer.weight).all() and np.isfinite(layer.bias).all()):
                raise PolicyError("a number of the network is not finite")
            size = rows

    def _constant(self, node: Any) -> None:
        named = {a.name: a for a in node.attribute}
        if "value" not in named or len(node.output) != 1:
            raise PolicyError("it has a constant that is not a tensor")
        self.constants[node.output[0]] = _numbers(named["value"].t)

    def _apply(self, node: Any, current: str) -> None:
        match node.op_type:
            case "Gemm":
                self._gemm(node, current)
            case "MatMul":
                if node.input[0] != current:
                    raise PolicyError("it multiplies its input from the left")
                weight = self._matrix(node.input[1])
                columns = weight.T.copy()
                self.layers.append(Layer(columns, np.zeros(len(columns)), "identity"))
            case "Add":
                self._add(next(n for n in (*node.input, "") if n != current))
            case "Relu" | "Tanh" as name:
                self._activate(ACTIVATIONS[name])
            case "Clip":
                ends = {a.name: float(a.f) for a in node.attribute}  # before version 11 of the operations
                low, high, *_ = (*node.input[1:], "", "")
                self.clip = (
                    self._scalar(low, ends.get("min", -np.inf)),
                    self._scalar(high, ends.get("max", np.inf)),
                )
            case _:
                pass

    def _gemm(self, node: Any, current: str) -> None:
        """alpha * x * weight + beta * bias."""
        settings = {a.name: a.i if a.name.startswith("trans") else a.f for a in node.attribute}
        if node.input[0] != current or settings.get("transA", 0):
            raise PolicyError("it multiplies its input in another way than a layer does")
        if settings.get("alpha", 1.0) != 1 or settings.get("beta", 1.0) != 1:
            raise PolicyError("it has a Gemm with alpha or beta other than 1")
        weight = self._matrix(node.input[1])
        weight = weight if settings.get("transB", 0) else weight.T.copy()
        bias = self._vector(node.input[2]) if len(node.input) > 2 else np.zeros(1, np.float64)
        self.layers.append(Layer(weight, _spread(bias, len(weight)), "identity"))

    def _add(self, name: str) -> None:
        bias = self._vector(name)
        last = self.layers[-1] if self.layers else None
        if last is not None and last.activation == "identity" and not last.bias.any():
            self.layers[-1] = replace(last, bias=_spread(bias, len(last.bias)))
        elif last is None:
            self.layers.append(Layer(np.eye(len(bias)), bias, "identity"))
        else:
            size = len(last.bias)
            self.layers.append(Layer(np.eye(size), _spread(bias, size), "identity"))

    def _activate(self, activation: Activation) -> None:
        if not self.layers:
            raise PolicyError("it begins with an activation")
        last = self.layers[-1]
        if last.activation == "identity":
            self.layers[-1] = replace(last, activation=activation)
        else:
            size = len(last.bias)
            self.layers.append(Layer(np.eye(size), np.zeros(size), activation))

    def _matrix(self, name: str) -> Floats:
        found = self.constants.get(name)
        if found is None or found.ndim != 2:
            raise PolicyError(f"{name!r} is not a matrix of numbers")
        return found

    def _vector(self, name: str) -> Floats:
        found = self.constants.get(name)
        if found is None or found.size != max(found.shape, default=1):
            raise PolicyError(f"{name!r} is not a vector of numbers")
        return found.reshape(-1)

    def _scalar(self, name: str, default: float) -> float:
        if not name:
            return default
        numbers = self._vector(name)
        if len(numbers) != 1:
            raise PolicyError(f"{name!r} is not a number")
        return float(numbers[0])


def _spread(bias: Floats, size: int) -> Floats:
    """A bias for each row; a single number counts for all."""
    if len(bias) not in (1, size):
        raise PolicyError(f"a bias has {len(bias)} numbers, its layer {size}")
    return bias if len(bias) == size else np.full(size, bias[0])


def _numbers(tensor: Any) -> Floats:
    """A tensor of floats as doubles. What stands in other files is not read."""
    from onnx import TensorProto, numpy_helper

    if tensor.data_location == TensorProto.EXTERNAL:
        raise PolicyError("it keeps numbers in other files")
    if tensor.data_type not in (TensorProto.FLOAT, TensorProto.DOUBLE):
        return np.zeros((0, 0, 0))
    try:
        return np.asarray(numpy_helper.to_array(tensor), np.float64)
    except ValueError:
        raise PolicyError(f"{tensor.name!r} is not a tensor") from None
