"""Commands with little memory: they work, or end in one line.

With less than 450 MB of address space libraries crash, or say odd things, while they are loaded. PyTorch
would end the process itself where it finds no memory.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dl2c.commands.failures import report

ROOT = Path(__file__).resolve().parents[2]

LIMITED = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv.pop(1)) * 2**20,) * 2)
runpy.run_module("dl2c", run_name="__main__", alter_sys=True)
"""

COMMANDS = {
    "build": ("build", "example:passive_safety", "-o", "out"),
    "check": ("check", "example:passive_safety", "--prove-coverage"),
    "sample": ("sample", "example:waypoint", "-n", "5000000", "--csv", "out/a.csv"),
    "rollout": ("rollout", "example:waypoint", "--episodes", "5", "--csv", "out/a.csv"),
    "monitor": ("monitor", "example:waypoint", "--sound", "-o", "out"),
    "falsify": (
        "falsify",
        "example:watertank",
        "--n-envs",
        "100000",
        "--episodes",
        "100000",
        "--max-episode-steps",
        "20",
        "-o",
        "out/a.json",
    ),
    "verify": ("verify", "example:watertank", "--total", "20"),
    "bench": ("bench", "example:waypoint", "--seconds", "1"),
    "train": ("train", "example:waypoint", "--steps", "200", "-o", "out"),
}

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the limit of address space is Linux's")


def limited(name: str, megabytes: int, folder: Path) -> int:
    """The exit code of a command, which is 0, or 1 after one line that is no bug."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": str(folder / "cache")}
    environment["CFLAGS"] = "-O0 -DDL2C_NO_TARGET_CLONES"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(megabytes), *COMMANDS[name]], cwd=folder, env=environment,
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    where = f"{name} with {megabytes} MB: {done.returncode}\n{done.stderr[-2000:]}"
    assert done.returncode in (0, 1), where
    assert not re.search(r"Traceback|internal error|Segmentation", done.stderr), where
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == done.returncode, where
    if done.returncode:
        assert re.search(r"memory|cannot allocate|File too large|could not compile", errors[0]), where
        assert name == "train" or not [path for path in (folder / "out").rglob("*") if path.is_file()], where
    return done.returncode


@pytest.mark.parametrize(
    ("name", "megabytes"), [("build", 450), ("sample", 600), ("train", 450), ("train", 540)]
)
def test_little_memory_is_one_line(name: str, megabytes: int, tmp_path: Path) -> None:
    limited(name, megabytes, tmp_path)


def test_what_is_too_large_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert report(MemoryError()) == 1
    with pytest.raises(MemoryError) as found:
        np.empty(2**60, np.uint8)
    assert report(found.value) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first == "error: out of memory"
    assert re.fullmatch(r"error: out of memory: .*1\.00 EiB.*", second)


def test_enough_memory_is_enough(tmp_path: Path) -> None:
    for folder in ("build", "sample"):
        (tmp_path / folder).mkdir()
    assert limited("build", 2000, tmp_path / "build") == 0
    assert limited("sample", 500, tmp_path / "sample") == 1


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", [450, 520, 540, 600, 700, 800, 850, 900, 1000, 1100, 1200])
@pytest.mark.parametrize("name", COMMANDS)
def test_any_memory_is_told_in_one_line(name: str, megabytes: int, tmp_path: Path) -> None:
    limited(name, megabytes, tmp_path)
