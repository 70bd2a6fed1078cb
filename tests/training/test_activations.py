"""The tanh of trainings: close to that of torch, with its gradient and its name."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dl2c.training.activations import Tanh  # noqa: E402
from dl2c.training.saved import ACTIVATION  # noqa: E402


def test_it_is_tanh_but_for_rounding() -> None:
    x = torch.cat([torch.linspace(-30.0, 30.0, 10_001), torch.tensor([-1e30, -0.0, 1e-20, 1e30])])
    exact = torch.from_numpy(np.tanh(x.double().numpy()))  # torch.tanh is not, see `learning.FUNCTIONS`
    assert (Tanh()(x) - exact).abs().max() <= 3e-7
    assert Tanh()(x).abs().max() <= 1.0


def test_its_gradient_is_that_of_tanh() -> None:
    x = torch.linspace(-8.0, 8.0, 1001, requires_grad=True)
    weights = torch.linspace(1.0, 2.0, 1001)
    (found,) = torch.autograd.grad((Tanh()(x) * weights).sum(), x)
    (expected,) = torch.autograd.grad((torch.tanh(x) * weights).sum(), x)
    assert (found - expected).abs().max() <= 1e-6


def test_policies_with_it_are_saved_as_tanh() -> None:
    assert ACTIVATION[Tanh.__name__] == "tanh"
