"""`dl2c verify`: exit codes, what it prints and writes, and what other commands then say of the theorem."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run
from selection import quick_rows

import dl2c
from dl2c.configuration import resolve_options
from dl2c.env.opening import source_of
from dl2c.native.manifest import Manifest
from dl2c.pipeline import emit
from dl2c.report.page import _environment  # pyright: ignore[reportPrivateUsage]
from dl2c.resolve import unreadable
from dl2c.resolve.unreadable import read_entry
from dl2c.smt.terms import z3
from dl2c.verify import results, theorem
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.report import Report
from dl2c.verify.results import Status, status, store
from dl2c.verify.theorem import theorem_in

ROOT = Path(__file__).resolve().parents[2]

KYX = """Theorem "still water"
ProgramVariables
  /* @var: bound=[0:5] */
  Real x;
End.
Problem
  {problem}
End.
End.
"""

PROBLEMS = {
    "proved": "x >= 0 -> [{ x := x + 1; }*@invariant(x >= 0)] x >= 0",
    "refuted": "x >= 0 -> [{ x := x - 1; }*@invariant(x >= 0)] x >= 0",
    "bounded": "x <= 6 -> [{ ?x <= 5; x := x + 1; ++ ?x > 5; x := x + 1; }] x <= 6",
    "open": "x >= 0 -> <{ { x' = x^2 + 1 } }*> x >= 10",
    "wrong": "x >= 0 -> [{ y := x - 1; }*] z(x) >= 0",
}

CODES = {"proved": 0, "refuted": 1, "bounded": 1, "open": 3, "wrong": 1}


@pytest.fixture
def models(tmp_path: Path) -> dict[str, str]:
    """The path of a model for each of `PROBLEMS`."""
    for name, problem in PROBLEMS.items():
        (tmp_path / f"{name}.kyx").write_text(KYX.replace("{problem}", problem))
    return {name: str(tmp_path / f"{name}.kyx") for name in PROBLEMS}


def test_reading_a_model_has_the_budget_of_compiling(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A text that takes too long to read is refused with a place."""
    monkeypatch.setattr("dl2c.work.SECONDS", 0.05)
    path = tmp_path / "long.kyx"
    path.write_text(KYX.replace("{problem}", "x >= 0 -> [" + "x := x + 1; " * 3000 + "] x >= 0"))
    code, _, err = run(capsys, "verify", str(path))
    assert code == 1 and "takes too much work to compile" in err and re.search(r"long\.kyx:1:1\n", err)


