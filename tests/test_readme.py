"""Everything that the README shows works as shown."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", README, flags=re.M | re.S)
COMMANDS = [
    line.split("#")[0].strip()
    for kind, text in BLOCKS
    if kind == "sh"
    for line in text.splitlines()
    if line.strip()
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the examples, as a user has it."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


def run(folder: Path, *arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-1000:]


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("dl2c ")])
def test_command_runs(folder: Path, command: str) -> None:
    if command.startswith("dl2c train") or "build/train" in command:
        pytest.importorskip("stable_baselines3")
    run(folder, "-m", *shlex.split(command))


@pytest.mark.parametrize("code", [text for kind, text in BLOCKS if kind == "python"])
def test_code_runs(folder: Path, code: str) -> None:
    run(folder, "-c", code)


def test_every_make_target_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.M))
    named = {c.split()[1] for c in COMMANDS if c.startswith("make ")}
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        named |= set(
            re.findall(r"`make ([a-z-]+)`", text) + re.findall(r"^make ([a-z-]+) +#", text, flags=re.M)
        )
    assert {"demo", "test"} <= named <= targets
