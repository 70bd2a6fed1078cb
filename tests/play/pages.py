"""Pages of examples for tests: made once."""

import importlib.util
import shutil
from functools import cache
from pathlib import Path

import pytest
from devtools import Page
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.env.opening import examples_dir, source_of
from dl2c.play.build import Playable, playable
from dl2c.play.page import page_of

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="there is no Node.js")
needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="there is no ziglang")

EXAMPLES = sorted(path.stem for path in examples_dir().glob("*.kyx"))

READY = "document.documentElement.dataset.ready"


@cache
def made(example: str) -> Playable:
    return playable(source_of(f"example:{example}"), {})


@cache
def text_of(example: str) -> str:
    return page_of(made(example))


def opened(browser: Page, example: str, folder: Path) -> Page:
    """The page of an example, at a beginning that is always the same."""
    path = folder / f"{example}.html"
    path.write_text(text_of(example), encoding="utf-8")
    browser.begin()
    browser.open(path, READY)
    browser("page.restart(7n)")
    return browser


def replayed(recording: str, folder: Path) -> str:
    """What `dl2c replay` says of a recording that it accepts."""
    file = folder / "episode.json"
    file.write_text(recording, encoding="utf-8")
    done = CliRunner().invoke(app, ["replay", "-q", str(file)])
    assert done.exit_code == 0, done.output
    return done.output
