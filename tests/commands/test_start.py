"""What a command does before its work: it imports and reads only what it needs, and looks at a text once."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from conftest import REPOSITORY

MODEL = REPOSITORY / "examples" / "watertank.kyx"
RUNS = 7

WARNED = """
ArchiveEntry "Warned"
Definitions
  /* @const: bound=[1:2] */ Real A;
  /* @safety: penalty=-1, on_failure=terminate:failure */ Bool safe(Real x) <-> x <= 100;
End.
ProgramVariables
  /* @var: bound=[0:10] */ Real x;
  /* @var: bound=[-2:2] */ Real v;
  /* @var: bound=[0:1] */ Real t;
End.
/* @episode: safety_check=auto */
Problem
  x >= 0 & x <= 1 -> [{ {v := A; ++ v := -A;} t := 0; {x' = v, t' = 1 & t < 1} }*] safe(x)
End.
End.
"""


@pytest.fixture
def place(tmp_path: Path) -> Mapping[str, str]:
    """An environment with a cache of its own, and a compiler that notes each call but for its version."""
    compiler = tmp_path / "cc"
    compiler.write_text(
        f'#!/bin/sh\ncase "$*" in *version*) ;; *) echo "$*" >> {tmp_path}/calls ;; esac\nexec cc "$@"\n'
    )
    compiler.chmod(0o755)
    flags = "-O0 -DDL2C_NO_TARGET_CLONES"
    cache = str(tmp_path / "cache")
    return {**os.environ, "DL2C_CACHE_DIR": cache, "CC": str(compiler), "CFLAGS": flags}


def dl2c(place: Mapping[str, str], *words: str, folder: Path | None = None) -> tuple[str, str]:
    """What a command prints to stdout and stderr."""
    command = [sys.executable, "-m", "dl2c", *words]
    environment = {**place, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        command, env=environment, cwd=folder or REPOSITORY, capture_output=True, text=True, check=True
    )
    return done.stdout, done.stderr


def imported(place: Mapping[str, str], *words: str) -> set[str]:
    """The modules that a command imports."""
    command = [sys.executable, "-X", "importtime", "-m", "dl2c", *words]
    environment = {**place, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        command, env=environment, cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    lines = (line for line in done.stderr.splitlines() if line.startswith("import time:"))
    return {line.rpartition("|")[2].strip() for line in lines}


def seconds(*words: str) -> float:
    """The processor time of a Python command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], cwd=REPOSITORY, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_the_version_takes_little_more_than_its_libraries() -> None:
    """Run in turns: what else the machine does changes within seconds."""
    version, libraries = ("-m", "dl2c", "--version"), ("-c", "import typer, rich.console")
    ratios = [seconds(*version) / seconds(*libraries) for _ in range(RUNS)]
    assert sorted(ratios)[RUNS // 2] <= 3, ratios


@pytest.mark.parametrize("chosen", [None, "20"])
def test_threads_of_openblas_soon_sleep(place: Mapping[str, str], chosen: str | None) -> None:
    """Unless the environment says otherwise."""
    lines = (
        "import os, sys",
        "from dl2c.__main__ import SOON, main",
        "sys.argv = ['dl2c', '--version']",
        "try: main()",
        "except SystemExit: pass",
        f"assert os.environ['OPENBLAS_THREAD_TIMEOUT'] == ({chosen!r} or SOON)",
    )
    environment = {name: value for name, value in place.items() if name != "OPENBLAS_THREAD_TIMEOUT"}
    if chosen is not None:
        environment["OPENBLAS_THREAD_TIMEOUT"] = chosen
    subprocess.run([sys.executable, "-c", "\n".join(lines)], env=environment, cwd=REPOSITORY, check=True)


def test_the_version_needs_no_numbers(place: Mapping[str, str]) -> None:
    assert not imported(place, "--version") & {"numpy", "gymnasium", "lark", "rich.progress"}


def test_a_model_is_read_once(place: Mapping[str, str], tmp_path: Path) -> None:
    reading = {"lark", "dl2c.parse.parser", "dl2c.resolve.problem", "dl2c.lower.problem", "z3"}
    for words in (
        ("build", str(MODEL), "-o", str(tmp_path)),
        ("check", str(MODEL), "--no-native"),
        ("info", str(MODEL), "--no-native"),
    ):
        first = dl2c(place, *words)
        assert not imported(place, *words) & reading, words
        assert dl2c(place, *words) == first


def test_a_build_serves_wherever_the_file_is(place: Mapping[str, str], tmp_path: Path) -> None:
    folders = [tmp_path / "here", tmp_path / "there"]
    for folder in folders:
        folder.mkdir()
        (folder / "warned.kyx").write_text(WARNED)
    calls, said = tmp_path / "calls", [dl2c(place, "build", str(folders[0] / "warned.kyx"))]
    compiled = calls.read_text()
    said.append(dl2c(place, "build", str(folders[1] / "warned.kyx")))
    assert calls.read_text() == compiled
    for folder, (_, warnings) in zip(folders, said, strict=True):
        assert "warning" in warnings and f"{folder}/warned.kyx:" in warnings


def test_a_report_compiles_what_its_training_did_not(place: Mapping[str, str], tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    run, calls = str(tmp_path / "run"), tmp_path / "calls"
    dl2c(place, "train", str(MODEL), "-o", run, "--algo", "ppo", "--steps", "128", "--n-envs", "1")
    compiled = calls.read_text()
    dl2c(place, "report", run, "--episodes", "2")
    assert "Water_tank" in compiled
    assert "Water_tank" not in calls.read_text().removeprefix(compiled)


def test_a_build_imports_what_it_needs(place: Mapping[str, str], tmp_path: Path) -> None:
    words = ("build", str(MODEL), "-o", str(tmp_path))
    others = {"rich.console", "gymnasium", "importlib.metadata", "dl2c.monitor.check"}
    others |= {"dl2c.parse.mistakes", "dl2c.parse.recovery", "dl2c.quantifiers.eliminate"}
    assert not imported(place, *words) & others


def test_a_build_that_is_kept_is_not_loaded(place: Mapping[str, str], tmp_path: Path) -> None:
    words = ("build", str(MODEL), "-o", str(tmp_path))
    dl2c(place, *words)
    assert not imported(place, *words) & {"numpy", "cffi", "gymnasium", "dl2c.native.binding"}


def test_info_compiles_no_c(place: Mapping[str, str], tmp_path: Path) -> None:
    said, _ = dl2c(place, "info", str(MODEL), "--json", "--no-native")
    assert not (tmp_path / "calls").exists()
    dl2c(place, "build", str(MODEL), "-o", str(tmp_path / "built"))
    assert (tmp_path / "calls").exists()
    (manifest,) = (tmp_path / "built").glob("*/manifest.json")
    assert json.loads(said) == json.loads(manifest.read_text())
    assert dl2c(place, "info", str(MODEL), "--json", "--no-native")[0] == said


def test_warnings_are_told_again(place: Mapping[str, str], tmp_path: Path) -> None:
    model = tmp_path / "warned.kyx"
    model.write_text(WARNED)
    for words in (("check", str(model)), ("check", "--json", str(model)), ("build", str(model))):
        first = dl2c(place, *words, folder=tmp_path)
        assert dl2c(place, *words, folder=tmp_path) == first
        assert "warning" in "".join(first), words


def test_a_note_is_about_one_text_with_its_options(place: Mapping[str, str], tmp_path: Path) -> None:
    model = tmp_path / "model.kyx"
    model.write_text(MODEL.read_text())

    def option(*words: str) -> float:
        dl2c(place, "build", "model.kyx", *words, folder=tmp_path)
        said, _ = dl2c(place, "info", "model.kyx", "--json", *words, folder=tmp_path)
        return json.loads(said)["options"]["max_episode_steps"]

    before = option()
    assert option("--max-episode-steps", "7") == 7
    assert option() == before
    (tmp_path / "pyproject.toml").write_text("[tool.dl2c]\nmax_episode_steps = 9\n")
    configured = option()
    (tmp_path / "pyproject.toml").unlink()
    assert configured in (9, before), "an `@episode` of the model wins over the project"
    model.write_text(MODEL.read_text().replace("max_steps=", "max_steps=1"))
    assert option() != before
    text = model.read_text()
    model.write_text(text.replace("Problem", "Problm", 1))
    with pytest.raises(subprocess.CalledProcessError):
        dl2c(place, "build", "model.kyx", folder=tmp_path)


@pytest.mark.slow
def test_broken_notes_are_not_used(place: Mapping[str, str], tmp_path: Path) -> None:
    build, check = ("build", str(MODEL), "-o", str(tmp_path)), ("check", str(MODEL))
    first = [dl2c(place, *words) for words in (build, check)]
    notes = list((tmp_path / "cache").rglob("notes/*.json"))
    assert len(notes) == 2
    odd = ("", "[]", "{}", '{"warnings": 1}', '{"warnings": [{"code": 1}]}', "nul\0")
    for text in (*odd, '{"options": {}, "warnings": []}', '{"options": 1, "warnings": []}'):
        for note in notes:
            note.write_text(text)
        assert dl2c(place, *build) == first[0]
        if '"warnings": []' not in text:
            assert dl2c(place, *check) == first[1]
    dl2c(place, "cache", "clear")
    assert not list((tmp_path / "cache").rglob("notes/*.json"))


def test_measuring_knows_the_ids_of_gymnasium(place: Mapping[str, str]) -> None:
    out, _ = dl2c(place, "bench", "example:thermostat", "--seconds", "0.05", "--json")
    assert {"gym", "vector64"} <= {row["key"] for row in json.loads(out)["rows"]}
