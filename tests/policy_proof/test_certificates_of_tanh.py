"""Certificates of networks with tanh: accepted as they are, refused where the tree or the claim is changed.

What is changed gets the digest of the changed question, so that the boxes have to be found wrong.
"""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from commands.test_cli import run
from policy_proof.questions import layers, onnx_file, question
from policy_proof.test_certificates import BOX, CHANGES, rewritten
from policy_proof.test_network_bounds import disturbed
from policy_proof.test_verify_policy import TANK
from selection import quick_among

from dl2c.commands.policy import Asked, checked_certificate, report_on
from dl2c.ir.model import Compare, Number, Symbol
from dl2c.policy.files import write_policy
from dl2c.policy.network import Activation, Interface, Layer, Network, NetworkPolicy, Scaling
from dl2c.policy_proof import fixed_point, hyperbolic
from dl2c.policy_proof.certificate import CertificateError, certificate, check
from dl2c.policy_proof.fixed_point import ONE, Rounding, down, up
from dl2c.policy_proof.linear_bounds import NetworkBounds
from dl2c.policy_proof.question import Arithmetic, Question
from dl2c.policy_proof.search import Limits, search
from dl2c.policy_proof.tree import BY_BOUNDS

Tree = tuple[bytes, ...]

GRID = np.stack(np.meshgrid(*[np.linspace(-1, 1, 81)] * 2), -1).reshape(-1, 2)


def below(limit: float) -> Compare:
    return Compare("<", Symbol("y", "input"), Number(Fraction(limit)))


def with_limit(asked: Question, limit: float) -> Question:
    """That the request is below a limit."""
    first, inner, last = asked.cases
    return replace(asked, cases=(first, replace(inner, conclusion=below(limit)), last))


def largest(asked: Question, points: np.ndarray) -> float:
    """Of what is asked for at some points, within 1e-12, or 1e-5 in single precision."""
    given = points.astype(np.float32).astype(float) if asked.observed[0].rounded else points
    values = Network(asked.scalings, asked.layers).outputs(given)[:, 0]
    request = asked.requests[0]
    low, high = float(request.low), float(request.high)
    return float((low + (values + 1) / 2 * (high - low) if request.stretched else values).max())


def plain(seed: int, arithmetic: Arithmetic = "double") -> Question:
    network = layers(np.random.default_rng(seed), [2, 6, 6, 1], "tanh", 2.0)
    return question(network, BOX, below(0.0), arithmetic=arithmetic)


def squashed(seed: int) -> Question:
    """Its output is squashed and stretched over the limits, and observations are scaled."""
    rng = np.random.default_rng(seed)
    *inner, last = layers(rng, [2, 6, 6, 1], "tanh", 2.0)
    scaling = Scaling(rng.uniform(-0.5, 0.5, 2), rng.uniform(0.5, 2, 2), 1.5)
    network = (*inner, replace(last, activation="tanh"))
    made = question(network, BOX, below(0.0), scalings=(scaling,), rounded=True)
    return replace(made, requests=(replace(made.requests[0], stretched=True),))


def mixed(seed: int) -> Question:
    """tanh, then relu."""
    first, second, last = layers(np.random.default_rng(seed), [2, 6, 6, 1], "tanh", 2.0)
    return question((first, replace(second, activation="relu"), last), BOX, below(0.0))


KINDS: dict[str, Callable[[int], Question]] = {
    "tanh": plain,
    "squashed": squashed,
    "mixed": mixed,
    "real": lambda seed: plain(seed, "real"),
    "float32": lambda seed: plain(seed, "float32"),
}

MARGIN = {"squashed": 20.0}
"""Of the limit from what is asked for; else 0.02."""


def proof(made: Callable[[int], Question], seed: int, margin: float) -> tuple[Question, float, Tree]:
    """A question with a proof, what is asked for at most on a grid, and the tree."""
    asked = made(seed)
    most = largest(asked, GRID)
    asked = with_limit(asked, most + margin)
    found = search(asked, Limits(30, 2))
    assert found.answer == "proved"
    return asked, most, found.tree


