"""Bounds of networks hold for exact evaluation, and for every way to round within the arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from policy_proof.questions import layers, question

from dl2c.ir.model import TRUE
from dl2c.native.boxes import Judge
from dl2c.policy.network import Activation, Layer, Scaling
from dl2c.policy_proof.question import Arithmetic
from dl2c.policy_proof.tables import tables_of

WIDTHS = (2.0, 0.1, 1e-4, 1e-9, 0.0)


def exact(network: tuple[Layer, ...], point: list[Fraction]) -> Fraction:
    """The output of a network of relu, in fractions."""
    values = point
    for layer in network:
        sums = [
            Fraction(b) + sum((Fraction(w) * v for w, v in zip(row, values, strict=True)), Fraction(0))
            for row, b in zip(layer.weight.tolist(), layer.bias.tolist(), strict=True)
        ]
        values = [max(s, Fraction(0)) for s in sums] if layer.activation == "relu" else sums
    return values[0]


def disturbed(network: tuple[Layer, ...], point: np.ndarray, unit: float, rng: np.random.Generator) -> float:
    """The output where every operation has the largest error of its arithmetic, up or down, and sums are
    added in any order.
    """
    values = point.astype(np.longdouble)

    def wrong(x: np.ndarray) -> np.ndarray:
        return x * (1 + np.longdouble(unit) * rng.choice([-1, 1], size=np.shape(x)))

    for layer in network:
        sums: list[np.longdouble] = []
        for row, bias in zip(layer.weight, layer.bias, strict=True):
            terms = np.concatenate([[np.longdouble(bias)], wrong(row.astype(np.longdouble) * values)])
            total = np.longdouble(0)
            for term in rng.permutation(terms):
                total = wrong(total + term)
            sums.append(total)
        values = np.array(sums)
        if layer.activation == "relu":
            values = np.maximum(values, 0)
        elif layer.activation == "tanh":
            values = np.tanh(values) * (1 + 3 * np.longdouble(unit) * rng.choice([-1, 1], size=len(values)))
    return float(values[0])


def boxes(rng: np.random.Generator, dimensions: int) -> list[np.ndarray]:
    middles = rng.uniform(-2, 2, (len(WIDTHS), dimensions))
    return [np.stack([m - w / 2, m + w / 2], 1) for m, w in zip(middles, WIDTHS, strict=True)]


def range_of(linear: np.ndarray) -> tuple[Fraction, Fraction]:
    below, above = ([Fraction(float(v)) for v in row] for row in linear[0])
    return below[0] - sum(map(abs, below[1:])), above[0] + sum(map(abs, above[1:]))


@pytest.mark.parametrize("seed", range(6))
def test_relu_is_enclosed_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dimensions = int(rng.integers(1, 5))
    network = layers(rng, [dimensions, 12, 9, 5, 1], "relu", 2.0)
    unit_box = tuple((Fraction(-3), Fraction(3)) for _ in range(dimensions))
    judge = Judge(tables_of(question(network, unit_box, TRUE, arithmetic="real")))
    for box in boxes(rng, dimensions):
        linear = judge.linear(box)
        assert linear is not None
        low, high = range_of(linear)
        for _ in range(30):
            share = rng.choice([0, 1, rng.uniform()], dimensions)
            point = np.clip(box[:, 0] + share * (box[:, 1] - box[:, 0]), box[:, 0], box[:, 1])
            value = exact(network, [Fraction(float(v)) for v in point])
            assert low <= value <= high
        if box[0, 0] == box[0, 1]:
            assert high - low < 1e-9


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize(("arithmetic", "unit"), [("double", 2.0**-53), ("float32", 2.0**-24)])
def test_every_rounding_is_enclosed(activation: Activation, arithmetic: Arithmetic, unit: float) -> None:
    rng = np.random.default_rng(7)
    network = layers(rng, [2, 10, 8, 1], activation, 3.0)
    judge = Judge(
        tables_of(question(network, ((Fraction(-3), Fraction(3)),) * 2, TRUE, arithmetic=arithmetic))
    )
    for box in boxes(rng, 2):
        linear = judge.linear(box)
        assert linear is not None
        low, high = map(float, range_of(linear))
        for _ in range(20):
            point = np.clip(rng.uniform(box[:, 0], box[:, 1]), box[:, 0], box[:, 1])
            assert low <= disturbed(network, point, unit, rng) <= high


def test_bounds_of_a_point_are_of_the_size_of_rounding_errors() -> None:
    rng = np.random.default_rng(3)
    network = layers(rng, [2, 16, 16, 1], "tanh")
    point = np.array([[0.25, 0.25], [-0.5, -0.5]])
    widths = []
    for arithmetic in ("double", "float32"):
        judge = Judge(
            tables_of(question(network, ((Fraction(-3), Fraction(3)),) * 2, TRUE, arithmetic=arithmetic))
        )
        linear = judge.linear(point)
        assert linear is not None
        low, high = range_of(linear)
        widths.append(float(high - low))
    assert 1e-17 < widths[0] < 1e-11
    assert 1e-8 < widths[1] < 1e-2


def test_scalings_and_float32_observations() -> None:
    rng = np.random.default_rng(11)
    network = layers(rng, [2, 8, 1], "relu", 2.0)
    scaling = Scaling(np.array([0.3, -1.7]), np.array([0.7, 2.3]), 1.5)
    asked = question(network, ((Fraction(-3), Fraction(3)),) * 2, TRUE, scalings=(scaling,), rounded=True)
    judge = Judge(tables_of(asked))
    for box in boxes(rng, 2):
        linear = judge.linear(box)
        assert linear is not None
        low, high = range_of(linear)
        for _ in range(50):
            point = np.clip(rng.uniform(box[:, 0], box[:, 1]), box[:, 0], box[:, 1])
            given = scaling.of(point.astype(np.float32).astype(float))
            value = np.maximum(network[0].weight @ given + network[0].bias, 0)
            assert low <= Fraction(float((network[1].weight @ value + network[1].bias)[0])) <= high


def test_numbers_that_overflow_are_not_bounded() -> None:
    network = (
        Layer(np.array([[1e308]]), np.zeros(1), "identity"),
        Layer(np.array([[1e308]]), np.zeros(1), "identity"),
    )
    judge = Judge(tables_of(question(network, ((Fraction(-3), Fraction(3)),), TRUE)))
    assert judge.linear(np.array([[1.0, 2.0]])) is None
