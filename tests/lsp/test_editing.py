"""What `dl2c lsp` offers to write: completion, corrections, new names."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import REPOSITORY
from lsp_editor import Editor, File
from lsp_mistakes import MODEL
from lsprotocol import types
from pygls.exceptions import JsonRpcException

from dl2c.parse.comments import KNOWN


@pytest.fixture(scope="module")
def editor() -> Iterator[Editor]:
    editor = Editor()
    yield editor
    assert editor.messages == [] and editor.end() == 0


@pytest.fixture(scope="module")
def plain() -> Iterator[Editor]:
    """One that counts bytes and fills in no places."""
    editor = Editor(["utf-8"], snippets=False)
    yield editor
    assert editor.messages == [] and editor.end() == 0


@pytest.fixture
def tank(editor: Editor) -> Iterator[File]:
    file = editor.open(MODEL)
    file.until(lambda found: True)
    yield file
    file.close()


@pytest.mark.parametrize(
    ("typed", "wanted", "unwanted"),
    [
        ("/* @|", {f"@{name}" for name in KNOWN}, {"ctrl", "bound"}),
        ("/* @va|", {"@var"}, {"ctrl"}),
        ("/* @var: |", {"bound", "unit", "def", "plot", "role", "observe"}, {"reward", "x"}),
        ("/* @var: bound=[0:1], pl|", {"plot"}, {"@var"}),
        ("/* @var: plot=|", {"line", "hist", "scatter", "none"}, {"bound"}),
        ("/* @var: role=|", {"agent", "env"}, {"line"}),
        ("/* @safety: on_failure=|", {"terminate", "truncate", "continue"}, {"x"}),
        ("/* @progress: reward=|", {"x", "inside", "limit", "abs"}, {"ctrl", "terminate"}),
        ("/* @progress: reward={2 * |", {"x", "inside", "after"}, {"ctrl"}),
        ("/* @episode: |", {"max_steps", "dt", "allow", "on_blocked"}, {"entry", "native"}),
        ("/* @episode: on_blocked=|", {"fallback", "truncate"}, {"x"}),
        ("/* @episode: allow=de|", {"deadlock", "default-dt"}, {"x"}),
        ("// @episode: max_steps=1,\n  // |", {"dt"}, {"x"}),
        ("/* a word |", set(), {"x", "@var", "bound"}),
        ("Bool p(Real speed) <-> (spe|", {"speed", "x", "inside", "true", "max"}, {"@var"}),
        ("R|", {"Real", "Bool", "HP", "import"}, {"@var"}),
    ],
)
def test_completion_knows_where_it_is(tank: File, typed: str, wanted: set[str], unwanted: set[str]) -> None:
    text = MODEL.replace("\n  HP ctrl", f"\n  {typed}\n  HP ctrl")
    tank.change(text.replace("|\n", "\n", 1))
    found = tank.completions(types.Position(*tank.lines.position(text.index("|\n"))))
    assert wanted <= {*found} and not unwanted & {*found}


def test_characters_ask_for_completion_in_comments_alone(tank: File) -> None:
    tank.change(MODEL.replace("f := 0;", "f := 0, ;").replace('unit="m/s"', 'unit="m/s", '))

    def asked(mark: str, within: int, trigger: str) -> int:
        kind = types.CompletionTriggerKind.TriggerCharacter
        context = types.CompletionContext(kind, trigger)
        params = types.CompletionParams(tank.identifier, tank.at(mark, within), context)
        return len(tank.ask("completion", params).items)

    assert asked('m/s", ', 6, " ") > 3 and asked('m/s", ', 5, ",") > 3
    assert asked("f := 0, ", 8, " ") == asked("f := 0, ", 7, ",") == asked("f := 0, ", 4, "=") == 0


def test_completion_fills_in_places_for_those_who_can(tank: File, plain: Editor) -> None:
    found = tank.completions(tank.at("t := 0; fill"))
    assert found["after"].text_edit.new_text == "after(${1:x}, ${2:f})"
    assert found["loop"].insert_text_format == types.InsertTextFormat.Snippet
    file = plain.open(MODEL)
    assert file.completions(file.at("t := 0; fill"))["after"].text_edit.new_text == "after"


# ---------------------------------------------------------------- corrections


@pytest.mark.parametrize(
    ("there", "wrong", "title", "right"),
    [
        ("f := 0; }", "f := 0 }", "end every", "f := 0; }"),
        ("0 <= x & x", "0 <= x && x", "write", "0 <= x & x"),
        ("?x > 0;", "?x > 0; // off\n", "write `/*", "?x > 0; /* off */\n"),
        ("  Real t;\n", "", "`dl2c check --fix`", None),
        ("x + f * ep;", "x/-f/ep;", "put what you mean", "x/(-(f/ep));"),
        ("after(x, f)", "aftr(x, f)", "write `after`", "after(x, f)"),
        ("plot=line", "plt=line", "write `plot`", "plot=line"),
        ("@var: bound=[0:10]", "@vra: bound=[0:10]", "write `@var`", "@var: bound=[0:10]"),
    ],
)
def test_a_correction_answers_its_diagnostic(
    tank: File, there: str, wrong: str, title: str, right: str | None
) -> None:
    tank.change(MODEL.replace(there, wrong))
    tank.until(lambda found: found != [])
    time.sleep(0.3)
    (action,) = [a for t, a in tank.actions(tank.whole).items() if t.startswith(title) and a.diagnostics]
    tank.change(tank.edited([*action.edit.changes[tank.uri]]))
    assert tank.text == MODEL.replace(there, right) if right else "Real t;" in tank.text
    tank.until(lambda found: not any(d.severity == types.DiagnosticSeverity.Error for d in found))


def test_all_corrections_together_are_those_of_check_fix(tank: File, tmp_path: Path) -> None:
    wrong = (
        MODEL.replace("0 <= x & x", "0 <= x && x")
        .replace("f := 0; }", "f := 0 }")
        .replace("f <= 1", "f<=1&&true")
    )
    tank.change(wrong)
    tank.until(lambda found: found != [])
    (action,) = tank.actions(tank.whole, [types.CodeActionKind.SourceFixAll]).values()
    path = tmp_path / "model.kyx"
    path.write_text(wrong, encoding="utf-8")
    command = [sys.executable, "-m", "dl2c", "check", str(path), "--fix"]
    subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True)
    assert tank.edited([*action.edit.changes[tank.uri]]) == path.read_text(encoding="utf-8")


# ---------------------------------------------------------------- positions, new names


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_positions_count_the_units_that_were_agreed(editor: Editor, plain: Editor, encoding: str) -> None:
    chosen = {"utf-8": plain, "utf-16": editor}[encoding]
    assert chosen.encoding == encoding
    file = chosen.open(MODEL.replace("HP ctrl ::= {", "HP ctrl ::= { /* “😀😀” é */ t := x;"))
    position = file.at("t := x;", 5)
    assert "level" in file.hover(position)
    (definition,) = file.definitions(position)
    assert definition.start == file.at("Real x;", 5)
    assert position in [r.start for r in file.references(position)]
    assert file.rename(position, "level_1").count("level_1") == len(file.references(position)) == 9
    file.change(file.text.replace("t := x;", "t := xx;"))
    file.until(lambda found: any(d.range.start == file.at("xx;") for d in found))
    file.close()


def test_line_ends_stay_as_they_are(editor: Editor) -> None:
    file = editor.open(MODEL.replace("  Real t;\n", "").replace("\n", "\r\n"), "windows.kyx")
    file.until(lambda found: "undeclared-names" in {d.code for d in found})
    assert "inside" in file.hover(file.at("inside(x) & ep"))
    action = next(a for a in file.actions(file.whole).values() if a.diagnostics)
    (edit,) = action.edit.changes[file.uri]
    assert "Real t;" in edit.new_text and "\n" not in edit.new_text.replace("\r\n", "")
    file.close()


def test_renaming_says_why_not(tank: File) -> None:
    position = tank.at("Real t;", 5)
    prepare = types.PrepareRenameParams(tank.identifier, position)
    assert tank.piece(tank.ask("prepare_rename", prepare)) == "t"
    assert "clock := 0" in tank.rename(position, "clock")
    for new, why in (("x", "another variable"), ("2t", "not a name"), ("abs", "library")):
        with pytest.raises(JsonRpcException, match=why):
            tank.rename(position, new)
    with pytest.raises(JsonRpcException, match="no name of the model"):
        tank.ask("prepare_rename", types.PrepareRenameParams(tank.identifier, types.Position(0, 0)))


def test_a_renaming_tells_of_tactics(editor: Editor) -> None:
    file = editor.open(MODEL.replace("\n\nEnd.", '\n\nTactic "Proof"\n  loop("inside(x)", 1)\nEnd.\n\nEnd.'))
    assert file.rename(file.at("inside(x) & ep"), "within").count("within") == 5
    file.until(lambda found: editor.messages != [])
    assert 'the tactics of "Tank" still have the old name' in editor.messages.pop()
    file.close()
