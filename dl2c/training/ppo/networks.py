"""Multilayer perceptrons and their gradients, layer by layer. Imports torch: import it only where training
happens.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dl2c.training.activations import Tanh, tanh_

aten = torch.ops.aten


@dataclass(frozen=True, slots=True)
class Activation:
    """A function, applied in place, and the gradient of its argument from that of its value and the value."""

    apply: Callable[[Tensor], Tensor]
    gradient: Callable[[Tensor, Tensor], Tensor]


ACTIVATIONS: dict[type[nn.Module], Activation] = {
    Tanh: Activation(tanh_, aten.tanh_backward),
    nn.Tanh: Activation(torch.tanh_, aten.tanh_backward),
    nn.ReLU: Activation(torch.relu_, lambda gradient, value: aten.threshold_backward(gradient, value, 0)),
    nn.ELU: Activation(
        lambda x: nn.functional.elu(x, inplace=True),
        lambda gradient, value: aten.elu_backward(gradient, 1, 1, 1, True, value),
    ),
    nn.Sigmoid: Activation(torch.sigmoid_, aten.sigmoid_backward),
}


@dataclass(frozen=True, slots=True)
class Perceptron:
    """Linear layers, activations between them. Every parameter has a `grad`, which is written to."""

    layers: tuple[nn.Linear, ...]
    activation: Activation

    def forward(self, inputs: Tensor) -> tuple[list[Tensor], Tensor]:
        """What enters each layer, (n, width), and what leaves the last one, (outputs, n)."""
        entering = [inputs]
        for layer in self.layers[:-1]:
            entering.append(self.activation.apply(torch.addmm(layer.bias, entering[-1], layer.weight.t())))
        last = self.layers[-1]
        return entering, torch.addmm(last.bias.unsqueeze(1), last.weight, entering[-1].t())

    def backward(self, entering: Sequence[Tensor], gradient: Tensor) -> None:
        """Set the gradients of all parameters from that of what leaves the last layer, (outputs, n)."""
        transposed = gradient
        for k in reversed(range(len(self.layers))):
            layer = self.layers[k]
            assert layer.weight.grad is not None
            assert layer.bias.grad is not None
            torch.mm(transposed, entering[k], out=layer.weight.grad)
            torch.sum(transposed, 1, out=layer.bias.grad)
            if k > 0:
                inner = torch.mm(transposed.t(), layer.weight)
                transposed = self.activation.gradient(inner, entering[k]).t()


def perceptron(hidden: Iterable[nn.Module], last: nn.Module) -> Perceptron | None:
    """Layers of a policy; None where they are others than linear ones with one known activation between."""
    modules = [*hidden, last]
    layers = tuple(m for m in modules if type(m) is nn.Linear)
    between = modules[1::2]
    kinds = {type(m) for m in between} or {Tanh}
    alternate = len(modules) % 2 == 1 and all(type(m) is nn.Linear for m in modules[::2])
    plain = all(not isinstance(m, nn.ELU) or m.alpha == 1.0 for m in between)
    if not alternate or not plain or len(kinds) > 1 or (kind := kinds.pop()) not in ACTIVATIONS:
        return None
    return Perceptron(layers, ACTIVATIONS[kind])
