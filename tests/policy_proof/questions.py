"""Questions about networks that are made here, for the tests of this folder."""

from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np

from dl2c.ir.model import TRUE, Formula, Symbol
from dl2c.policy.network import Activation, Layer, Network, Scaling
from dl2c.policy_proof.question import Arithmetic, Case, Observed, Premise, Question, Range, Request

UNLIMITED = (-np.inf, np.inf)


def layers(
    rng: np.random.Generator, sizes: list[int], activation: Activation, scale: float = 1.0
) -> tuple[Layer, ...]:
    """A network with random weights that are float32 numbers."""
    made: list[Layer] = []
    for k, (inputs, outputs) in enumerate(pairwise(sizes)):
        weight = (scale * rng.normal(size=(outputs, inputs)) / np.sqrt(inputs)).astype(np.float32)
        bias = (0.3 * rng.normal(size=outputs)).astype(np.float32)
        last = k == len(sizes) - 2
        made.append(Layer(weight.astype(float), bias.astype(float), "identity" if last else activation))
    return tuple(made)


def question(
    network: tuple[Layer, ...],
    box: tuple[Range, ...],
    conclusion: Formula,
    hypothesis: Formula = TRUE,
    arithmetic: Arithmetic = "double",
    scalings: tuple[Scaling, ...] = (),
    rounded: bool = False,
) -> Question:
    """One case: the only request y, between -1000 and 1000, satisfies the conclusion over x0, x1, ..., y."""
    names = tuple(Symbol(f"x{k}", "variable") for k in range(len(box)))
    observed = tuple(Observed(s.name, s, *UNLIMITED, rounded) for s in names)
    request = Request(Fraction(-1000), Fraction(1000), False, Symbol("y", "input"))
    cases = (
        Case((Premise(0, None, Fraction(-1000), False, Fraction(-1000)),), (), TRUE, ""),
        Case((Premise(0, Fraction(-1000), Fraction(1000), True, None),), (), conclusion, ""),
        Case((Premise(0, Fraction(1000), None, False, Fraction(1000)),), (), TRUE, ""),
    )
    return Question(names, box, hypothesis, observed, scalings, network, (request,), cases, arithmetic)


def onnx_file(network: Network, path: Path, clip: tuple[float, float] | None = None) -> Path:
    """The network as an ONNX file, in float32."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    nodes: list[onnx.NodeProto] = []
    constants: list[onnx.TensorProto] = []
    current = "x"
    for k, layer in enumerate(network.layers):
        constants += [
            numpy_helper.from_array(layer.weight.astype(np.float32), f"w{k}"),
            numpy_helper.from_array(layer.bias.astype(np.float32), f"b{k}"),
        ]
        nodes.append(helper.make_node("Gemm", [current, f"w{k}", f"b{k}"], [f"z{k}"], transB=1))
        current = f"z{k}"
        if layer.activation != "identity":
            nodes.append(helper.make_node(layer.activation.capitalize(), [current], [f"h{k}"]))
            current = f"h{k}"
    if clip is not None:
        constants += [numpy_helper.from_array(np.float32(v), f"c{k}") for k, v in enumerate(clip)]
        nodes.append(helper.make_node("Clip", [current, "c0", "c1"], ["clipped"]))
        current = "clipped"
    size = network.layers[0].weight.shape[1]
    given = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, size])
    result = helper.make_tensor_value_info(current, TensorProto.FLOAT, None)
    onnx.save(helper.make_model(helper.make_graph(nodes, "policy", [given], [result], constants)), path)
    return path
