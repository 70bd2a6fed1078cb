"""What is told of all of a file: its outline before it is read, its colours after it has changed."""

from pathlib import Path

import pytest
from conftest import REPOSITORY
from hypothesis import given
from hypothesis import strategies as st
from lsp_editor import Editor
from lsprotocol import types

from dl2c.lsp import convert
from dl2c.lsp.analysis import analyse, skimmed
from dl2c.lsp.documents import LONG, View
from dl2c.lsp.outline import Part, folds, parts
from dl2c.lsp.positions import Encoding, Lines, Shift
from dl2c.lsp.tokens import all_tokens
from dl2c.options import Options
from dl2c.source import Source

EXAMPLES = sorted(REPOSITORY.glob("examples/*.kyx"))
OLD = """Functions. R A. R f(R). R g(R x) = (x + A). B near(R, R). P ctrl ::= { x := *; ?f(x) > 0; }. End.
ProgramVariables. R x. R y. End.
Problem. x > 0 -> [ctrl;]near(x, y) End."""
MODEL = Source("tank.kyx", (REPOSITORY / "examples" / "watertank.kyx").read_text())
READ = analyse(MODEL, Options())
PIECES = st.sampled_from(["", " ", "\n", "x", "\n\n/* é */", "𝔸", "Real y;", "/* 𝔸𝔸 */ "])


def declared(found: tuple[Part, ...]) -> list[tuple[str, str, str]]:
    return [row for p in found for row in ((p.kind, p.name, p.detail), *declared(p.parts))]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_outline_says_what_a_file_declares(path: Path) -> None:
    source = Source.read(path)
    found = declared(parts(skimmed(source)))
    read = analyse(source, Options())
    names = {
        (str(o.symbol.kind), o.symbol.name)
        for o in read.names.occurrences
        if o.use == "declared" and not o.symbol.local
    }
    assert names == {(kind, name) for kind, name, _ in found if kind not in ("entry", "problem")}
    assert parts(read) == parts(skimmed(source)) and folds(read) == folds(skimmed(source))


def test_an_outline_of_the_old_dialect() -> None:
    assert declared(parts(skimmed(Source("old.key", OLD)))) == [
        ("constant", "A", "constant"),
        ("function", "f", "function of x1"),
        ("function", "g", "function of x"),
        ("predicate", "near", "predicate of x1, x2"),
        ("program", "ctrl", "program"),
        ("variable", "x", "variable"),
        ("variable", "y", "variable"),
        ("problem", "Problem", ""),
    ]


def test_a_declaration_reaches_to_the_next() -> None:
    text = (
        'Theorem "A"\nDefinitions\n  HP c ::= { x := 1; }; // why\n  Real k;\nEnd.\nProblem k > 0 End.\nEnd.'
    )
    (entry,) = parts(skimmed(Source("m.kyx", text)))
    assert [text[p.start : p.end] for p in entry.parts] == [
        "HP c ::= { x := 1; };",
        "Real k;",
        "Problem k > 0 End.",
    ]
    assert text[entry.start : entry.end] == text and text[entry.name_start : entry.name_end] == 'Theorem "A"'


@given(
    st.integers(0, len(MODEL.text)),
    st.integers(0, 40),
    PIECES,
    st.sampled_from(["utf-8", "utf-16", "utf-32"]),
)
def test_colours_of_a_changed_text_are_its_own(at: int, gone: int, put: str, encoding: Encoding) -> None:
    text = MODEL.text[:at] + put + MODEL.text[at + gone :]
    view = View(READ, Lines(text, encoding), Shift.between(MODEL.text, text), ())
    assert convert.all_encoded(view) == convert.encoded(all_tokens(READ), view)


def test_a_long_file_is_outlined_before_it_is_read() -> None:
    """Its colours are those of its words, until more is known; actions are asked again with diagnostics."""
    entry = MODEL.text
    text = "\n".join(entry.replace("Water tank", f"Tank {k}") for k in range(6 * LONG // len(entry)))
    editor = Editor()
    file = editor.open(text, "long.kyx")
    symbols = file.ask("document_symbol", types.DocumentSymbolParams(file.identifier))
    colours = file.ask("semantic_tokens_full", types.SemanticTokensParams(file.identifier))
    actions = file.actions(file.whole)
    early = file.uri not in editor.told
    file.until(lambda found: True)
    assert early and actions == {} and len(colours.data) > 0
    assert symbols == file.ask("document_symbol", types.DocumentSymbolParams(file.identifier))
    later = file.ask("semantic_tokens_full", types.SemanticTokensParams(file.identifier))
    assert len(later.data) > len(colours.data)
    assert editor.messages == [] and editor.end() == 0
