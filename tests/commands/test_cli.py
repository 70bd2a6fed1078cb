"""The command line: what it prints where, and with which exit code."""

import csv
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from generators.toy_library import ToyLibrary, toy_manifest

import dl2c.cli
import dl2c.experiments.commands  # adds its commands
from dl2c.diagnostics import CompileError, error, warning
from dl2c.native.errors import CompilerMissing
from dl2c.options import OPTIONS, Options, UnknownOption, with_options
from dl2c.parse import archive
from dl2c.report.trained import read_trained
from dl2c.source import Source, Span

pytestmark = pytest.mark.usefixtures("unoptimised")

KYX = "a model\nof two lines\n"


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The path of a model; building it gives the toy library and one warning."""
    path = tmp_path / "toy.kyx"
    path.write_text(KYX)
    built = tmp_path / "cache"
    built.mkdir()
    (built / "manifest.json").write_text("{}")
    (built / "toy.c").write_text("")

    def build(source: Source, given: Any, progress: Any = None, inspect: bool = False) -> Any:
        with_options(Options(), given)
        found = (warning("a-lint", "careful", Span(source, 2, 7), "this"),)
        library = ToyLibrary(toy_manifest(**{k: v for k, v in given.items() if k != "constants"}))
        return SimpleNamespace(library=library, manifest=library.manifest, warnings=found, directory=built)

    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "notes"))
    monkeypatch.setattr("dl2c.env.opening.build", build)
    monkeypatch.setattr("dl2c.env.opening.kept", build)
    monkeypatch.setattr(
        "dl2c.env.opening.manifest_of", lambda model, given: build(Source.read(model), given).library.manifest
    )
    monkeypatch.setattr("dl2c.lint.check.examine", lambda source, given, portable: build(source, {}).warnings)
    return str(path)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `dl2c arguments`."""
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as end:
        patch.setattr(sys, "argv", ["dl2c", *arguments])
        dl2c.cli.main()
    out, err = capsys.readouterr()
    return int(end.value.code or 0), out, err


def failing(patch: pytest.MonkeyPatch, failure: Exception) -> None:
    def build(source: Source, given: Any, progress: Any = None, **_: bool) -> Any:
        raise failure

    for name in ("env.opening.build", "env.opening.kept", "env.opening.manifest_of", "lint.check.examine"):
        patch.setattr(f"dl2c.{name}", build)


def test_version(capsys: Any) -> None:
    assert run(capsys, "--version") == (0, "dl2c 0.1.0\n", "")


@pytest.mark.parametrize(
    "command", ["build", "check", "annotate", "info", "emit", "verify", "rollout", "train"]
)
def test_every_option_is_a_documented_flag(capsys: Any, monkeypatch: Any, command: str) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    for option in OPTIONS.values():
        assert option.help
        assert option.flag in out or option.name == "constants"
    assert "--set" in out


def test_check_prints_warnings_to_stderr(capsys: Any, model: str) -> None:
    code, out, err = run(capsys, "check", model)
    assert code == 0
    assert out.startswith(f"{model}: no errors, 1 warning\n")
    assert err.startswith("warning: careful") and "^^^^^ this" in err


def test_check_json_is_only_json(capsys: Any, model: str) -> None:
    code, out, err = run(capsys, "check", "--json", model)
    assert (code, err) == (0, "")
    assert json.loads(out) == [
        {"severity": "warning", "code": "a-lint", "title": "careful", "label": "this", "help": "",
         "notes": [], "file": model, "line": 1, "column": 3, "text": "model"},
    ]  # fmt: skip


@pytest.mark.parametrize("command", ["build", "check", "info", "rollout"])
def test_a_compile_error_is_shown_without_a_traceback(
    capsys: Any, monkeypatch: Any, model: str, command: str
) -> None:
    span = Span(Source(model, KYX), 2, 7)
    failing(monkeypatch, CompileError(error("unbound", "unbound variable", span, "new", "declare it")))
    code, out, err = run(capsys, command, model)
    assert (code, out) == (1, "")
    assert err.startswith("error: unbound variable")
    assert "help: declare it" in err
    assert "Traceback" not in err and "\x1b" not in err


def test_check_json_of_a_wrong_model(capsys: Any, monkeypatch: Any, model: str) -> None:
    failing(monkeypatch, CompileError(error("unbound", "unbound variable", Span(Source(model, KYX), 2, 7))))
    code, out, err = run(capsys, "check", "--json", model)
    assert (code, json.loads(out)[0]["code"], err) == (1, "unbound", "")


@pytest.mark.parametrize(
    ("failure", "exit_code", "text"),
    [
        (CompilerMissing("no C compiler"), 1, "error: no C compiler\n"),
        (UnknownOption("no option `x`"), 2, "error: no option `x`\n"),
    ],
)
def test_other_user_errors_are_one_line(
    capsys: Any, monkeypatch: Any, model: str, failure: Exception, exit_code: int, text: str
) -> None:
    failing(monkeypatch, failure)
    assert run(capsys, "build", model) == (exit_code, "", text)


def test_an_example_that_is_none_names_those_that_are(capsys: Any) -> None:
    code, out, err = run(capsys, "build", "example:waypint")
    assert (code, out) == (1, "")
    assert err.startswith(
        "error: no example `waypint`; did you mean `waypoint`? There are acc, bouncing_ball, "
    )
    assert str(Path.cwd()) not in err


@pytest.mark.parametrize("verbose", [True, False])
def test_a_bug_says_so(capsys: Any, monkeypatch: Any, model: str, verbose: bool) -> None:
    failing(monkeypatch, ZeroDivisionError("oh"))
    code, out, err = run(capsys, "info", model, *["-v"] * verbose)
    assert (code, out) == (70, "")
    assert "internal error: ZeroDivisionError: oh" in err and "bug in dl2c" in err
    assert ("Traceback" in err) == verbose