def refused(folder: Path, asked: Question, tree: Tree) -> bool:
    path = folder / "proof.json"
    path.write_text(certificate([asked], [tree]))
    try:
        check(path, [asked])
    except CertificateError as problem:
        assert "not proved" in str(problem)
        return True
    return False


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_proofs_pass(tmp_path: Path, name: str, seed: int) -> None:
    asked, _, tree = proof(KINDS[name], seed, MARGIN.get(name, 0.02))
    assert not refused(tmp_path, asked, tree)


@pytest.mark.parametrize("name", ["tanh", "squashed"])
@pytest.mark.parametrize("change", CHANGES, ids=lambda c: c.__name__)
def test_other_trees_are_refused(
    tmp_path: Path, name: str, change: Callable[[bytearray, list[int]], None]
) -> None:
    asked, _, tree = proof(KINDS[name], 1, MARGIN.get(name, 0.02))
    assert len(tree) > 3
    path = tmp_path / "proof.json"
    path.write_text(certificate([asked], [tree]))
    path.write_text(rewritten(path, change))
    with pytest.raises(CertificateError):
        check(path, [asked])


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", quick_among(range(8), (0, 1)))
def test_a_limit_that_is_passed_by_little_is_refused(tmp_path: Path, name: str, seed: int) -> None:
    """The claim is false at a point of the grid by the smallest margin that is certain."""
    asked, most, tree = proof(KINDS[name], seed, MARGIN.get(name, 0.02))
    little = 1e-4 if name == "float32" else 1e-9 if name == "squashed" else 1e-12
    assert refused(tmp_path, with_limit(asked, most - little), tree)
    assert refused(tmp_path, with_limit(asked, most - 0.1), (bytes([BY_BOUNDS]),))


@pytest.mark.parametrize("name", ["tanh", "squashed", "mixed"])
def test_false_claims_about_what_was_changed_are_refused(tmp_path: Path, name: str) -> None:
    """An enlarged box, and swapped weights, where these make the claim false."""
    boxes = weights = 0
    for seed in range(20):
        asked, _, tree = proof(KINDS[name], seed, MARGIN.get(name, 0.02))
        limit = asked.cases[1].conclusion
        assert isinstance(limit, Compare) and isinstance(limit.right, Number)
        enlarged = replace(asked, box=((Fraction(-2), Fraction(2)), BOX[1]))
        if largest(enlarged, GRID * (2, 1)) > limit.right.value + Fraction(1, 100):
            boxes += 1
            assert refused(tmp_path, enlarged, tree)
        *rest, last = asked.layers
        weight = last.weight[:, [1, 0, *range(2, 6)]]
        swapped = replace(asked, layers=(*rest, replace(last, weight=weight)))
        if largest(swapped, GRID) > limit.right.value + Fraction(1, 100):
            weights += 1
            assert refused(tmp_path, swapped, tree)
    assert boxes >= 3 and weights >= 3


# Bounds -------------------------------------------------------------------------------------------


def exact(network: tuple[Layer, ...], point: list[Fraction], error: float = 0.0, sign: int = 1) -> Any:
    """The output for real numbers, tanh wrong by a relative error that has the sign of what follows."""
    values = [mpmath.mpf(v.numerator) / v.denominator for v in point]
    for layer in network:
        rows = zip(layer.weight.tolist(), layer.bias.tolist(), strict=True)
        values = [mpmath.mpf(b) + mpmath.fdot(row, values) for row, b in rows]
        if layer.activation == "tanh":
            values = [mpmath.tanh(v) * (1 + sign * mpmath.mpf(error)) for v in values]
    return values[0]


