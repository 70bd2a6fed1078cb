"""Policies as ONNX files, in doubles: what `policy.onnx_files` reads again, but for scaled observations.

Needs the extra `onnx`, which is imported when called.
"""

from typing import Any

import numpy as np

from dl2c.policy.network import Floats, NetworkPolicy
from dl2c.version import __version__

OPSET, IR_VERSION = 13, 8
"""Of the format: what runtimes of the last years read."""

OPERATORS = {"relu": "Relu", "tanh": "Tanh", "elu": "Elu", "sigmoid": "Sigmoid"}


def onnx_of(policy: NetworkPolicy) -> bytes:
    """A file that takes observations (n, nobs) and gives (n, outputs): numbers of which the largest counts,
    or requests that the environment clips to its limits. Raises `ModuleNotFoundError`.
    """
    import onnx

    helper: Any = onnx.helper
    number: int = onnx.TensorProto.DOUBLE
    graph = _Graph()
    for scaling in policy.network.scalings:
        graph.add("Sub", scaling.center)
        graph.add("Div", scaling.scale)
        graph.add("Clip", np.float64(-scaling.clip), np.float64(scaling.clip))
    for layer in policy.network.layers:
        graph.add("Gemm", layer.weight, layer.bias, transB=1)
        if layer.activation == "elu":  # which runtimes have in single precision alone
            graph.add("Cast", to=onnx.TensorProto.FLOAT)
        if layer.activation != "identity":
            graph.add(OPERATORS[layer.activation])
        if layer.activation == "elu":
            graph.add("Cast", to=number)
    if policy.network.bounded:
        graph.add("Tanh")
        low, high = np.array(policy.interface.low), np.array(policy.interface.high)
        graph.add("Gemm", np.diag((high - low) / 2), low + (high - low) / 2, transB=1)
    given = helper.make_tensor_value_info("observations", number, [None, graph.inputs])
    result = helper.make_tensor_value_info(graph.last, number, [None, policy.interface.outputs])
    made = helper.make_graph(graph.nodes, policy.model, [given], [result], graph.constants)
    opset = helper.make_opsetid("", OPSET)
    model: Any = helper.make_model(
        made, opset_imports=[opset], ir_version=IR_VERSION, producer_name="dl2c", producer_version=__version__
    )
    checker: Any = onnx.checker
    checker.check_model(model)
    return model.SerializeToString()


class _Graph:
    """Operations one after the other, from `observations` to `last`."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.last = "observations"
        self.inputs = 0

    def add(self, operator: str, *numbers: Floats | np.float64, **attributes: int) -> None:
        """An operation on what came last, with further arguments."""
        import onnx

        helper: Any = onnx.helper
        names = [f"{operator.lower()}_{len(self.nodes)}_{k}" for k in range(len(numbers))]
        self.constants += [
            onnx.numpy_helper.from_array(np.asarray(n, np.float64), name)
            for n, name in zip(numbers, names, strict=True)
        ]
        if not self.nodes:
            self.inputs = np.asarray(numbers[0]).shape[-1]
        made = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, [self.last, *names], [made], **attributes))
        self.last = made
