"""Multilayer perceptrons and their gradients, layer by layer. Imports torch: import it only where training
happens.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dl2c.training.activations import Tanh

aten = torch.ops.aten


@dataclass(frozen=True, slots=True)
class Activation:
    """What leaves a layer, from its bias, what enters it, and its weights; and the gradient of the function's
    argument from that of its value and the value.
    """

    layer: Callable[[Tensor, Tensor, Tensor], Tensor]
    gradient: Callable[[Tensor, Tensor], Tensor]


def _tanh_layer(bias: Tensor, inputs: Tensor, weight: Tensor) -> Tensor:
    """Tanh of a is 2 / (1 + exp(-2 a)) - 1: to double is a part of the product, and of the difference."""
    doubled = torch.addmm(bias, inputs, weight.t(), beta=2, alpha=2)
    return torch.rsub(doubled.sigmoid_(), -1.0, alpha=-2.0)


def _after(function: Callable[[Tensor], Tensor]) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """A layer whose function is applied in place."""
    return lambda bias, inputs, weight: function(torch.addmm(bias, inputs, weight.t()))


ACTIVATIONS: dict[type[nn.Module], Activation] = {
    Tanh: Activation(_tanh_layer, aten.tanh_backward),
    nn.Tanh: Activation(_after(torch.tanh_), aten.tanh_backward),
    nn.ReLU: Activation(
        _after(torch.relu_), lambda gradient, value: aten.threshold_backward(gradient, value, 0)
    ),
    nn.ELU: Activation(
        _after(lambda x: nn.functional.elu(x, inplace=True)),
        lambda gradient, value: aten.elu_backward(gradient, 1, 1, 1, True, value),
    ),
    nn.Sigmoid: Activation(_after(torch.sigmoid_), aten.sigmoid_backward),
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
            entering.append(self.activation.layer(layer.bias, entering[-1], layer.weight))
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
