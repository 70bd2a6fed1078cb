"""What the command line says besides results, how loudly and in which colours; what a shell may propose."""

import json
import logging
import math
import platform
import re
from pathlib import Path
from typing import Any

import pytest
from commands.test_cli import run

import dl2c
from dl2c.commands.completion import models
from dl2c.commands.failures import to_json

pytestmark = pytest.mark.usefixtures("unoptimised")

MODEL = """Theorem "still water"
Definitions
  /* @safety: penalty=-1 */
  Bool calm(Real x) <-> x <= 10;
End.
ProgramVariables
  /* @var: bound=[0:1] */
  Real x;
End.
Problem
  x >= 0 -> [{ {x' = 1} }*]calm(x)
End.
End.
"""
"""Its flow has no horizon of its own."""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty cache, no wish about colours, a terminal wide enough for every help text."""
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "still.kyx"
    path.write_text(MODEL)
    return str(path)


@pytest.fixture
def wrong(tmp_path: Path) -> str:
    path = tmp_path / "wrong.kyx"
    path.write_text(MODEL.replace("x <= 10", "y <= 10"))
    return str(path)


@pytest.fixture
def warned(tmp_path: Path) -> str:
    """A model that KeYmaera X would reject for its `&&`."""
    path = tmp_path / "warned.kyx"
    path.write_text(MODEL.replace("x >= 0", "x >= 0 && x <= 1"))
    return str(path)


def test_verbose_shows_stages_with_seconds_and_compiler_commands(capsys: Any, model: str) -> None:
    code, out, err = run(capsys, "build", "-v", model, "-o", str(Path(model).parent / "out"))
    assert code == 0 and out.endswith("still_water\n")
    stages = re.findall(r"^ +\d+\.\d{3} s  (.+)$", err, flags=re.M)
    assert stages[0] == "reading the model" and stages[-1] == "compiling C"
    assert "deciding the precondition" in stages
    assert err.count("-ffp-contract=off") >= 1 and "files: " in err
    _, again, err = run(capsys, "-v", "build", model, "-o", str(Path(model).parent / "out"))
    assert again == out and "compiling C" not in err


def test_without_a_flag_nothing_is_said_of_stages(capsys: Any, model: str) -> None:
    assert run(capsys, "check", "-v", model)[2] != ""
    code, out, err = run(capsys, "check", "--dt", "1", model)
    assert (code, err) == (0, "") and out.startswith(f"{model}: no errors, 0 warnings\n")


def test_python_programs_see_the_same_through_logging(caplog: Any, model: str) -> None:
    logging.getLogger("dl2c").setLevel(logging.NOTSET)
    with caplog.at_level(logging.INFO, logger="dl2c"):
        dl2c.build(model)
    assert any("enumerating paths" in record.getMessage() for record in caplog.records)
    assert not any("-ffp-contract" in record.getMessage() for record in caplog.records)


@pytest.mark.parametrize("arguments", [("-q", "check"), ("check", "-q"), ("check", "--quiet")])
def test_quiet_shows_only_errors(capsys: Any, warned: str, wrong: str, arguments: tuple[str, ...]) -> None:
    assert run(capsys, *arguments, warned) == (0, "", "")
    code, out, err = run(capsys, *arguments, wrong)
    assert (code, out) == (1, "") and err.startswith("error: ")


def test_warnings_are_shown_unless_quiet(capsys: Any, warned: str) -> None:
    assert run(capsys, "check", warned)[2].startswith("warning: ")


@pytest.mark.parametrize("way", ["NO_COLOR", "--no-color"])
def test_colours_on_a_terminal_can_be_refused(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, wrong: str, way: str
) -> None:
    coloured = re.compile(r"\x1b\[[0-9;]*3[0-7]m")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    assert coloured.search(run(capsys, "check", wrong)[2])
    if way == "NO_COLOR":
        monkeypatch.setenv("NO_COLOR", "1")
        assert not coloured.search(run(capsys, "check", wrong)[2])
    else:
        monkeypatch.setenv("NO_COLOR", "")
        assert not coloured.search(run(capsys, "check", "--no-color", wrong)[2])


def test_no_escape_sequences_where_there_is_no_terminal(capsys: Any, model: str, wrong: str) -> None:
    for arguments in (("check", wrong), ("info", model), ("rollout", model, "--max-episode-steps", "3")):
        _, out, err = run(capsys, *arguments)
        assert "\x1b" not in out + err


@pytest.mark.parametrize(
    "arguments",
    [
        ("check",),
        ("info",),
        ("emit", "--stage", "tree"),
        ("emit",),
        ("rollout", "--max-episode-steps", "3"),
        ("build", "-o", "{folder}"),
        ("bench", "--seconds", "0.2"),
        ("train", "--steps", "64", "--n-envs", "2", "-o", "{folder}"),
    ],
)
def test_json_is_json_and_nothing_else(capsys: Any, tmp_path: Path, model: str, arguments: Any) -> None:
    if arguments[0] == "train":
        pytest.importorskip("stable_baselines3")
    given = [argument.format(folder=tmp_path / "out") for argument in arguments]
    code, out, _ = run(capsys, *given, "--json", model)
    assert code == 0
    json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize("value", [math.nan, math.inf, [-math.inf], {"a": (1.0, math.nan)}])
def test_numbers_that_json_has_not_are_null(value: Any) -> None:
    text = to_json(value)
    assert "null" in text and json.dumps(json.loads(text), allow_nan=False)


def test_the_cache_is_listed_pruned_and_cleared(capsys: Any, model: str, tmp_path: Path) -> None:
    def cache(*arguments: str) -> Any:
        code, out, err = run(capsys, "cache", *arguments)
        assert (code, err) == (0, "")
        return json.loads(out) if "--json" in arguments else out

    assert cache("dir") == f"{tmp_path / 'cache' / 'builds'}\n"
    assert cache("dir", "--json") == {"directory": str(tmp_path / "cache" / "builds")}
    assert cache("list") == "kept: 0, 0.00 MB\n"
    run(capsys, "build", model, "-o", str(tmp_path))
    run(capsys, "build", model, "-o", str(tmp_path), "--stall-limit", "3")
    listed = cache("list", "--json")
    assert sorted(row["name"] for row in listed) == ["still water", "still water", "still_water.o"]
    assert all(row["bytes"] > 0 and row["used"] for row in listed)
    assert [line.split()[0] for line in cache("list").splitlines()[:-1]] == [row["key"] for row in listed]
    assert cache("prune", "--json") == []
    assert "removed: 3" in cache("prune", "--cap", "0")
    run(capsys, "build", model, "-o", str(tmp_path))
    assert sorted(row["name"] for row in cache("clear", "--json")) == ["still water", "still_water.o"]
    assert cache("list", "--json") == []


def proposals(capsys: Any, monkeypatch: pytest.MonkeyPatch, line: str) -> list[str]:
    """What bash is told to propose at the end of a line."""
    monkeypatch.setenv("_DL2C_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
    code, out, _ = run(capsys)
    assert code == 0
    return out.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("dl2c ch", ["check"]),
        ("dl2c cache pr", ["prune"]),
        ("dl2c check --on-bl", ["--on-blocked"]),
        ("dl2c check --on-blocked t", ["truncate", "terminate"]),
        ("dl2c check --obs-dtype ", ["float32", "float64"]),
        ("dl2c emit --stage pa", ["paths"]),
        ("dl2c rollout --policy r", ["random"]),
        ("dl2c train --algo ma", ["maskable-ppo"]),
        ("dl2c check ex", ["example:acc"]),
    ],
)
def test_a_shell_is_told_what_may_follow(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, line: str, expected: list[str]
) -> None:
    found = proposals(capsys, monkeypatch, line)
    assert found[: len(expected)] == expected


def test_models_are_proposed_folder_by_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub" / "deep").mkdir(parents=True)
    for name in ("one.kyx", "other.txt", "sub/two.kyx"):
        (tmp_path / name).write_text("")
    assert models("o") == ["one.kyx"]
    assert models("s") == ["sub/"]
    assert models("sub/") == ["sub/deep/", "sub/two.kyx"]
    assert models("missing/") == []
    assert "example:waypoint" in models("example:") and "one.kyx" in models("")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_for_each_shell(capsys: Any, monkeypatch: pytest.MonkeyPatch, shell: str) -> None:
    monkeypatch.setenv("_DL2C_COMPLETE", f"source_{shell}")
    code, out, _ = run(capsys)
    assert code == 0 and "_DL2C_COMPLETE" in out and "dl2c" in out


def test_windows_is_refused_where_a_build_starts(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Windows")
    code, out, err = run(capsys, "build", model)
    assert (code, out) == (1, "")
    assert "Windows" in err and "WSL" in err and "Traceback" not in err
    assert run(capsys, "check", model)[0] == 0


@pytest.mark.parametrize(
    "command, option, words",
    [
        ("emit", "--stage", "tree|expanded|ir|paths|c|gym"),
        ("monitor", "--real", "double|float"),
        ("train", "--algo", "ppo|maskable-ppo|sac"),
        ("falsify", "--target", "safety|failure|postcondition"),
        ("build", "--on-blocked", "fallback|truncate|terminate"),
    ],
)
def test_help_shows_the_words_that_an_option_takes(
    command: str, option: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert re.search(rf"{option} +{re.escape(words)}\s", out), out
