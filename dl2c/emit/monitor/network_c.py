"""A network as C: a function for each scaling and each layer, tables of numbers, loops of fixed length."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import function
from dl2c.policy.network import LARGEST_FLOAT, Activation, Layer, Network, PolicyError, Scaling

FUNCTIONS: dict[Activation, str] = {
    "identity": "sum",
    "tanh": "tanhF(sum)",
    "relu": "sum > 0 ? sum : 0",
    "elu": "sum > 0 ? sum : expm1F(sum)",
    "sigmoid": "1 / (1 + expF(-sum))",
}
"""What becomes of a sum; F stands for the suffix of single precision."""


def network_functions(single: bool, network: Network, size: int, signature: str) -> str:
    """The network for `size` observations, in floats where `single`. `signature` has `observation` and
    `output`.
    """
    parts: list[str] = []
    lines: list[str] = []
    given = "observation"
    for k, scaling in enumerate(network.scalings):
        parts.append(_scaling(single, k, scaling))
        lines += [f"real scaled{k}[{size}];", f"scale{k}({given}, scaled{k});"]
        given = f"scaled{k}"
    last = len(network.layers) - 1
    for k, layer in enumerate(network.layers):
        size = len(layer.bias)
        parts.append(_layer(single, k, layer))
        to = "output" if k == last else f"hidden{k}"
        lines += [*([f"real hidden{k}[{size}];"] if k != last else []), f"layer{k}({given}, {to});"]
        given = to
    if network.bounded:
        lines += [f"for (int i = 0; i < {size}; i++)", f"  output[i] = tanh{_suffix(single)}(output[i]);"]
    return "\n".join([*parts, function(signature, lines)])


def _suffix(single: bool) -> str:
    return "f" if single else ""


def _scaling(single: bool, k: int, scaling: Scaling) -> str:
    n = len(scaling.center)
    value = f"(given[i] - CENTER{k}[i]) / SCALE{k}[i]"
    if np.isfinite(scaling.clip):
        clip = number(scaling.clip) + _suffix(single)
        value = f"clipped({value}, -{clip}, {clip})"
    return "\n".join(
        [
            _table(single, f"CENTER{k}", scaling.center),
            _table(single, f"SCALE{k}", scaling.scale),
            function(
                f"static void scale{k}(const real given[{n}], real result[{n}])",
                [f"for (int i = 0; i < {n}; i++)", f"  result[i] = {value};"],
                "Observations as the network was trained on.",
            ),
        ]
    )


def _layer(single: bool, k: int, layer: Layer) -> str:
    rows, columns = layer.weight.shape
    result = FUNCTIONS[layer.activation].replace("F(", f"{_suffix(single)}(")
    lines = [
        f"for (int i = 0; i < {rows}; i++) {{",
        f"  real sum = BIAS{k}[i];",
        f"  for (int j = 0; j < {columns}; j++)",
        f"    sum += WEIGHT{k}[i][j] * given[j];",
        f"  result[i] = {result};",
        "}",
    ]
    about = "" if layer.activation == "identity" else f", through {layer.activation}"
    return "\n".join(
        [
            _table(single, f"BIAS{k}", layer.bias),
            _table(single, f"WEIGHT{k}", layer.weight),
            function(
                f"static void layer{k}(const real given[{columns}], real result[{rows}])",
                lines,
                f"A layer of {rows} numbers{about}.",
            ),
        ]
    )


def _table(single: bool, name: str, values: NDArray[Any]) -> str:
    """Numbers as they are, in doubles or rounded to floats. Raises `PolicyError`."""
    if single and np.any(np.abs(values) > LARGEST_FLOAT):
        raise PolicyError("a number of the network is too large for float")
    listed = values.astype(np.float32) if single else values
    if values.ndim == 1:
        return "\n".join(_rows(f"static const real {name}[{len(values)}] = {{", single, listed)) + "\n"
    lines = [f"static const real {name}[{len(values)}][{values.shape[1]}] = {{"]
    for row in listed:
        lines += [f"  {line}" for line in _rows("{", single, row)]
        lines[-1] = lines[-1].replace("};", "},")
    return "\n".join([*lines, "};"]) + "\n"


def _rows(opening: str, single: bool, values: NDArray[Any]) -> Iterator[str]:
    """Numbers between braces, so many a line as fit."""
    line = opening
    for k, value in enumerate(values):
        text = (f"{value!s}f" if single else number(float(value))) + ("," if k + 1 < len(values) else "")
        if len(line) + len(text) > 94:
            yield line.rstrip()
            line = "  "
        line += f"{text} "
    yield f"{line.rstrip()}}};"
