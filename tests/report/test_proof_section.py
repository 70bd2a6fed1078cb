"""The section about the proof of a policy on the page of a training."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_proof.test_verify_policy import SWITCH
from report.test_report import Reader

import dl2c
from dl2c.commands.policy import Asked, report_on
from dl2c.env.interface import interface_of
from dl2c.policy.files import write_policy
from dl2c.policy.network import Layer, Network, NetworkPolicy
from dl2c.policy_proof import plane as planes
from dl2c.report.page import measure, report
from dl2c.report.proof import proof_section
from dl2c.report.trained import Trained, read_trained
from dl2c.training.run import CERTIFICATE, PROOF, Settings

pytest.importorskip("matplotlib")

GOOD, BAD = ([-1.0, 1.0], [0.0, 0.0]), ([0.0, 0.0], [0.0, 0.0])
"""Weights and biases of both alternatives: one always goes towards 0, the other always up."""


def run_folder(folder: Path, weights: Any, name: str = "switch") -> Path:
    """What `dl2c train --provable` leaves."""
    folder.mkdir()
    (folder / "model.kyx").write_text(SWITCH)
    manifest = dl2c.make(SWITCH).manifest
    slopes, biases = map(np.array, weights)
    layers = (
        Layer(np.eye(1), np.array([3.0]), "relu"),
        Layer(slopes[:, None], biases - 3 * slopes, "identity"),
    )
    network = Network((), layers)
    write_policy(NetworkPolicy(name, interface_of(manifest), network, False, manifest.options), folder)
    content = {
        "model": name,
        "algo": "ppo",
        "seed": 0,
        "options": manifest.options,
        "curve": [],
        "seconds": 1,
    }
    (folder / "run.json").write_text(json.dumps(content | {"settings": asdict(Settings())}))
    found = report_on(str(folder / "model.kyx"), Asked(folder, seconds=20), {})
    (folder / PROOF).write_text(json.dumps(found.to_json() | {"rounds": 2}))
    if found.answer == "proved":
        (folder / CERTIFICATE).write_text(found.certificate)
    return folder


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = run_folder(tmp_path_factory.mktemp("runs") / "proved", GOOD)
    assert (folder / CERTIFICATE).exists()
    return folder


@pytest.fixture(scope="module")
def refuted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_folder(tmp_path_factory.mktemp("runs") / "refuted", BAD)


def section_of(folder: Path) -> Reader:
    (found,) = proof_section(read_trained(folder))
    return Reader(found.html)


def test_claims_about_other_steps_are_not_shown_as_proved(proved: Path, tmp_path: Path) -> None:
    """A certificate is about requests, and says nothing of what a step does with them."""
    data = json.loads((proved / PROOF).read_text())
    assert data["claims"] == {"admissible": "proved", "kept": "proved", "for ever": "proved"}
    answers = section_of(proved).words.count("proved")
    folder = shutil.copytree(proved, tmp_path / "run")
    (folder / "model.kyx").write_text(SWITCH.replace("x := x + 1", "x := x + 2"))
    seen = section_of(folder).words
    assert seen.count("not checked") == 2 and seen.count("proved") == answers - 2


def test_a_proof_is_shown_with_its_picture(proved: Path, monkeypatch: Any) -> None:
    """Nothing is searched again."""
    monkeypatch.setattr("dl2c.policy_proof.search._Search._judged", lambda *_: pytest.fail("it searches"))
    seen = section_of(proved)
    data = json.loads((proved / PROOF).read_text())
    assert len(seen.addresses) == 1
    for part in (
        "Proof of the policy",
        "every request is admissible",
        "proved",
        f"{data['boxes']:,} boxes",
        "numbers of the policy: double",
        "taught in 2 rounds",
        *data["covers"],
        *(f"warning: {w}" for w in data["warnings"]),
    ):
        assert part in seen.words, seen.words
    assert "Nothing is shown" not in seen.words


def test_the_picture_is_that_of_the_search(proved: Path, monkeypatch: Any) -> None:
    drawn: list[Any] = []
    made = planes.plane_of
    monkeypatch.setattr("dl2c.picture.boxes.plane_of", lambda *a: drawn.append(made(*a)) or drawn[-1])
    section_of(proved)
    picture = proved.parent / "picture.png"
    report_on(str(proved / "model.kyx"), Asked(proved, seconds=20, picture=picture), {})
    one, two = drawn
    assert (one.leaves == two.leaves).all() and (one.decided == two.decided).all() and len(one.leaves) > 1


def test_the_last_report_is_shown_where_nothing_is_proved(refuted: Path) -> None:
    seen = section_of(refuted)
    data = json.loads((refuted / PROOF).read_text())
    assert data["answer"] == "refuted" and not seen.addresses
    for part in ("refuted", "not checked", "asks for what is not admissible", "choice_0=0", *data["covers"]):
        assert part in seen.words, seen.words
    assert f"{float(Fraction(data['counterexample']['state']['x'])):g}" in seen.words


def changed(folder: Path, target: Path) -> Path:
    shutil.copytree(folder, target)
    return target


def edit(file: Path, change: Callable[[Any], None]) -> None:
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))


def other_policy(folder: Path, refuted: Path) -> None:
    for file in refuted.glob("policy.*"):
        shutil.copy(file, folder)


def other_model(folder: Path, _: Path) -> None:
    (folder / "model.kyx").write_text(SWITCH.replace("?x <= 1;", "?x <= 0.5;"))


def broken_model(folder: Path, _: Path) -> None:
    (folder / "model.kyx").write_text(SWITCH.replace("Problem\n", "Problem\n  pi() > 3 & "))


def other_certificate(folder: Path, _: Path) -> None:
    edit(folder / CERTIFICATE, lambda data: data["proofs"][0].update(question="0"))


def no_certificate(folder: Path, _: Path) -> None:
    (folder / CERTIFICATE).unlink()


def no_report(folder: Path, _: Path) -> None:
    (folder / PROOF).write_text("{}")


def other_seconds(folder: Path, _: Path) -> None:
    edit(folder / PROOF, lambda data: data["progress"][0].pop())


SAID = {
    other_policy: "proof.json is about another model, policy or claim.",
    other_model: "proof.json is about another model, policy or claim.",
    broken_model: "undeclared function: `pi` is not declared in Definitions.",
    other_certificate: "certificate.json is about another model, policy or claim.",
    no_certificate: "No such file or directory: certificate.json.",
    no_report: "proof.json is not of `dl2c train --provable`: it lacks",
    other_seconds: "proof.json and certificate.json do not fit each other.",
}


@pytest.mark.parametrize("change", SAID, ids=lambda c: c.__name__)
def test_what_is_about_something_else_is_said_in_a_line(
    change: Callable[[Path, Path], None], proved: Path, refuted: Path, tmp_path: Path
) -> None:
    folder = changed(proved, tmp_path / "changed")
    change(folder, refuted)
    seen = section_of(folder)
    assert f"Nothing is shown: {SAID[change]}" in seen.words, seen.words
    assert not seen.addresses and "every request is admissible" not in seen.words
    assert str(tmp_path) not in seen.words


def test_the_page_has_the_section_if_there_is_a_proof(proved: Path, tmp_path: Path) -> None:
    trained: Trained = read_trained(proved)
    assert "Proof of the policy" in report(trained, measure(trained, 4))
    folder = changed(proved, tmp_path / "plain")
    (folder / PROOF).unlink()
    assert not [*proof_section(read_trained(folder))]


def test_a_proof_cannot_break_the_page(refuted: Path, tmp_path: Path) -> None:
    folder = changed(refuted, tmp_path / "hostile")
    data = json.loads((folder / PROOF).read_text())
    attack = "<script>alert(1)</script>"
    data |= {"covers": [attack], "warnings": [attack], "claims": {attack: attack}, "reasons": [attack]}
    (folder / PROOF).write_text(json.dumps(data))
    seen = section_of(folder)
    assert "script" not in seen.elements and seen.words.count(attack) == 5
