"""The sections of an archive file.

In: code in either dialect. Out: its sections in order, found by the reserved words that begin
and end them. What stands between sections is checked here: metadata only. The dialect of
KeYmaera X 4 is warned about at its first sign: block headers and declarations that end with `.`, sorts
`R B P T F`, `Functions`, `SharedDefinitions`, names of entries that end with `.`, files without an entry.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from pathlib import PurePath
from typing import Literal, TypeAlias

from dl2c.diagnostics import Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.source import Span

Kind: TypeAlias = Literal["Definitions", "ProgramVariables", "Problem", "Tactic", "entry", "End"]
_BLOCKS: dict[str, Kind] = {
    "Definitions": "Definitions",
    "SharedDefinitions": "Definitions",
    "Functions": "Definitions",
    "ProgramVariables": "ProgramVariables",
    "Variables": "ProgramVariables",
    "Problem": "Problem",
    "Tactic": "Tactic",
}

_ENTRIES = ("ArchiveEntry", "Theorem", "Lemma", "Exercise")

STRING = r'"(?:[^"\\]|\\.)*"'
_MARK = re.compile(
    rf"{STRING}|(?<![A-Za-z0-9_\\])(?:(?P<block>{'|'.join(_BLOCKS)})(?![A-Za-z0-9_])"
    rf"|(?P<entry>{'|'.join(_ENTRIES)})(?![A-Za-z0-9_])"
    rf"|(?P<end>End(?:\s+(?!(?:End|{'|'.join(_BLOCKS)})(?![A-Za-z0-9_]))[A-Za-z]\w*)?\s*\.)"
    r"|(?P<nearly>(?:End|END)(?:[ \t]*[.;:,])?(?=[ \t]*(?:\n|\Z))|end[ \t]*\.(?=[ \t]*(?:\n|\Z))))",
    re.DOTALL,
)
_MAYBE_MARK = re.compile('"|' + "|".join([*_BLOCKS, *_ENTRIES, "End", "END", "end"]))
"""Where a mark may begin. `re` looks for these fast, and slowly for groups and conditions."""
_WORD = re.compile(r"\s*(?P<word>[A-Za-z]\w*)[ \t]*:?")
_META = re.compile(
    rf"\s*(?:(?:Description|Title|Link|Author|See|Illustration|Citation)\s+{STRING}\s*\.\s*)*", re.DOTALL
)
_PACKAGE = re.compile(r"\s*(?:package\s+[A-Za-z]\w*(?:\.[A-Za-z]\w*)*)?\s*")
_ENTRY_NAME = re.compile(rf"\s*(?:[A-Za-z]\w*\s*:)?\s*(?P<name>{STRING})(?:\s*\.)?", re.DOTALL)
_UNQUOTED_NAME = re.compile(r"[ \t]*[^\s\"]+(?=[ \t]*\.?[ \t]*(?:\n|\Z))")
_HEADER_END = re.compile(r"\s*[.;]")


@dataclass(frozen=True, slots=True)
class Section:
    """A section: its `word` at `start`, its text from `begin` to `end`, and where it is `over`.

    `Definitions` and the like are over after their `End.`; `entry` is the word that opens an
    entry with its name and metadata; `End` is the entry's own `End.`.
    """

    kind: Kind
    word: str
    start: int
    begin: int
    end: int
    over: int


def find_sections(code: Code, problems: list[Diagnostic]) -> list[Section]:
    """All sections in order; mistakes are appended to `problems`."""
    marks = [m for m in _marks(code.text) if m.lastgroup is not None and _is_mark(code, m)]
    problems.extend(errors.misspelt_end(code.span(*m.span())) for m in marks if m.lastgroup == "nearly")
    sections: list[Section] = []
    at = 0
    for mark, following in pairwise([*marks, None]):
        assert mark is not None
        if mark.start() < at:
            continue
        if _ends(mark) and sections and (misspelt := _misspelt(code, at, mark, problems)):
            sections.append(misspelt)
        else:
            _check_between(code, at, mark.start(), bool(sections), problems)
            sections.append(_section(code, mark, following, problems))
        at = sections[-1].over
    _check_between(code, at, len(code.text), bool(sections), problems)
    return sections


def _marks(text: str) -> Iterator[re.Match[str]]:
    """Reserved words, and strings, in which there are none."""
    at = 0
    while place := _MAYBE_MARK.search(text, at):
        mark = _MARK.match(text, place.start())
        at = (mark or place).end()
        if mark is not None:
            yield mark


def _is_mark(code: Code, mark: re.Match[str]) -> bool:
    """What is nearly `End.` counts where it has a line of its own."""
    return mark.lastgroup != "nearly" or first_in_line(code, mark.start())


def _ends(mark: re.Match[str]) -> bool:
    return mark.lastgroup in ("end", "nearly")


def _misspelt(code: Code, start: int, end: re.Match[str], problems: list[Diagnostic]) -> Section | None:
    """The section whose word is misspelt, `definitions` or `Definition`, and that `end` ends."""
    word = _WORD.match(code.text, start, end.start())
    if word is None:
        return None
    known = {block.lower(): block for block in _BLOCKS}
    close = get_close_matches(word.group("word").lower(), known, n=1, cutoff=0.8)
    if not close:
        return None
    block = known[close[0]]
    span = code.span(*word.span("word"))
    problems.append(errors.misspelt_section(span, block))
    return Section(_BLOCKS[block], block, span.start, word.end(), end.start(), end.end())


def _section(
    code: Code, mark: re.Match[str], following: re.Match[str] | None, problems: list[Diagnostic]
) -> Section:
    word, start, begin = mark.group(), mark.start(), mark.end()
    end = following.start() if following is not None else len(code.text)
    if _ends(mark):
        return Section("End", word, start, begin, begin, begin)
    if mark.lastgroup == "entry":
        name = _ENTRY_NAME.match(code.text, begin, end) or _UNQUOTED_NAME.match(code.text, begin, end)
        over = name.end() if name is not None else begin
        return Section("entry", word, start, begin, over, over)
    kind = _BLOCKS[word]
    if dot := _HEADER_END.match(code.text, begin, end):
        begin = dot.end()
    if following is not None and _ends(following):
        return Section(kind, word, start, begin, end, following.end())
    found = "the end of the file" if following is None else f"`{following.group()}`"
    problems.append(errors.section_not_ended(code.span(start, begin), word, found))
    return Section(kind, word, start, begin, end, end)


def bare_entry() -> Section:
    """The head of the one entry of a file that has none: empty, where the file begins."""
    return Section("entry", "ArchiveEntry", 0, 0, 0, 0)


def is_bare(head: Section) -> bool:
    return head.start == head.begin


def entry_name(code: Code, head: Section, problems: list[Diagnostic]) -> str:
    """The name in quotes after the word that opens an entry; a bare entry is named after its file."""
    if is_bare(head):
        return PurePath(code.source.name).stem
    name = _ENTRY_NAME.match(code.text, head.begin, head.end)
    if name is None:
        unquoted = code.text[head.begin : head.end].strip()
        problems.append(errors.no_name(code.span(head.start, head.end), head.word, unquoted))
        return ""
    return re.sub(r"\\(.)", r"\1", name.group("name")[1:-1])


def _check_between(code: Code, start: int, end: int, inside: bool, problems: list[Diagnostic]) -> None:
    """Metadata may stand between sections, a package name before the first."""
    allowed = (_META if inside else _PACKAGE).match(code.text, start, end)
    stop = allowed.end() if allowed is not None else start
    if stop < end:
        wanted = "a section such as Definitions or Problem, or `End.`" if inside else "`ArchiveEntry`"
        problems.append(errors.misplaced_text(first_word(code, stop, end), wanted))


def first_word(code: Code, start: int, end: int) -> Span:
    """The first word of a range that is not blank."""
    word = re.compile(r"\S+").search(code.text, start, end)
    assert word is not None
    return code.span(*word.span())


def first_in_line(code: Code, at: int) -> bool:
    """Whether only blanks stand before `at` in its line."""
    while at > 0 and code.text[at - 1] in " \t":
        at -= 1
    return at == 0 or code.text[at - 1] == "\n"


def previous_characters(code: Code, begin: int, at: int, count: int) -> str:
    """The last `count` characters before `at` that blanks do not follow."""
    while at > begin and code.text[at - 1].isspace():
        at -= 1
    return code.text[max(begin, at - count) : at]


def trimmed_end(code: Code, start: int, end: int) -> int:
    """The end of a range without the blanks at its end."""
    return start + len(code.text[start:end].rstrip())


OLD_SORT = r"[RBPTF](?=\s+[A-Za-z])"
"""A sort of this dialect, where a declaration may begin; also a legal name elsewhere."""


def _word(*words: str, after: str = "") -> str:
    """A pattern of whole words; none begins after a backslash or one of `after`. Each alternative begins with
    a letter: `re` looks for those fast, and slowly for a condition on what is before.
    """
    found = (rf"{w[0]}(?<![A-Za-z0-9_\\{after}]{w[0]}){w[1:]}" for w in words)
    return f"(?:{'|'.join(found)})(?![A-Za-z0-9_])"


_NEW_BLOCKS = ("Definitions", "ProgramVariables", "Problem")
_ENTRY = _word(*_ENTRIES)
_SIGNS = (
    (_word("Functions", "Variables", "SharedDefinitions"), "renamed since"),
    (rf"{_word(*_NEW_BLOCKS)}\s*[.;]", "no `.` or `;` follows a section word now"),
    (rf"{_ENTRY}\s+\0+\s*\.", "no `.` follows the name now"),
    (
        rf"(?:;|\.|D(?<=\bD)efinitions|P(?<=\bP)rogramVariables)\s*(?P<sign>{OLD_SORT})",
        "sorts are `Real`, `Bool`, `HP` now",
    ),
    (rf"{_word('Real', 'Bool', 'HP', after='(,')}\s+[A-Za-z]\w*\s*\.", "declarations end with `;` now"),
)


def sign_of_old_dialect(code: Code) -> Diagnostic | None:
    """The warning at the first sign of the old dialect, if there is one."""
    text = re.sub(STRING, lambda s: "\0" * len(s.group()), code.text, flags=re.DOTALL)
    found = [(m, why) for pattern, why in _SIGNS if (m := re.search(pattern, text))]
    if not re.search(_ENTRY, text) and (m := re.search(_word(*_NEW_BLOCKS), text)):
        found.append((m, 'a model starts with `ArchiveEntry "Name"` now'))
    if not found:
        return None
    match, why = min(found, key=lambda pair: pair[0].start())
    start = match.start(match.lastgroup or 0)
    return errors.old_dialect(code.span(start, match.end()), why)
