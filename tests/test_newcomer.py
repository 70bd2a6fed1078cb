"""In a fresh clone, with nothing installed and nothing cached, the README and the tutorials work as they are
written: every command and snippet, in one shell a page.
"""

import os
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest
from conftest import REPOSITORY
from test_docs import Block, blocks

TUTORIALS = ("tutorial-rl", "tutorial-keymaera")
LEFT_OUT = "make test"
"""This is one of the tests."""

HOURS = 2


def script(steps: Iterable[Block]) -> str:
    """What a newcomer types."""
    lines = ["set -ex"]
    for step in steps:
        if step.file:
            lines.append(f"cat > {step.file} <<'END'\n{step.text}END")
        elif step.kind == "sh":
            lines += [line for line in step.text.splitlines() if not line.startswith(LEFT_OUT)]
        elif step.kind == "python":
            lines.append(f"python - <<'END'\n{step.text}END")
    return "\n".join(lines)


def follow(clone: Path, steps: Iterable[Block], cache: Path) -> None:
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("DL2C_", "PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        ["sh", "-c", script(steps)],
        cwd=clone,
        env=inherited | {"DL2C_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=HOURS * 3600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-6000:] + done.stdout[-2000:]


@pytest.mark.slow
def test_readme_and_tutorials_work_in_a_fresh_clone(tmp_path: Path) -> None:
    clone, cache = tmp_path / "dl2c", tmp_path / "cache"
    subprocess.run(["git", "clone", "-q", str(REPOSITORY), str(clone)], check=True)
    taste, start, *rest = blocks(clone / "README.md")
    assert start.text.startswith("make demo"), "what the page begins with needs what is installed next"
    follow(clone, [start, taste, *rest], cache)
    activate = Block("sh", start.text.splitlines()[-1] + "\n", "", "")
    for page in TUTORIALS:
        follow(clone, [activate, *blocks(clone / "docs" / f"{page}.md")], cache)
