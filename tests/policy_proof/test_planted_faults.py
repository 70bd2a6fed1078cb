"""No policy with a fault is proved, and no state of a proved policy has one: many random networks.

Slow: `make prove-slow`. DL2C_MUTANTS says how many faults are planted, DL2C_SEED which.
"""

import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from policy_proof.questions import layers, onnx_file
from policy_proof.test_false_claims import policy
from policy_proof.test_verify_policy import SWITCH, TANK

from dl2c.commands.policy import Asked, report_on
from dl2c.policy.network import Layer, Network

pytest.importorskip("onnx")

FAULTS = int(os.environ.get("DL2C_MUTANTS", "200"))
SEED = int(os.environ.get("DL2C_SEED", "0"))
POINTS = 500_000


def controller(rng: np.random.Generator) -> Network:
    """u = 0.5 - l / 10 and a random part of a tenth."""
    random = layers(rng, [1, 10, 8, 1], "relu")
    scale = np.float32(
        0.1 / max(1.0, np.abs(Network((), random).outputs(np.linspace(0, 5, 500)[:, None])).max())
    )
    first, second, last = random
    inner = Layer(np.vstack([first.weight, [[1.0]]]), np.append(first.bias, 0.0), "relu")
    middle = Layer(
        np.block([[second.weight, np.zeros((8, 1))], [np.zeros((1, 10)), np.ones((1, 1))]]),
        np.append(second.bias, 0.0),
        "relu",
    )
    outer = np.append(last.weight[0] * scale, np.float32(-0.1))[None].astype(np.float32).astype(float)
    return Network((), (inner, middle, Layer(outer, np.array([0.5]), "identity")))


def with_tent(network: Network, height: float, center: float, width: float) -> Network:
    """The network and a tent of relu around a state."""
    inner, middle, outer = network.layers
    rows, size = len(inner.bias), len(middle.bias)
    ends = np.array([width - center, -center, -width - center])
    first = Layer(np.vstack([inner.weight, np.ones((3, 1))]), np.append(inner.bias, ends), "relu")
    weight = np.block([[middle.weight, np.zeros((size, 3))], [np.zeros((3, rows)), np.eye(3)]])
    tent = np.array([[height / width, -2 * height / width, height / width]])
    last = Layer(np.hstack([outer.weight, tent]), outer.bias, "identity")
    return Network((), (first, Layer(weight, np.append(middle.bias, np.zeros(3)), "relu"), last))


def outputs(network: Network, levels: np.ndarray) -> np.ndarray:
    """In doubles and in the order of the exported C, for many states at once."""
    values = [levels]
    for layer in network.layers:
        made: list[np.ndarray] = []
        for row, bias in zip(layer.weight.tolist(), layer.bias.tolist(), strict=True):
            total = np.full_like(levels, bias)
            for weight, value in zip(row, values, strict=True):
                total = total + weight * value
            made.append(np.maximum(total, 0) if layer.activation == "relu" else total)
        values = made
    return values[0]


def admissible(level: float, output: float) -> bool:
    asked = min(max(Fraction(output), Fraction(0)), Fraction(0.6))
    after = Fraction(level) + asked - Fraction(1, 4)
    return asked <= Fraction(6, 10) and 0 <= after <= 5


def answer(tmp_path: Path, network: Network) -> str:
    (tmp_path / "tank.kyx").write_text(TANK)
    file = onnx_file(network, tmp_path / "net.onnx")
    return report_on(
        str(tmp_path / "tank.kyx"), Asked(file, inputs="l", outputs=("u=0:0.6",), seconds=10), {}
    ).answer


