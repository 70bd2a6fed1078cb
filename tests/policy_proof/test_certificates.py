"""Certificates pass the checker as they are, and nothing that was changed does."""

import base64
import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_cli import run
from conftest import shared
from policy_proof.questions import layers, onnx_file, question
from policy_proof.test_network_bounds import exact
from policy_proof.test_public_networks import ANNOTATED, FALLBACK, RETRAINED
from policy_proof.test_verify_policy import TANK, tank_network

from dl2c.ir.model import TRUE, Compare, Number, Symbol
from dl2c.policy_proof.certificate import CertificateError, certificate, check
from dl2c.policy_proof.fixed_point import ONE, down, up
from dl2c.policy_proof.linear_bounds import NetworkBounds
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Limits, search
from dl2c.policy_proof.tree import BY_BOUNDS, NO_STATE

pytest.importorskip("onnx")

BOX = ((Fraction(-1), Fraction(1)),) * 2


def asked(seed: int, limit: float) -> Question:
    """That a random network is below a limit."""
    network = layers(np.random.default_rng(seed), [2, 6, 6, 1], "relu", 2.0)
    below = Compare("<", Symbol("y", "input"), Number(Fraction(limit)))
    return question(network, BOX, below)


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Question, Path]:
    """A question whose proof has several levels, and its certificate."""
    made = asked(1, 1.0)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), -1).reshape(-1, 2)
    values = grid
    for layer in made.layers:
        values = values @ layer.weight.T + layer.bias
        values = np.maximum(values, 0) if layer.activation == "relu" else values
    made = asked(1, float(values.max()) + 0.02)
    found = search(made, Limits(30, 2))
    assert found.answer == "proved" and len(found.tree) > 3
    path = tmp_path_factory.mktemp("certificate") / "proof.json"
    path.write_text(certificate([made], [found.tree]))
    return made, path


def test_it_passes(proved: tuple[Question, Path]) -> None:
    made, path = proved
    assert check(path, [made]).leaves > 4


def rewritten(path: Path, change: Callable[[bytearray, list[int]], None]) -> str:
    """The certificate with another tree, its digest made to fit."""
    import hashlib

    top = json.loads(path.read_text())
    entry = top["proofs"][0]
    content, levels = bytearray(zlib.decompress(base64.b64decode(entry["tree"]))), list(entry["levels"])
    change(content, levels)
    entry |= {
        "tree": base64.b64encode(zlib.compress(bytes(content))).decode(),
        "levels": levels,
        "digest": hashlib.sha256(content).hexdigest(),
    }
    return json.dumps(top)


def drop_leaf(content: bytearray, levels: list[int]) -> None:
    levels[-1] -= 1
    del content[-1]


def drop_level(content: bytearray, levels: list[int]) -> None:
    del content[-levels.pop() :]


def invent_level(content: bytearray, levels: list[int]) -> None:
    levels.append(1)
    content.append(BY_BOUNDS)


def call_it_empty(content: bytearray, levels: list[int]) -> None:
    content[content.index(BY_BOUNDS)] = NO_STATE


def leave_it_open(content: bytearray, levels: list[int]) -> None:
    content[-1] = 251


def split_otherwise(content: bytearray, levels: list[int]) -> None:
    content[0] = 7


CHANGES = (drop_leaf, drop_level, invent_level, call_it_empty, leave_it_open, split_otherwise)


@pytest.mark.parametrize("change", CHANGES, ids=lambda c: c.__name__)
def test_other_trees_are_refused(
    proved: tuple[Question, Path], tmp_path: Path, change: Callable[[bytearray, list[int]], None]
) -> None:
    made, path = proved
    (tmp_path / "changed.json").write_text(rewritten(path, change))
    with pytest.raises(CertificateError):
        check(tmp_path / "changed.json", [made])


@pytest.mark.parametrize("seed", range(100))
def test_bytes_that_changed_are_refused(proved: tuple[Question, Path], tmp_path: Path, seed: int) -> None:
    made, path = proved
    rng = np.random.default_rng(seed)
    content = bytearray(path.read_bytes())
    places = [k for k, byte in enumerate(content) if chr(byte).isalnum()]
    at = int(rng.choice(places))
    old = content[at]
    while content[at] == old:
        content[at] = int(rng.choice([*b"0123456789abcdefABCDEF"]))
    (tmp_path / "changed.json").write_bytes(bytes(content))
    with pytest.raises(CertificateError):
        check(tmp_path / "changed.json", [made])