def outside(asked: Question, seed: int, error: float = 0.0) -> int:
    """How often the bounds do not hold, at points of boxes of several widths."""
    rng, count = np.random.default_rng(seed), 0
    bounds = NetworkBounds(asked)
    for width in (1.0, 0.1, 1e-3, 1e-9, 0.0):
        low = rng.uniform(-1, 1 - width, 2)
        ends = [(down(Fraction(float(v))), up(Fraction(float(v)) + Fraction(width))) for v in low]
        found = bounds.outputs(ends, [(0, -1)])
        assert found is not None
        for _ in range(6):
            t = [Fraction(float(v)) for v in rng.choice([-1, 1, rng.uniform(-1, 1)], 2)]
            middles = [(a + b) // 2 for a, b in ends]
            halves = [max(b - m, m - a) for m, (a, b) in zip(middles, ends, strict=True)]
            point = [Fraction(m + s * h) / ONE for m, s, h in zip(middles, t, halves, strict=True)]
            least, most = (
                (f.middle + sum(s * v for s, v in zip(t, f.slopes, strict=True))) / Fraction(ONE)
                for f in found[0]
            )
            with mpmath.workprec(300):
                for sign in (-1, 1):
                    value = exact(asked.layers, point, error, sign) * ONE
                    held = int(mpmath.ceil(value)) >= least * ONE and int(mpmath.floor(value)) <= most * ONE
                    count += not held
    return count


@pytest.mark.parametrize("seed", range(8))
def test_bounds_hold(seed: int) -> None:
    assert outside(plain(seed, "real"), seed) == 0
    assert outside(plain(seed), seed, 2.0**-50) == 0
    assert outside(plain(seed, "float32"), seed, 2.0**-21) == 0


def test_bounds_of_a_narrower_tanh_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """An enclosure of the right width that is some units too high. Here it must add up to what the other
    roundings of the checker allow; `test_hyperbolic` finds one unit.
    """
    tanh = hyperbolic.tanh_at
    monkeypatch.setattr(hyperbolic, "tanh_at", lambda z: tuple(v + 400 for v in tanh(z)))
    assert sum(outside(plain(seed, "real"), seed) for seed in range(8)) > 10


def test_an_error_of_tanh_that_is_left_out_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """One layer of tanh near 1, whose error is as large as what is stated."""
    saturated = (Layer(np.array([[0.5, 0.25]]), np.array([20.0]), "tanh"),)
    asked = question(saturated, BOX, below(0.0))
    assert outside(asked, 0, 2.0**-50) == 0
    double = fixed_point.ROUNDINGS["double"]
    planted = Rounding(double.bits, double.library - (1 << 30), double.largest)
    monkeypatch.setitem(fixed_point.ROUNDINGS, "double", planted)
    assert outside(asked, 0, 2.0**-50) > 0


@pytest.mark.parametrize("arithmetic", ["double", "float32"])
def test_what_the_program_computes_is_within(arithmetic: Arithmetic) -> None:
    """In numpy's doubles and floats, in the order of the exported C."""
    number = np.float64 if arithmetic == "double" else np.float32
    for seed in range(5):
        asked, rng = plain(seed, arithmetic), np.random.default_rng(seed)
        bounds = NetworkBounds(asked)
        for point in rng.uniform(-1, 1, (20, 2)):
            values = [number(v) for v in point]
            for layer in asked.layers:
                sums: list[Any] = []
                for row, bias in zip(layer.weight.tolist(), layer.bias.tolist(), strict=True):
                    total = number(bias)
                    for weight, value in zip(row, values, strict=True):
                        total = total + number(weight) * value
                    sums.append(np.tanh(total) if layer.activation == "tanh" else total)
                values = sums
            ends = [(down(Fraction(float(v))), up(Fraction(float(v)))) for v in point]
            found = bounds.outputs(ends, [(0, -1)])
            assert found is not None
            below_it, above_it = found[0]
            low = below_it.middle - sum(map(abs, below_it.slopes))
            high = above_it.middle + sum(map(abs, above_it.slopes))
            assert low <= Fraction(float(values[0])) * ONE <= high
            assert high - low < ONE * (1e-10 if arithmetic == "double" else 1e-2)


def missed(asked: Question, unit: float, seed: int) -> int:
    """How often an output is outside when every operation has the largest error, up or down."""
    rng, bounds, count = np.random.default_rng(seed), NetworkBounds(asked), 0
    for point in rng.uniform(-1, 1, (10, 2)):
        found = bounds.outputs([(down(Fraction(float(v))), up(Fraction(float(v)))) for v in point], [(0, -1)])
        assert found is not None
        ends = [f.middle + s * sum(map(abs, f.slopes)) for f, s in zip(found[0], (-1, 1), strict=True)]
        for _ in range(8):
            value = Fraction(disturbed(asked.layers, point, unit, rng)) * ONE
            count += not ends[0] <= value <= ends[1]
    return count


@pytest.mark.parametrize(("arithmetic", "unit"), [("double", 2.0**-53), ("float32", 2.0**-24)])
@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_every_rounding_is_within(
    monkeypatch: pytest.MonkeyPatch, arithmetic: Arithmetic, unit: float, activation: Activation
) -> None:
    asked = [
        question(layers(np.random.default_rng(s), [2, 6, 6, 1], activation, 2.0), BOX, below(0.0))
        for s in range(2)
    ]
    asked = [replace(a, arithmetic=arithmetic) for a in asked]
    assert sum(missed(a, unit, 0) for a in asked) == 0
    monkeypatch.setattr(Rounding, "error", lambda *_: 0)
    none = Rounding(1, 0, fixed_point.ROUNDINGS[arithmetic].largest)
    monkeypatch.setitem(fixed_point.ROUNDINGS, arithmetic, none)
    assert sum(missed(a, unit, 0) for a in asked) > 20


def test_numbers_that_may_overflow_have_no_bounds() -> None:
    for weights in ([1e200, 1e200], [1e308]):
        network = tuple(
            Layer(np.array([[w, 0.0][: 1 + (k == 0)]]), np.zeros(1), "identity")
            for k, w in enumerate(weights)
        )
        bounds = NetworkBounds(question(network, BOX, below(0.0)))
        assert bounds.outputs([(ONE, 2 * ONE)] * 2, [(0, -1)]) is None


HIGH = (float(np.float32(0.6)),)

# Commands -----------------------------------------------------------------------------------------


def curved_tank() -> Network:
    """u = 0.3 - 0.25 tanh((l - 2.5) / 2)."""
    inner = Layer(np.array([[0.5]]), np.array([-1.25]), "tanh")
    return Network((), (inner, Layer(np.array([[-0.25]]), np.array([0.3125]), "identity")))


def test_commands(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    file, path = onnx_file(curved_tank(), tmp_path / "net.onnx"), str(tmp_path / "proof.json")
    given = [
        "verify",
        str(tmp_path / "tank.kyx"),
        "--policy",
        str(file),
        "--takes",
        "l",
        "--gives",
        "u=0:0.6",
    ]
    assert run(capsys, *given, "--certificate", path)[0] == 0
    code, out, _ = run(capsys, *given, "--check", path)
    assert code == 0 and "leaves checked" in out


def test_a_policy_with_squashed_outputs(tmp_path: Path) -> None:
    """As Stable-Baselines3 saves those of SAC: its last layer is squashed, then stretched."""
    (tmp_path / "tank.kyx").write_text(TANK)
    inner = Layer(np.array([[0.5]]), np.array([-1.25]), "tanh")
    network = Network((), (inner, Layer(np.array([[-0.75]]), np.array([0.0]), "identity")), True)
    interface = Interface((("l", 0.0, 5.0),), "float32", "box", (), (), ("assign_u",), (0.0,), HIGH)
    file = write_policy(NetworkPolicy("tank", interface, network, False, {}), tmp_path)
    path = tmp_path / "proof.json"
    asked = Asked(file, seconds=20, certificate=path)
    assert report_on(str(tmp_path / "tank.kyx"), asked, {}).answer == "proved"
    assert checked_certificate(str(tmp_path / "tank.kyx"), asked, {}, path).leaves > 1