def states(rng: np.random.Generator) -> np.ndarray:
    """Random ones, fractions of powers of two at which boxes are split, and what is next to these."""
    splits = 5 * rng.integers(0, 2**12, POINTS // 4) / 2**12
    near = [np.nextafter(splits, rng.choice([-9, 9], len(splits))) for _ in range(2)]
    return np.clip(np.concatenate([rng.uniform(0, 5, POINTS // 4), splits, *near]), 0, 5)


@pytest.mark.slow
def test_proved_policies_have_no_fault(tmp_path: Path) -> None:
    proved = 0
    for seed in range(SEED, SEED + 20):
        rng = np.random.default_rng(seed)
        network = controller(rng)
        if answer(tmp_path, network) != "proved":
            continue
        proved += 1
        levels = states(rng)
        asked = outputs(network, levels)
        after = levels + np.clip(asked, 0, 0.6) - 0.25
        close = (after < 1e-9) | (after > 5 - 1e-9) | (asked > 0.6 - 1e-9)
        assert all(
            admissible(a, b) for a, b in zip(levels[close].tolist(), asked[close].tolist(), strict=True)
        )
    assert proved >= 5


@pytest.mark.slow
def test_no_planted_fault_is_proved(tmp_path: Path) -> None:
    """In so many networks, in half of them where less than a millionth of the states is."""
    planted = thin = 0
    for seed in range(SEED, SEED + 4 * FAULTS):
        if planted == FAULTS:
            break
        rng = np.random.default_rng(seed)
        width = 2.0 ** -int(rng.integers(19, 22) if seed % 3 else rng.integers(8, 19))
        center = float(np.float32(rng.uniform(4.8, 4.95)))
        network = with_tent(controller(rng), 2.0, center, width)
        if admissible(center, float(outputs(network, np.array([center]))[0])):
            continue
        planted += 1
        thin += 2 * width / 5 < 1e-6
        assert answer(tmp_path, network) != "proved", seed
    assert planted == FAULTS and thin >= FAULTS // 2


def deciding(rng: np.random.Generator, center: float, width: float, tie: bool) -> tuple[Layer, ...]:
    """The second alternative where x > 0, by how much larger its logit is. With `tie` that is 0 beyond the
    center; else the first one's logit is larger within a width of it. The first alternative is admissible in
    neither case.
    """
    scale = float(rng.uniform(0.5, 2.0))
    kinks = [0.0, 0.0, center - width, center, center + width]
    inner = Layer(np.array([[1.0], [-1.0], *[[1.0]] * 3]), -np.array(kinks), "relu")
    steep, peak = scale * (center - width) / width, 2 * center * scale / width
    first = [0.0] * 5 if tie else [0.0, 0.0, peak, -2 * peak, peak]
    second = [scale, -scale, *([-scale - steep, steep, 0.0] if tie else [0.0] * 3)]
    return inner, Layer(np.array([first, second]), np.zeros(2), "identity")


def chosen(network: tuple[Layer, ...], x: float) -> int:
    """Of equal logits the first."""
    inner, last = network
    made = np.maximum(inner.weight[:, 0] * x + inner.bias, 0)
    return int(np.argmax(last.weight @ made + last.bias))


@pytest.mark.slow
@pytest.mark.parametrize("tie", [False, True])
def test_no_planted_fault_of_an_order_is_proved(tmp_path: Path, tie: bool) -> None:
    """Where x > 1 only the second alternative is admissible, and the first one is taken."""
    (tmp_path / "switch.kyx").write_text(SWITCH)
    model, planted = str(tmp_path / "switch.kyx"), 0
    for seed in range(SEED, SEED + FAULTS // 5):
        rng = np.random.default_rng([seed, tie])
        center = float(np.float32(rng.uniform(1.2, 1.9)))
        width = 2.0 ** -int(rng.integers(3, 20))
        network = deciding(rng, center, width, tie)
        good = (network[0], Layer(network[1].weight * [1, 1, 0, 0, 0], network[1].bias, "identity"))
        assert report_on(model, Asked(policy(model, [], layers=good), seconds=10), {}).answer == "proved"
        if chosen(network, center) == 0:
            planted += 1
            found = policy(model, [], layers=network)
            assert report_on(model, Asked(found, seconds=10), {}).answer != "proved", seed
    assert planted >= FAULTS // 20