def test_another_question_is_refused(proved: tuple[Question, Path]) -> None:
    made, path = proved
    first = made.layers[0]
    weight = first.weight.copy()
    weight[0, 0] = np.nextafter(weight[0, 0], 9)
    conclusion = replace(made.cases[1], conclusion=TRUE)
    others = [
        replace(made, layers=(replace(first, weight=weight), *made.layers[1:])),
        replace(made, box=((Fraction(-1), Fraction(1) + Fraction(1, 2**60)), BOX[1])),
        replace(made, cases=(made.cases[0], conclusion, made.cases[2])),
        replace(made, arithmetic="float32"),
    ]
    for other in others:
        with pytest.raises(CertificateError, match="another model"):
            check(path, [other])


def test_a_false_claim_has_no_proof(tmp_path: Path) -> None:
    """A tree that says that the whole box is proved, of a claim that is false at one of its points."""
    made = asked(1, -100.0)
    (tmp_path / "false.json").write_text(certificate([made], [[bytes([BY_BOUNDS])]]))
    with pytest.raises(CertificateError, match="not proved"):
        check(tmp_path / "false.json", [made])


@pytest.mark.parametrize("seed", range(5))
def test_bounds_of_the_checker_hold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made = replace(asked(seed, 0.0), arithmetic="real")
    bounds = NetworkBounds(made)
    for width in (1.0, 0.1, 1e-6, 0.0):
        low = rng.uniform(-1, 1 - width, 2)
        ends = [(down(Fraction(float(v))), up(Fraction(float(v)) + Fraction(width))) for v in low]
        ((below, above),) = bounds.outputs(ends, [(0, -1)])
        for _ in range(20):
            t = [Fraction(float(v)) for v in rng.choice([-1, 1, rng.uniform(-1, 1)], 2)]
            middles = [(a + b) // 2 for a, b in ends]
            halves = [max(b - m, m - a) for m, (a, b) in zip(middles, ends, strict=True)]
            point = [
                Fraction(m, ONE) + s * Fraction(h, ONE) for m, s, h in zip(middles, t, halves, strict=True)
            ]
            value = exact(made.layers, point)
            least, most = (
                Fraction(f.middle, ONE) + sum(s * Fraction(v, ONE) for s, v in zip(t, f.slopes, strict=True))
                for f in (below, above)
            )
            assert least <= value <= most


def test_commands(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "tank.kyx").write_text(TANK)
    file, proof = onnx_file(tank_network(), tmp_path / "net.onnx"), tmp_path / "proof.json"
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
    assert run(capsys, *given, "--certificate", str(proof))[0] == 0
    code, out, _ = run(capsys, *given, "--check", str(proof))
    assert code == 0 and "leaves checked" in out
    onnx_file(tank_network(((0.5, 4.9, 0.25),)), tmp_path / "net.onnx")
    code, _, err = run(capsys, *given, "--check", str(proof))
    assert code == 1 and "another model, policy or claim" in err
    proof.unlink()
    assert run(capsys, *given, "--certificate", str(proof))[0] == 1 and not proof.exists()


@pytest.mark.slow
def test_public_network(tmp_path: Path, capsys: Any) -> None:
    text = (shared("oracle/n3v") / "acc.kyx").read_text(encoding="utf-8")
    for old, new in ANNOTATED.items():
        text = text.replace(old, new)
    (tmp_path / "acc.kyx").write_text(text)
    given = ["verify", str(tmp_path / "acc.kyx"), "--policy", str(shared("oracle/n3v") / f"{RETRAINED}.onnx")]
    given += ["--takes", "rPos,rVel", "--gives", "rAcc=-100:100", "--except", FALLBACK]
    given += ["--fix", "A=100", "--fix", "B=100", "--fix", "T=0.1"]
    proof = str(tmp_path / "proof.json")
    assert run(capsys, *given, "--certificate", proof)[0] == 0
    assert run(capsys, *given, "--check", proof)[0] == 0
