"""Questions about a long file that has just been opened: the entry around the place is read first."""

import time
from collections.abc import Iterator

import pytest
from lsp_editor import Editor
from lsp_mistakes import MODEL
from lsprotocol import types

from dl2c.lsp.analysis import Analysis, analyse
from dl2c.lsp.context import nearby
from dl2c.lsp.hover import hover
from dl2c.options import Options
from dl2c.source import Source

SHARED = "SharedDefinitions\n  Real half(Real r) = r / 2;\nEnd.\n\n"
USED = "Real limit = half(20);"
TACTIC = 'Tactic "Scripted"\n  implyR(1) ; auto\nEnd.\n\nEnd.'
"""What an entry may end with."""


def archive(count: int) -> str:
    one = MODEL.replace("Real limit = 10;", USED)
    with_tactic = one[: one.rindex("End.")] + TACTIC + one[one.rindex("End.") + 4 :]
    entries = [
        (with_tactic if n % 2 else one).replace('"Tank"', f'"Tank {n}"').replace("inside", f"inside{n}")
        for n in range(count)
    ]
    return SHARED + "\n".join(entries)


def _analysis(text: str) -> Analysis:
    return analyse(Source("model.kyx", text), Options())


def test_a_part_says_what_the_whole_says() -> None:
    """Of every name but of those that all entries share, where it is used besides."""
    text = archive(3)
    whole = _analysis(text)
    assert whole.readable and not [d for d in whole.diagnostics if d.severity == "error"]
    assert {o.symbol.name for o in whole.names.occurrences} >= {"half", "limit", "inside0", "inside2"}
    for occurrence in whole.names.occurrences:
        part, shift = nearby(text, occurrence.start)
        assert len(part) < len(text) / 2
        analysis, at = _analysis(part), shift.earlier(occurrence.start)
        (found,) = {o.start: o for o in analysis.names.at(at)}.values()
        assert shift.later(found.start, found.end) == (occurrence.start, occurrence.end)
        assert found.symbol.kind == occurrence.symbol.kind
        expected, said = hover(whole, occurrence.start), hover(analysis, at)
        assert expected is not None and said is not None and said[0] == expected[0]
        if (place := occurrence.symbol.place) is not None and place.start > len(SHARED):
            starts = [shift.later(o.start, o.end)[0] for o in analysis.names.of(found.symbol)]
            assert starts == [o.start for o in whole.names.of(occurrence.symbol)]


@pytest.mark.parametrize(
    "text", ["", "x", MODEL, SHARED, "\n\n" + MODEL, "// Theorem\nTheorem", "Tactic\nTheorem"]
)
def test_any_text_has_a_part(text: str) -> None:
    for at in range(len(text) + 1):
        part, shift = nearby(text, at)
        before, between, entry = part[: shift.start], part[shift.start : shift.end], part[shift.end :]
        assert before == text[: shift.start] and not between.strip("\n")
        assert text.startswith(entry.removesuffix("End.\n"), shift.end + shift.longer)


@pytest.fixture
def editor() -> Iterator[Editor]:
    editor = Editor()
    yield editor
    assert editor.messages == [] and editor.end() == 0


def test_the_first_answers_come_before_the_file_is_read(editor: Editor) -> None:
    text = archive(120)
    file = editor.open(text, "archive.kyx")
    position = file.at("inside77", 2)
    said, places = file.hover(position), file.definitions(position)
    found, offered = file.references(position), file.completions(position)
    early = file.uri not in editor.told
    file.until(lambda found: True)
    while not file.ask("document_symbol", types.DocumentSymbolParams(file.identifier)):
        time.sleep(0.01)
    assert early
    assert said == file.hover(position) and places == file.definitions(position)
    assert found == file.references(position) and len(found) > 3
    assert "inside77" in offered and "inside76" not in offered
    assert len(file.references(file.at("half"))) == 121
