"""`dl2c lsp` as an editor talks to it, over stdio: what it says of names and parts, and of slips in time."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import REPOSITORY
from lsp_editor import Editor, File
from lsp_mistakes import MODEL, SLIPS, Slip
from lsprotocol import types
from selection import quick_among

from dl2c.commands.check import diagnostics_of
from dl2c.lsp.analysis import analyse
from dl2c.options import Options
from dl2c.parse.comments import KNOWN
from dl2c.source import Source

EXAMPLES = sorted((REPOSITORY / "examples").rglob("*.kyx"))
PROMPT = 0.3
"""Seconds after the last key in which a mistake is told."""


@pytest.fixture(scope="module")
def editor() -> Iterator[Editor]:
    editor = Editor()
    yield editor
    assert editor.messages == [] and editor.end() == 0


@pytest.fixture
def tank(editor: Editor) -> Iterator[File]:
    file = editor.open(MODEL)
    file.until(lambda found: True)
    yield file
    file.close()


def names(file: File, limit: int) -> list[tuple[int, int]]:
    """Some places of names in the code of a file."""
    code = analyse(Source("model.kyx", file.lines.text), Options())
    found = [(o.start, o.end) for o in code.names.occurrences if o.symbol.kind != "library"]
    return found[:: max(1, len(found) // limit)]


@pytest.mark.parametrize("path", quick_among(EXAMPLES, EXAMPLES[::5]), ids=lambda path: path.stem)
def test_names_of_an_example_are_answered(editor: Editor, path: Path) -> None:
    file = editor.read(path)
    for start, end in names(file, 12):
        name = file.lines.text[start:end]
        position = types.Position(*file.lines.position(start))
        assert name in file.hover(position)
        (definition,) = file.definitions(position)
        assert file.piece(definition) == name
        references = file.references(position)
        assert {file.piece(r) for r in references} == {name} and definition in references
        assert any(r.start == position for r in references)
        if position != definition.start:
            assert name in file.completions(types.Position(*file.lines.position(end)))
    file.close()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_parts_of_an_example_are_listed(editor: Editor, path: Path) -> None:
    file = editor.read(path)
    symbols = file.ask("document_symbol", types.DocumentSymbolParams(file.identifier))
    inner = [s for symbol in symbols for s in (symbol, *(symbol.children or ()))]
    assert {"Problem"} <= {s.name for s in inner}
    for symbol in inner:
        assert symbol.range.start <= symbol.selection_range.start
        assert symbol.selection_range.end <= symbol.range.end
        if symbol.kind != types.SymbolKind.Module:
            assert file.piece(symbol.selection_range) == symbol.name
    folds = file.ask("folding_range", types.FoldingRangeParams(file.identifier))
    lines = file.lines.text.split("\n")
    problem = next(n for n, line in enumerate(lines) if line.startswith("Problem"))
    assert any(fold.start_line == problem and fold.end_line > problem for fold in folds)
    colours(file)
    file.close()


def colours(file: File) -> dict[str, set[str]]:
    """The words of each kind."""
    data = file.ask("semantic_tokens_full", types.SemanticTokensParams(file.identifier)).data
    legend = file.editor.capabilities.semantic_tokens_provider.legend
    line = column = 0
    found: dict[str, set[str]] = {}
    for k in range(0, len(data), 5):
        down, right, length, kind, _ = data[k : k + 5]
        line, column = line + down, right if down else column + right
        start, end = types.Position(line, column), types.Position(line, column + length)
        found.setdefault(legend.token_types[kind], set()).add(file.piece(types.Range(start, end)))
    assert found["keyword"] >= {"Real", "Problem", "End."} and found["variable"]
    return found


def test_words_have_their_colours(tank: File) -> None:
    found = colours(tank)
    assert found["variable"] == {"x", "f", "t", "ep"} and found["parameter"] == {"x", "f"}
    assert found["function"] == {"after", "limit"} and found["method"] == {"inside"}
    assert found["macro"] == {"ctrl", "fill"} and found["decorator"] >= {"@var", "@const", "@episode"}
    assert found["property"] >= {"bound", "unit", "max_steps"} and "10" in found["number"]
    some = types.Range(tank.at("HP ctrl"), tank.at("HP fill"))
    part = tank.ask("semantic_tokens_range", types.SemanticTokensRangeParams(tank.identifier, some)).data
    assert 0 < len(part) < 300 and part[0] == tank.at("HP ctrl").line


@pytest.mark.parametrize("path", quick_among(EXAMPLES, EXAMPLES[::5]), ids=lambda path: path.stem)
def test_in_the_end_an_editor_shows_what_check_says(editor: Editor, path: Path) -> None:
    file = editor.read(path)
    wanted = sorted(d.code for d in diagnostics_of(str(path), {}, False))
    file.until(lambda found: sorted(str(d.code) for d in found) == wanted)
    file.close()


# ---------------------------------------------------------------- what is typed


def typed(file: File, slip: Slip, pause: float) -> None:
    """Type a slip key by key in place of what was there."""
    before, after = file.text.split(slip.there)
    for k in range(len(slip.typed) + 1):
        time.sleep(pause)
        file.change(before + slip.typed[:k] + after)


def mistaken_and_mended(file: File, slip: Slip, pause: float) -> tuple[float, float]:
    """The seconds after the last key until a slip is told, and until it is cleared when it is mended."""
    right = file.text
    typed(file, slip, pause)
    told = file.until(lambda found: slip.code in {d.code for d in found})
    file.change(right)
    return told, file.until(lambda found: slip.code not in {d.code for d in found})


@pytest.mark.parametrize(
    "slip", quick_among(SLIPS, SLIPS[::3]), ids=lambda slip: slip.typed.strip().replace(" ", "_")
)
def test_a_slip_is_told_and_cleared(tank: File, slip: Slip) -> None:
    """In the time of twenty analyses at the most, on any machine."""
    begun = time.perf_counter()
    for k in range(5):
        analyse(Source("model.kyx", f"{MODEL}{' ' * k}"), Options())
    each = (time.perf_counter() - begun) / 5
    assert max(mistaken_and_mended(tank, slip, 0.01)) <= max(PROMPT, 20 * each)


@pytest.mark.slow
def test_slips_are_told_at_once(tank: File) -> None:
    times = [t for slip in SLIPS for _ in range(5) for t in mistaken_and_mended(tank, slip, 0.03)]
    times.sort()
    print(f"after the last key: median {times[len(times) // 2]:.3f} s, longest {times[-1]:.3f} s")
    assert times[int(len(times) * 0.99)] <= PROMPT


def test_questions_are_answered_while_a_text_is_broken(tank: File) -> None:
    tank.change(MODEL.replace("x + f * ep;", "x + f * ;").replace("/* @var: bound=[-1:1]", "/* @"))
    assert "Bool inside" in tank.hover(tank.at("inside(x) & ep"))
    assert "level" in tank.hover(tank.at("x := ") if "x := " in tank.text else tank.at("{x' = f", 1))
    assert {"ctrl", "inside", "x", "f"} <= {*tank.completions(tank.at("t := 0; fill"))}
    assert [*KNOWN] == [label[1:] for label in tank.completions(tank.at("/* @", 4))][: len(KNOWN)]
    found = tank.ask("document_symbol", types.DocumentSymbolParams(tank.identifier))
    assert {"ctrl", "fill", "x"} <= {child.name for child in found[0].children}


def test_warnings_that_need_a_solver_come_and_go(tank: File) -> None:
    right = tank.text
    tank.change(right.replace("?x > 0;", "?x > 0 & x < 0;"))
    tank.until(lambda found: {d.code for d in found} & {"dead-alternative", "constant-test"} != set())
    tank.change(right)
    tank.until(lambda found: not found)
