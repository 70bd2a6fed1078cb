"""Pages of examples for tests: made once, driven by scripts of their own."""

import base64
import hashlib
import html
import importlib.util
import json
import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from browser import visited

from dl2c.env.opening import examples_dir, source_of
from dl2c.play.build import Playable, playable
from dl2c.play.page import page_of

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="there is no Node.js")
needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="there is no ziglang")

EXAMPLES = sorted(path.stem for path in examples_dir().glob("*.kyx"))

PROGRAM = re.compile(r'<script type="module">(.*?)</script>', re.DOTALL)

DRIVER = """
(async () => {
  const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
  while (!document.documentElement.dataset.ready) await wait(10);
  const key = (key, target = document.body) =>
    target.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
  const byText = (text) => [...document.querySelectorAll("button")].find((b) => b.textContent.trim() === text);
  let found;
  try { found = await (async () => { %s })(); } catch (problem) { found = { problem: String(problem.stack) }; }
  const place = document.createElement("output");
  place.id = "found";
  place.textContent = JSON.stringify(found);
  document.body.append(place);
})();
"""
"""Runs a script in a page, when that is ready; what it returns stands in the document then."""


@cache
def made(example: str) -> Playable:
    return playable(source_of(f"example:{example}"), {})


@cache
def page(example: str) -> str:
    return page_of(made(example))


def driven(text: str, script: str) -> str:
    """A page whose program also runs a script, and whose policy allows that."""
    program = PROGRAM.search(text)
    assert program is not None
    longer = program[1] + DRIVER % script
    result = text.replace(hash_of(program[1]), hash_of(longer)).replace(program[1], longer)
    assert result.count(longer) == 1
    return result


def hash_of(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def found_by(text: str, script: str, folder: Path, *flags: str, milliseconds: int = 20_000) -> Any:
    """What a script returns in a page; nothing is said on the console."""
    budget = f"--virtual-time-budget={milliseconds}"
    done = visited(driven(text, script), folder, budget, "--enable-logging=stderr", "--dump-dom", *flags)
    assert done.returncode == 0, done.stderr[-2000:]
    said = [line for line in done.stderr.decode("utf-8", "replace").splitlines() if "CONSOLE" in line]
    assert said == []
    document = done.stdout.decode("utf-8", "replace")
    result = re.search(r'<output id="found">(.*?)</output>', document, re.DOTALL)
    assert result is not None, document[-3000:]
    found: Any = json.loads(html.unescape(result[1]))
    assert not (isinstance(found, dict) and "problem" in found), found
    return found