def test_a_theorem_is_read_once(capsys: Any, models: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the answer is kept: reading may take longer than the proof."""
    read: list[Any] = []

    def reading(source: Any, entry: Any) -> Any:
        read.append(source)
        return read_entry(source, entry)

    monkeypatch.setattr(unreadable, "read_entry", reading)
    monkeypatch.setattr(theorem, "read_entry", reading)
    assert run(capsys, "verify", models["proved"])[0] == 0
    assert len(read) == 1 and status(source_of(models["proved"]), resolve_options({})).answer == "proved"


def test_runs_through_long_programs_end_in_time(tmp_path: Path) -> None:
    path, block = tmp_path / "long.kyx", "{" + "x := x*x + 1; " * 60 + "}"
    path.write_text(KYX.replace("{problem}", f"x >= 0 -> [{{{block * 60}}}*] x >= 0"))
    claim = theorem_in(source_of(path), resolve_options({}))
    begun = time.process_time()
    assert prove_theorem(claim, Limits(each=0.2, total=0.4)).answer == "unknown"
    assert time.process_time() - begun < 2.5


@pytest.mark.parametrize("name", PROBLEMS)
def test_exit_codes(capsys: Any, models: dict[str, str], name: str) -> None:
    code, out, err = run(capsys, "verify", models[name], "--total", "8")
    assert code == CODES[name], out + err
    assert "Traceback" not in err and "\x1b" not in out + err
    if name == "wrong":
        assert out == "" and err.startswith("error: ")
    else:
        assert err == "" and re.search(r"^theorem: ", out, re.MULTILINE)


def test_a_proof_says_what_it_rests_on(capsys: Any, models: dict[str, str]) -> None:
    _, out, _ = run(capsys, "verify", models["proved"])
    assert re.search(r"^step \(loop 1\) +proved .*proved\.kyx:7:\d+", out, re.MULTILINE)
    assert re.search(r"^theorem: proved\n +by dl2c verify", out, re.MULTILINE)
    assert run(capsys, "verify", models["proved"], "-q") == (0, "", "")


def test_a_refutation_is_a_run(capsys: Any, models: dict[str, str]) -> None:
    _, out, _ = run(capsys, "verify", models["refuted"])
    assert re.search(r"^a run from +x = ", out, re.MULTILINE) and "violates    x >= 0" in out


def test_the_exit_code_may_be_that_within_bounds(capsys: Any, models: dict[str, str]) -> None:
    code, out, _ = run(capsys, "verify", models["bounded"], "--within-bounds")
    assert code == 0 and "theorem: refuted\nwithin bounds: proved\n" in out


@pytest.mark.parametrize("name", ["proved", "refuted", "bounded", "open"])
def test_json_is_all_that_is_printed(capsys: Any, models: dict[str, str], name: str) -> None:
    code, out, err = run(capsys, "verify", "--json", models[name], "--total", "8")
    found = json.loads(out)
    assert (code, err) == (CODES[name], "")
    assert found["theorem"] == "still water" and found["obligations"]
    if name in ("proved", "refuted"):
        assert found["answer"] == name
        assert (found["counterexample"] is None) == (name == "proved")


def test_mistakes_with_json_are_on_stderr(capsys: Any, models: dict[str, str]) -> None:
    code, out, err = run(capsys, "verify", "--json", models["wrong"])
    assert (code, out) == (1, "") and err.startswith("error: ")


def test_every_question_is_a_file(capsys: Any, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "questions"
    code, _, _ = run(capsys, "verify", "example:watertank", "--smt2", str(folder))
    files = sorted(folder.iterdir())
    assert code == 0 and files
    for path in files:
        text = path.read_text(encoding="utf-8")
        solver = z3.Solver()
        solver.add(z3.parse_smt2_string(text))
        said = re.search(r"^\(set-info :status (\w+)\)$", text, re.MULTILINE)
        assert said and text.startswith("; ") and "(check-sat)" in text
        solver.set("timeout", 2000)
        assert str(solver.check()) in (said[1], "unknown")


@pytest.mark.parametrize("name", ["given", "given/below"])
def test_a_folder_that_cannot_be_written_is_one_line(
    capsys: Any, models: dict[str, str], tmp_path: Path, name: str
) -> None:
    (tmp_path / "given").write_text("")
    code, out, err = run(capsys, "verify", models["proved"], "--smt2", str(tmp_path / name))
    assert (code, out) == (1, "") and re.fullmatch(r"error: .*given.*\n", err)


def test_solvers_that_all_answer_agree(capsys: Any, models: dict[str, str]) -> None:
    assert run(capsys, "verify", "--agree", models["proved"])[0] == 0
    assert run(capsys, "verify", "--agree", models["refuted"])[0] == 1


@pytest.mark.parametrize("words", [("--total", "0"), ("--jobs", "-1"), ("--timeout", "x"), ("--sound",)])
def test_wrong_command_lines(capsys: Any, models: dict[str, str], words: tuple[str, ...]) -> None:
    assert run(capsys, "verify", models["proved"], *words)[0] == 2


def test_only_constants_can_be_set(capsys: Any, models: dict[str, str]) -> None:
    """A variable with a value of its own would be another theorem."""
    for name, label in (("x", "`x` is a program variable"), ("nosuch", "the model declares no `nosuch`")):
        code, out, err = run(capsys, "verify", models["refuted"], "--set", f"{name}=1")
        assert (code, out) == (1, "")
        assert f"there is no undefined constant `{name}` to set" in err and label in err


def test_time_is_limited(capsys: Any) -> None:
    began = time.monotonic()
    code, out, _ = run(capsys, "verify", "example:passive_safety", "--total", "1")
    assert code == 3 and "theorem: " in out
    assert time.monotonic() - began < 20


def test_without_solvers_nothing_is_refuted(
    capfd: Any, models: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processes that cannot start answer nothing: the exit code is not that of a refutation."""
    monkeypatch.setattr("dl2c.smt.portfolio.sys.executable", "/bin/false")
    code, _, err = run(capfd, "verify", "example:watertank", "--total", "3")
    assert (code, err) == (3, "")


TURNING = (
    'ArchiveEntry "Lorenz"\nProgramVariables Real x, y, z; End.\n'
    "Problem x = 1 & y = 1 & z = 1 -> [{x' = 10*(y - x), y' = x*(28 - z) - y, z' = x*y - 8/3*z}]"
    " x^4 + y^6 + z^2*x^2 <= 10^9\nEnd.\nEnd.\n"
)
"""True, and the search for a proof goes on for long."""


@pytest.mark.parametrize(
    ("delay", "group"), quick_rows(product((0.3, 2.0, 4.0), (False, True)), ((0.3, False), (4.0, True)))
)
def test_an_interruption_says_what_is_known(tmp_path: Path, delay: float, group: bool) -> None:
    """Whether it comes to the process alone, or also to those that it started, as from a terminal."""
    (tmp_path / "turning.kyx").write_text(TURNING, encoding="utf-8")
    words = ("verify", str(tmp_path / "turning.kyx"), "--total", "60")
    own = {"PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": str(tmp_path)}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "dl2c", *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env=os.environ | own, start_new_session=True,
        )  # fmt: skip
        time.sleep(delay)
        (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (process.returncode, err) == (130, b"interrupted\n")
    assert b"theorem: " in out or (not out and delay < 4)


@pytest.mark.usefixtures("unoptimised")
def test_commands_say_what_is_known(capsys: Any, models: dict[str, str], tmp_path: Path) -> None:
    """`info`, the manifest, the first comments of C, `check`: before a proof and after it."""
    model, hint, known = models["proved"], "`dl2c verify", "proved by dl2c verify"
    assert '"still water": not checked\n' in run(capsys, "info", model)[1]
    checked = run(capsys, "check", model)
    assert checked[1].count(hint) == 1 and checked[1].count("\n") == 2 and hint not in checked[2]
    assert hint not in "".join(run(capsys, "check", "-q", model)[1:])
    assert hint not in "".join(run(capsys, "check", "--json", model)[1:])
    run(capsys, "verify", model)
    assert hint not in run(capsys, "check", model)[1]
    shown = run(capsys, "info", model)[1]
    assert re.search(rf'^theorem +"still water": {known}.*\ninvariant +x >= 0$', shown, re.MULTILINE)
    said = json.loads(run(capsys, "info", model, "--json")[1])["theorem"]
    assert said["name"] == "still water" and said["invariant"] == "x >= 0"
    assert said["known"].startswith(known)
    run(capsys, "build", model, "-o", str(tmp_path / "out"))
    run(capsys, "monitor", model, "-o", str(tmp_path / "monitor"))
    (manifest,) = (tmp_path / "out").rglob("manifest.json")
    assert json.loads(manifest.read_text())["theorem"] == said
    assert Manifest.read(manifest).theorem.known == said["known"]
    sources = [*(tmp_path / "out").rglob("*.[ch]"), *(tmp_path / "monitor").glob("*.[ch]")]
    comment = f'/* Theorem "still water" with invariant x >= 0: {said["known"]}. */'
    assert sources and all(path.read_text().splitlines()[2] == comment for path in sources)


def test_a_refutation_is_said_too(capsys: Any, models: dict[str, str]) -> None:
    run(capsys, "verify", models["refuted"])
    assert '"still water": refuted by dl2c verify' in run(capsys, "info", models["refuted"])[1]
    run(capsys, "verify", models["bounded"])
    said = emit(source_of(models["bounded"]), "c", resolve_options({}))
    assert '/* Theorem "still water": refuted by dl2c verify; within bounds proved. */' in said


def test_a_report_says_what_is_known(models: dict[str, str]) -> None:
    source = source_of(models["proved"])
    store(theorem_in(source, resolve_options({})), _report("refuted"))
    page = "".join(str(part) for part in _environment(dl2c.build(source).library.manifest))
    assert "still water" in page and "refuted by dl2c verify" in page


def test_an_answer_belongs_to_the_theorem(models: dict[str, str], tmp_path: Path) -> None:
    """Comments and names of files do not matter; the claim, its bounds and given values do."""
    options, text = resolve_options({}), Path(models["proved"]).read_text()
    store(theorem_in(source_of(models["proved"]), options), _report("proved"))

    def known(changed: str) -> str:
        path = tmp_path / "other.kyx"
        path.write_text(changed)
        return status(source_of(path), options).answer

    assert known(text) == known(text.replace("Problem\n", "/* a remark */ Problem\n")) == "proved"
    for old, new in (("x >= 0 ->", "x > 0 ->"), ("[0:5]", "[0:6]"), ("@invariant(x >= 0)", "")):
        assert known(text.replace(old, new)) == "not checked"
    assert known(text.replace("Problem", "Prolbem")) == "not checked"


def test_less_time_forgets_no_proof(models: dict[str, str]) -> None:
    source, options = source_of(models["proved"]), resolve_options({})
    for given, expected in (
        ("unknown", "unknown to dl2c verify"),
        ("not checked", "not checked (dl2c verify leaves a part of it open)"),
        ("proved", "proved by dl2c verify"),
        ("unknown", "proved by dl2c verify"),
        ("refuted", "refuted by dl2c verify"),
    ):
        store(theorem_in(source, options), _report(given))
        assert str(status(source, options)) == expected


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"answer": "proved"', '{"answer": "proved"}', "\x00"])
def test_broken_answers_are_none(models: dict[str, str], content: str) -> None:
    source, options = source_of(models["proved"]), resolve_options({})
    store(theorem_in(source, options), _report("proved"))
    (path,) = results.folder().iterdir()
    path.write_text(content)
    assert status(source, options) == Status()


def test_answers_of_other_users_are_none(models: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    source, options = source_of(models["proved"]), resolve_options({})
    store(theorem_in(source, options), _report("proved"))
    assert results.folder().stat().st_mode & 0o077 == 0
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert status(source, options) == Status()


def test_a_broken_home_knows_nothing(models: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setenv("DL2C_CACHE_DIR", "~nosuchuser/x")
    source, options = source_of(models["proved"]), resolve_options({})
    store(theorem_in(source, options), _report("proved"))
    assert status(source, options) == Status()


def _report(answer: Any) -> Report:
    return Report("still water", answer, answer, (), (), False, 1.0, 1, ())
