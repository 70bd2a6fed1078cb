"""The pages of docs/ work as written: each command and snippet is executed, in order, page by page."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from dl2c.parse import annotations

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^(?:<!-- (\w+): ([^>]*?) -->\n)?```([^\n]*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
QUICK = ("tutorial-rl", "tutorial-keymaera")


class Block(NamedTuple):
    """`file` is where to write the text, `needs` a library without which it is left out."""

    kind: str
    text: str
    file: str
    needs: str


def blocks(page: Path) -> Iterator[Block]:
    for word, value, kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        assert word in ("", "file", "needs"), word
        yield Block(kind, text, value if word == "file" else "", value if word == "needs" else "")


PAGES = [page for page in sorted(DOCS.rglob("*.md")) if any(b.kind in ("sh", "python") for b in blocks(page))]


def run(folder: Path, *command: str) -> None:
    """Run a command where `dl2c` is this dl2c."""
    shim = folder / "bin" / "dl2c"
    shim.parent.mkdir(exist_ok=True)
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m dl2c "$@"\n', encoding="utf-8")
    shim.chmod(0o755)
    path = {"PATH": f"{shim.parent}:{os.environ['PATH']}", "PYTHONPATH": f"{ROOT}:{folder}"}
    done = subprocess.run(
        command, cwd=folder, env=os.environ | path, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, f"{command[-1]}\n{done.stderr[-3000:]}{done.stdout[-1000:]}"


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=[] if p.stem in QUICK else [pytest.mark.slow], id=p.stem) for p in PAGES],
)
def test_page_works_as_written(page: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for block in blocks(page):
        if block.needs and find_spec(block.needs) is None:
            continue
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        elif block.kind == "sh":
            run(tmp_path, "sh", "-ec", block.text)
        elif block.kind == "python":
            run(tmp_path, sys.executable, "-c", block.text)


def test_every_kind_of_block_is_known() -> None:
    kinds = {block.kind.split()[0] for page in DOCS.rglob("*.md") for block in blocks(page)}
    assert kinds <= {"sh", "python", "text", "toml", "yaml", "{toctree}", "{eval-rst}", "{dl2c}"}


def test_pages_build_without_a_warning(tmp_path: Path) -> None:
    for library in ("sphinx", "furo", "myst_parser"):
        pytest.importorskip(library)
    run(tmp_path, sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(DOCS), str(tmp_path / "out"))
    pages = list((tmp_path / "out").rglob("*.html"))
    loaded = re.compile(r'<(?:script|link|img)[^>]*(?:src|href)="https?://')
    assert pages and not [p for p in pages if loaded.search(p.read_text(encoding="utf-8"))]


def test_annotation_page_has_every_attribute() -> None:
    text = (DOCS / "reference" / "annotations.md").read_text(encoding="utf-8")
    names = {*annotations._VARIABLE, *annotations._CONSTANT, *annotations._PREDICATE, *annotations._CHOICE}
    assert not [name for name in names if not re.search(rf"`{name}[`=]", text)]
