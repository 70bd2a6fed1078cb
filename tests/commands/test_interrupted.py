"""Ctrl-C in every command, at any moment: one line, exit code 130, and nothing half-written."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODEL = "example:waypoint"

COUNT = """Theorem "count"
Definitions
  /* @safety: penalty=-1, on_failure=terminate:failure */
  Bool few(Real x) <-> x <= 9;
End.
ProgramVariables
  /* @var: bound=[0:5], plot=line */
  Real x;
End.
Problem x >= 0 -> [{ x := x + 1; ++ x := x; }*] few(x) End.
End.
"""
"""A model that fails."""

COMMANDS = {
    "build": ("build", MODEL, "-o", "out"),
    "check": ("check", "example:passive_safety", "--prove-coverage"),
    "annotate": ("annotate", MODEL, "-o", "out/a.kyx"),
    "info": ("info", "example:dubins"),
    "emit": ("emit", "example:passive_safety", "--stage", "gym"),
    "sample": ("sample", MODEL, "-n", "30000", "--csv", "out/a.csv"),
    "rollout": ("rollout", MODEL, "--episodes", "300", "--csv", "out/a.csv", "--save-failures", "failures"),
    "falsify": ("falsify", MODEL, "--target", "failure", "-o", "out/a.json"),
    "replay": ("replay", "given/episode.json", "--plot", "out/a.png"),
    "report": ("report", "given/run", "-o", "out/a.html", "--episodes", "20"),
    "bench": ("bench", MODEL, "--seconds", "2"),
    "verify": ("verify", "example:watertank"),
    "monitor": ("monitor", MODEL, "--sound", "-o", "out"),
    "cache": ("cache", "list"),
}
"""Commands that end soon; what they write is in `out`."""

LONG = {
    "train": ("train", MODEL, "--steps", "2000", "--n-envs", "2", "-o", "trained"),
    "paper": ("paper", "--quick", "-o", "paper"),
    "study": ("study", "acc"),
    "demo": ("demo",),
}
"""Those that save what they have."""


FIRST_LINE = "from dl2c import interruption as _interruption"
"""Of the package: what says how interruptions are told is not there before."""


def environment(folder: Path) -> dict[str, str]:
    own = {"PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    return {**os.environ, **own, "CFLAGS": "-O0 -DDL2C_NO_TARGET_CLONES"}


@pytest.fixture(autouse=True)
def heeded() -> Iterator[None]:
    """Processes in the background of a shell ignore interruptions, and so would those that they start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def started(words: tuple[str, ...], folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dl2c", *words]
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder,
        env=environment(folder), start_new_session=True,
    )  # fmt: skip


def written(folder: Path, name: str = "out") -> dict[str, bytes]:
    place = folder / name
    return {str(p.relative_to(place)): p.read_bytes() for p in sorted(place.rglob("*")) if p.is_file()}


def interrupted(words: tuple[str, ...], folder: Path, delay: float) -> int:
    """Send the signal after so many seconds; the exit code, after a look at what was said and left."""
    with started(words, folder) as process:
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    said = (out + err).decode("utf-8", "replace")
    where = f"{words[0]} after {delay:.3f} s: exit code {process.returncode}\n{said[-3000:]}"
    ours = "/dl2c/" in said and FIRST_LINE not in said
    begun = not re.search(r"Traceback|Fatal Python error|Error processing", said) or ours
    if begun:
        assert process.returncode in (0, 130, -signal.SIGINT), where
        assert not re.search(r"Traceback|Exception ignored|internal error|Aborted", said), where
    if process.returncode == -signal.SIGINT and begun:  # Python begins or ends
        assert "interrupted" not in said, where
    if process.returncode == 130:
        assert said.splitlines()[-1].strip() == "interrupted", where
    left = [p for p in folder.rglob("*") if p.name.startswith(".dl2c-") or p.name.endswith(".tmp")]
    assert not left, f"{where}\nleft {left}"
    for path in folder.rglob("*.json"):
        json.loads(path.read_text(encoding="utf-8"))
    return process.returncode