def test_a_missing_file_and_a_binary_one(capsys: Any, tmp_path: Path) -> None:
    code, _, err = run(capsys, "check", str(tmp_path / "missing.kyx"))
    assert (code, err) == (1, f"error: No such file or directory: {tmp_path / 'missing.kyx'}\n")
    (tmp_path / "binary.kyx").write_bytes(b"\xff\xfe\x00")
    code, _, err = run(capsys, "check", str(tmp_path / "binary.kyx"))
    assert code == 1 and "not UTF-8" in err


def test_options_reach_the_build(capsys: Any, model: str) -> None:
    flags = ["--on-blocked", "terminate", "--max-episode-steps", "7", "--obs-dtype", "float64"]
    code, out, _ = run(capsys, "info", "--json", model, *flags, "--set", "k=0.1")
    assert code == 0
    options = json.loads(out)["options"]
    assert (options["on_blocked"], options["max_episode_steps"], options["obs_dtype"]) == (
        "terminate", 7, "float64",
    )  # fmt: skip
    code, _, err = run(capsys, "info", model, "--on-blocked", "explode")
    assert code == 2 and "`on_blocked` takes 'fallback', 'truncate', 'terminate'" in err
    code, _, err = run(capsys, "info", model, "--set", "k")
    assert code == 2 and "NAME=VALUE" in err


def test_info_for_people(capsys: Any, model: str) -> None:
    code, out, _ = run(capsys, "info", model)
    assert code == 0
    for part in ("toy", "Discrete(3)", "choice_0", "safety", "max_episode_steps"):
        assert part in out


def test_build_writes_a_folder(capsys: Any, model: str, tmp_path: Path) -> None:
    code, out, _ = run(capsys, "build", model, "-o", str(tmp_path / "out"), "--json")
    assert code == 0
    found = json.loads(out)
    assert found == {"directory": str(tmp_path / "out" / "toy"), "files": ["manifest.json", "toy.c"]}
    assert (tmp_path / "out" / "toy" / "toy.c").exists()


@pytest.mark.parametrize("policy", ["random", "first"])
def test_rollout_writes_every_step(capsys: Any, model: str, tmp_path: Path, policy: str) -> None:
    table = tmp_path / "steps.csv"
    arguments = ["rollout", model, "--policy", policy, "--episodes", "3", "--csv", str(table), "--json"]
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    summary = json.loads(out)
    assert sum(end["episodes"] for end in summary["ends"]) == 3
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["steps"] + 3
    assert list(rows[0]) == [
        "episode", "step", "time", "action", "reward", "terminated", "truncated", "status", "reason",
        "x", "k",
    ]  # fmt: skip
    assert run(capsys, *arguments)[1] == out


def test_rollout_refuses_what_is_no_policy(capsys: Any, model: str, tmp_path: Path) -> None:
    table = tmp_path / "steps.csv"
    table.write_text("kept")
    code, _, err = run(capsys, "rollout", model, "--policy", model, "--csv", str(table))
    assert code == 1 and "not a policy" in err
    assert table.read_text() == "kept"


def test_train_writes_its_results(capsys: Any, model: str, tmp_path: Path) -> None:
    pytest.importorskip("sb3_contrib")
    output = tmp_path / "run"
    code, out, _ = run(
        capsys, "train", model, "--algo", "maskable-ppo", "--steps", "128", "--n-envs", "1", "-o", str(output)
    )
    assert code == 0
    first, *table = out.splitlines()
    assert re.fullmatch(
        rf"{re.escape(str(output / 'policy.zip'))}: 128 steps in \d+ s, then 200 episodes", first
    )
    assert [line.split()[0] for line in table] == ["policy", "random", "trained"]
    assert table[0].split()[:5] == ["policy", "success", "violations", "blocked", "return"]
    assert {p.name for p in output.iterdir()} == {
        *("policy.zip", "policy.json", "policy.npz", "vecnormalize.pkl"),
        *("model.kyx", "run.json", "curve.png"),
    }
    text = Source.read(model).text
    assert read_trained(output).source == Source("toy.kyx", text)
    code, _, err = run(capsys, "train", model, "--algo", "sarsa")
    assert code == 1 and "no algorithm" in err


@pytest.mark.parametrize(
    "command",
    ["check", "check --portable", "check --json", "annotate", "info", "verify", "sample", "build", "monitor"],
)
def test_a_command_reads_a_model_once(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    path = tmp_path / "model.kyx"
    problem = "x = 0 -> [{?(x <= 3); x := x + 1; ++ x := 0;}*@invariant(x <= 4)] x <= 4"
    path.write_text(f'Theorem "of {command}" ProgramVariables Real x; End. Problem {problem} End. End.')
    read: list[Source] = []
    whole = archive.read_archive

    def reading(source: Source) -> Any:
        read.append(source)
        return whole(source)

    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "own"))
    monkeypatch.setattr(archive, "read_archive", reading)
    folder = ["-o", str(tmp_path / "monitor")] if command == "monitor" else []
    code, out, err = run(capsys, *command.split(), str(path), *folder)
    assert code == 0, out + err
    assert len(read) == 1


def test_check_portable_looks_at_all_entries(capsys: Any, tmp_path: Path) -> None:
    """Also where none is named: two things are wrong then."""
    path, entry = (
        tmp_path / "model.kyx",
        "ProgramVariables Real x; End. Problem [x := 1; // no\n] x = 1 End. End.\n",
    )
    path.write_text(f'Theorem "a" {entry}Theorem "b" {entry}')
    code, _, err = run(capsys, "check", "--portable", str(path))
    assert code == 1 and "several entries" in err and err.count("rejects `//` comments") == 2
