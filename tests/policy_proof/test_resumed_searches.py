"""Searches that go on later: the same tree and certificate as of one search; other questions are refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run
from policy_proof.questions import onnx_file
from policy_proof.test_verify_policy import TANK, tank, tank_network

from dl2c.native.boxes import Judge
from dl2c.policy_proof.certificate import CertificateError
from dl2c.policy_proof.search import Before, Found, Limits, search
from dl2c.policy_proof.verdict import PolicyReport

BENT = tank_network(((0.05, 1.0, 0.25), (0.04, 3.0, 0.5)))
"""A policy whose proof has several levels."""


def outcome(found: Found) -> Found:
    """What does not depend on the time."""
    return replace(found, seconds=0.0)


def before(found: Found, levels: int) -> Before:
    """The first levels of a search."""
    return Before(found.tree[:levels], tuple(p.seconds for p in found.progress[:levels]))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: Any) -> Path:
    """Where one search is kept."""
    return tmp_path_factory.mktemp("whole") / "search.json"


@pytest.fixture(scope="module")
def whole(kept: Path) -> PolicyReport:
    """One search."""
    report = tank(kept.parent, BENT, resume=kept)
    assert report.answer == "proved" and len(report.found[0].tree) > 3
    return report


@pytest.fixture(scope="module")
def search_of_whole(kept: Path, whole: PolicyReport) -> str:
    """The file of the search."""
    return kept.read_text()


def test_any_level_is_a_place_to_go_on(whole: PolicyReport) -> None:
    (question,), (found,) = whole.questions, whole.found
    for levels in range(len(found.tree) + 1):
        again = search(question, Limits(20), before(found, levels))
        assert outcome(again) == outcome(found)


def test_without_time_a_search_is_as_far_as_before(whole: PolicyReport) -> None:
    (question,), (found,) = whole.questions, whole.found
    again = search(question, Limits(0.0), before(found, 2))
    assert (again.answer, again.tree, again.reason) == ("unknown", found.tree[:2], "after 0 seconds")
    assert again.boxes == sum(map(len, found.tree[:2]))


def interrupting(monkeypatch: Any, after: int) -> None:
    """Ctrl-C while the library judges boxes, when it has done so a number of times."""
    judged, calls = Judge.verdicts, iter(range(after))

    def verdicts(self: Judge, *args: Any) -> Any:
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return judged(self, *args)

    monkeypatch.setattr(Judge, "verdicts", verdicts)


def test_ctrl_c_keeps_what_is_judged(whole: PolicyReport, tmp_path: Path, monkeypatch: Any) -> None:
    file = tmp_path / "new" / "search.json"
    with monkeypatch.context() as patched:
        interrupting(patched, 2)
        report = tank(tmp_path, BENT, resume=file)
    assert report.interrupted and report.answer == "unknown"
    assert report.found[0].tree == whole.found[0].tree[:2]
    resumed = tank(tmp_path, BENT, resume=file, certificate=tmp_path / "proof.json")
    assert [outcome(f) for f in resumed.found] == [outcome(f) for f in whole.found]
    assert (tmp_path / "proof.json").read_text() == whole.certificate
    at_once = tank(tmp_path, BENT, resume=file)
    assert at_once.certificate == whole.certificate


def told(capsys: Any, folder: Path, *words: str) -> tuple[int, str, str]:
    (folder / "tank.kyx").write_text(TANK)
    file = onnx_file(BENT, folder / "net.onnx")
    given = ("--policy", str(file), "--takes", "l", "--gives", "u=0:0.6")
    return run(capsys, "verify", str(folder / "tank.kyx"), *given, *words)


def test_the_command_is_interrupted_and_goes_on(
    whole: PolicyReport, tmp_path: Path, capsys: Any, monkeypatch: Any
) -> None:
    words = ("--resume", str(tmp_path / "search.json"), "--certificate", str(tmp_path / "proof.json"))
    with monkeypatch.context() as patched:
        interrupting(patched, 3)
        with pytest.raises(KeyboardInterrupt):
            told(capsys, tmp_path, *words)
    out = capsys.readouterr().out
    assert "admissible  unknown" in out and "interrupted" in out
    assert not (tmp_path / "proof.json").exists()
    code, out, _ = told(capsys, tmp_path, *words)
    assert code == 0 and (tmp_path / "proof.json").read_text() == whole.certificate


def test_another_question_is_refused(tmp_path: Path, capsys: Any) -> None:
    words = ("--resume", str(tmp_path / "search.json"))
    assert told(capsys, tmp_path, *words)[0] == 0
    code, _, err = told(capsys, tmp_path, *words, "--fix", "l=1")
    assert code == 1 and "search.json is about another model, policy or claim" in err


def edited(file: Path, change: Any) -> None:
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))


WRONG = {
    "a certificate": lambda data: data.update(format="dl2c-policy-proof"),
    "another tree": lambda data: data["proofs"][0].update(digest="0"),
    "other levels": lambda data: data["proofs"][0].update(levels=[2, *data["proofs"][0]["levels"][2:]]),
    "nothing": lambda data: data.pop("proofs"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_search_is_refused(tmp_path: Path, search_of_whole: str, name: str) -> None:
    file = tmp_path / "search.json"
    file.write_text(search_of_whole)
    edited(file, WRONG[name])
    with pytest.raises(CertificateError):
        tank(tmp_path, BENT, resume=file)