@pytest.fixture
def prepared(tmp_path: Path) -> Callable[..., None]:
    """Runs commands undisturbed."""

    def run(*words: str) -> None:
        with started(words, tmp_path) as process:
            _, err = process.communicate(timeout=280)
        assert process.returncode in (0, 1) and b"Traceback" not in err, err.decode()

    return run


def check_command(name: str, folder: Path, run: Callable[..., None], times: int) -> None:
    """Whatever is in `out` is what an undisturbed command writes, or all of it is missing."""
    if name == "replay":
        (folder / "count.kyx").write_text(COUNT, encoding="utf-8")
        run("falsify", "count.kyx", "--target", "failure", "--episodes", "500", "-o", "given/episode.json")
    if name == "report":
        run("train", MODEL, "--steps", "300", "--n-envs", "2", "--eval-episodes", "2", "-o", "given/run")
    words, rng = COMMANDS[name], Random(name)
    began = time.monotonic()
    run(*words)
    whole, expected = time.monotonic() - began, set(written(folder))
    codes: list[int] = []
    for number in range(times):
        for path in sorted((folder / "out").rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        if number % 2:
            run("cache", "clear")
        codes.append(interrupted(words, folder, rng.uniform(0.02, whole)))
        assert set(written(folder)) in (set(), expected), f"{name}, interruption {number}"
        assert codes[-1] != 0 or set(written(folder)) == expected
    assert 130 in codes


@pytest.mark.parametrize("name", ["build"])
def test_an_interruption_is_one_line(name: str, tmp_path: Path, prepared: Callable[..., None]) -> None:
    check_command(name, tmp_path, prepared, 5)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_any_command_is_interrupted_in_one_line(
    name: str, tmp_path: Path, prepared: Callable[..., None]
) -> None:
    check_command(name, tmp_path, prepared, 16)


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_long_work_is_interrupted_in_one_line(name: str, tmp_path: Path) -> None:
    rng = Random(name)
    codes = [
        interrupted(LONG[name], tmp_path, delay) for delay in (0.3, *(rng.uniform(0.02, 9) for _ in range(9)))
    ]
    assert 130 in codes


IMPORTS = """
import os, signal, sys

class Interrupting:
    begun, left = False, int(os.environ["INTERRUPT_AFTER"])

    def find_spec(self, name, path=None, target=None):
        self.begun = self.begun or name == "pathlib"
        if self.begun:
            self.left -= 1
            if self.left == 0:
                os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
"""
"""Sends the signal at one import, counted from the first of the package itself."""


def test_the_package_is_imported_under_guard(tmp_path: Path) -> None:
    """From its first statement on the process ends in one line, whatever it imports."""
    (tmp_path / "sitecustomize.py").write_text(IMPORTS, encoding="utf-8")
    own = environment(tmp_path) | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "dl2c", "--version"]
    for number in (1, 2, 3, 5, 9, 17, 33, 65, 97, 129):
        own["INTERRUPT_AFTER"] = str(number)
        done = subprocess.run(command, env=own, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n"), number


WITHIN = """
import sys, types
module = types.ModuleType("dl2c.experiments.commands")
module.main = lambda: exec("raise KeyboardInterrupt")
sys.modules[module.__name__] = module
"""


def test_code_of_strings_is_interrupted_like_any(tmp_path: Path) -> None:
    """Dataclasses are made by `exec`: after Ctrl-C in there, Python would end itself by the signal."""
    (tmp_path / "sitecustomize.py").write_text(WITHIN, encoding="utf-8")
    own = environment(tmp_path) | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "dl2c", "--version"]
    done = subprocess.run(command, env=own, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


IMPORTING = """
import signal, threading, os
import dl2c
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
"""


def test_programs_that_import_dl2c_keep_their_own_way(tmp_path: Path) -> None:
    script = tmp_path / "train.py"
    script.write_text(IMPORTING, encoding="utf-8")
    for words in ([str(script), "dl2c"], ["-m", "train", "-m", "dl2c"], ["-c", IMPORTING, "dl2c"]):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment(tmp_path),
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
