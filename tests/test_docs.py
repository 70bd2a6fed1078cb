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
from selection import quick_among
from test_house_rules import LAYERS

from dl2c.experiments.commands import app
from dl2c.lint.codes import LINTS
from dl2c.options import OPTIONS
from dl2c.parse import annotations

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^(?:<!-- (\w+): ([^>]*?) -->\n)?```([^\n]*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
QUICK = ("tutorial-keymaera",)


TEXTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted(page for page in DOCS.rglob("*.md") if page.name != "page.md"),
    *sorted((ROOT / "examples").rglob("*.md")),
]
"""All documents but those that `dl2c study` writes."""

MAX_COLUMNS = 110
MAX_LINES = {"README.md": 150, "ARCHITECTURE.md": 120}


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
    """Run a command where `dl2c` is this dl2c, and `python` this Python."""
    programs = folder / "bin"
    programs.mkdir(exist_ok=True)
    for name, words in (("dl2c", " -m dl2c"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}"{words} "$@"\n', encoding="utf-8")
        (programs / name).chmod(0o755)
    path = {"PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": f"{ROOT}:{folder}"}
    done = subprocess.run(
        command, cwd=folder, env=os.environ | path, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, f"{command[-1]}\n{done.stderr[-3000:]}{done.stdout[-1000:]}"


@pytest.mark.parametrize(
    "page",
    quick_among(PAGES, [page for page in PAGES if page.stem in QUICK]),
    ids=lambda page: page.stem,
)
def test_page_works_as_written(page: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    shutil.copytree(DOCS / "lecture", tmp_path / "docs" / "lecture")
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


UNPROVED = {
    "exclude_patterns": "_build,environments/*",
    "suppress_warnings": "toc.excluded,myst.xref_missing",
}
"""All pages but those of the environments, which prove their models: that takes ten times as long."""


def built(folder: Path, settings: dict[str, str]) -> Path:
    """Pages as `make docs` builds them, with other settings of Sphinx; none loads anything from elsewhere."""
    for library in ("sphinx", "furo", "myst_parser"):
        pytest.importorskip(library)
    words = [word for name, value in settings.items() for word in ("-D", f"{name}={value}")]
    to = folder / "out"
    run(folder, sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", *words, str(DOCS), str(to))
    loaded = re.compile(r'<(?:script|link|img)[^>]*(?:src|href)="https?://')
    pages = list(to.rglob("*.html"))
    assert pages and not [p for p in pages if loaded.search(p.read_text(encoding="utf-8"))]
    return to


@pytest.mark.slow  # proves the models of all environments; the next test builds all other pages
def test_pages_load_nothing_from_elsewhere(tmp_path: Path) -> None:
    assert list((built(tmp_path, {}) / "environments").glob("*.html"))


def test_reference_has_every_option_command_and_code(tmp_path: Path) -> None:
    html = built(tmp_path, UNPROVED)

    def named(page: str) -> set[str]:
        text = (html / "reference" / f"{page}.html").read_text(encoding="utf-8")
        first_cells = re.findall(r'<tr[^>]*><td>(?:<p>)?<code[^>]*><span class="pre">([^<]*)</span>', text)
        return {*first_cells, *re.findall(r"<h[23]>dl2c ([a-z]+)", text)}

    assert {*OPTIONS} == named("options")
    commands = {command.name or command.callback.__name__ for command in app.registered_commands}
    assert commands <= named("commands")
    assert {lint.code for lint in LINTS} <= named("lints")


@pytest.mark.parametrize("command", sorted(c.name or c.callback.__name__ for c in app.registered_commands))
def test_documented_commands_are_those_of_the_program(command: str, tmp_path: Path) -> None:
    run(tmp_path, sys.executable, "-m", "dl2c", command, "--help")


def sections(page: Path) -> list[int]:
    """The numbers of a page's sections, in order."""
    return [int(n) for n in re.findall(r"^## (\d+) \S", page.read_text(encoding="utf-8"), flags=re.M)]


def cited(word: str, folders: tuple[str, ...]) -> set[int]:
    """The numbers that follow a word, as in `semantics 5 and 6`."""
    pattern = re.compile(rf"\b{word} (\d+(?:(?:, | and | to )\d+)*)")
    files = [p for f in folders for p in (ROOT / f).rglob("*") if p.suffix in (".py", ".h", ".c", ".md")]
    found = [numbers for p in files for numbers in pattern.findall(p.read_text(encoding="utf-8"))]
    return {int(n) for numbers in found for n in re.findall(r"\d+", numbers)}


def test_cited_sections_of_the_semantics_exist() -> None:
    there = sections(DOCS / "semantics.md")
    assert there == list(range(1, len(there) + 1))
    found = cited("semantics", ("dl2c", "cgen", "docs", "tests"))
    assert len(found) > 5 and found <= set(there)


def test_cited_decisions_exist() -> None:
    there = sorted(n for page in (DOCS / "decisions").glob("*.md") for n in sections(page))
    assert there == list(range(1, len(there) + 1)), "each number once"
    found = cited("decisions?", ("dl2c", "cgen", "docs", "tests"))
    assert found and found <= set(there)


def anchors(page: Path) -> set[str]:
    """What a link may name after `#`: the titles of a page as GitHub and MyST write them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\((?!https?:)([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), link
        assert not anchor or anchor in anchors(there), link


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_lines_fit(page: Path) -> None:
    lines = page.read_text(encoding="utf-8").splitlines()
    assert not [line for line in lines if len(line) > MAX_COLUMNS and not line.startswith(("$$", "| ["))]
    assert len(lines) <= MAX_LINES.get(page.name if page.parent == ROOT else "", len(lines))


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_words_of_the_glossary_are_used(page: Path) -> None:
    text = re.sub(r"https?:\S+", "", page.read_text(encoding="utf-8")).partition("\n## Glossary")[0]
    assert not re.findall(r"\b(?:fleet|convoy|sails?|roams?|recruits?|blinks?|abreast)\b", text, flags=re.I)


def test_code_map_has_every_folder_in_the_order_of_the_layers() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.partition("## Code map\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*`) \|", section, flags=re.M)
    named = [name for row in rows for name in re.findall(r"`(\w+)(?:/|\.py)`", row) if name != "cgen"]
    assert named == sorted(named, key=LAYERS.index)
    assert {path.name for path in (ROOT / "dl2c").iterdir() if (path / "__init__.py").exists()} <= {*named}


def test_annotation_page_has_every_attribute() -> None:
    text = (DOCS / "reference" / "annotations.md").read_text(encoding="utf-8")
    names = {*annotations._VARIABLE, *annotations._CONSTANT, *annotations._PREDICATE, *annotations._CHOICE}
    assert not [name for name in names if not re.search(rf"`{name}[`=]", text)]
