"""What is written at a place of a text that is being typed: which annotation, section or entry.

In: the text as it is at this moment, and a place. Only the text is looked at, so the answer is right while
nothing around the place can be parsed.
"""

import re
from bisect import bisect_right
from dataclasses import dataclass

from dl2c.lsp.positions import UNCHANGED, Shift
from dl2c.parse.sections import Section

_ANNOTATION = re.compile(r"(?:^|\n)[ \t]*(?://+|/\*+|\*+(?!/))?[ \t]*@(?P<name>\w*)[ \t]*(?P<colon>:?)")
_KEY = re.compile(r"\s*(?P<key>[A-Za-z_]\w*)?\s*(?P<equals>=)?", re.ASCII)
_WORD = re.compile(r"[A-Za-z_][\w-]*\Z", re.ASCII)
_ENTRY = re.compile(r"^[ \t]*(?:ArchiveEntry|Theorem|Lemma|Exercise)(?![A-Za-z0-9_])", re.MULTILINE)
_TACTIC = re.compile(r"^[ \t]*Tactic(?![A-Za-z0-9_])", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Comment:
    """The text of a comment up to a place. `annotation` is the one that goes on there: None in prose, and
    with an empty `name` right after `@`. `attribute` is None where an attribute's name is expected.
    """

    annotation: str | None
    named: bool = False
    attribute: str | None = None


def comment_before(text: str, at: int) -> Comment | None:
    """What the comment around a place says before it; None outside of comments."""
    begun = _begin(text, at)
    if begun is None:
        return None
    before = text[begun:at]
    found = list(_ANNOTATION.finditer(before))
    if not found:
        return Comment(None)
    last = found[-1]
    if not last.group("colon"):
        return Comment(last.group("name") if last.end() == len(before) else None)
    part = _last_part(before[last.end() :])
    key = _KEY.match(part)
    assert key is not None
    return Comment(last.group("name"), True, key.group("key") if key.group("equals") else None)


def _begin(text: str, at: int) -> int | None:
    """Where the comment around a place begins: `//` comments in neighbouring lines are one."""
    opened, closed = text.rfind("/*", 0, at), text.rfind("*/", 0, at)
    if opened >= 0 and opened + 2 <= at and closed < opened + 2:
        return opened
    begin: int | None = None
    end = at
    while True:
        line = text.rfind("\n", 0, end) + 1
        mark = text.find("//", line, end)
        if mark < 0 or (begin is not None and text[line:mark].strip()):
            return begin
        begin, end = mark, max(0, line - 1)
        if line == 0:
            return begin


def _last_part(text: str) -> str:
    """What follows the last separator outside of brackets and quotes."""
    start, depth, quoted = 0, 0, False
    for at, character in enumerate(text):
        if character == '"':
            quoted = not quoted
        elif not quoted:
            depth += (character in "([{") - (character in ")]}")
            if character in ",;" and depth <= 0:
                start = at + 1
    return text[start:]


def word_before(text: str, at: int) -> str:
    """The part of a word, or of a code with `-`, that ends at a place."""
    found = _WORD.search(text, max(0, at - 100), at)
    return found.group() if found else ""


def section_at(sections: tuple[Section, ...], at: int) -> Section | None:
    """The section around a place, if there is one."""
    around = [s for s in sections if s.begin <= at <= s.end and s.kind not in ("entry", "End")]
    return around[-1] if around else None


def nearby(text: str, at: int) -> tuple[str, Shift]:
    """What a question about a place needs first, at the same lines, and where that is in the text: the entry
    around the place without its tactics, and what stands before all entries. Words in comments may be taken
    for the beginning of an entry.
    """
    starts = [m.start() for m in _ENTRY.finditer(text)]
    if not starts:
        return text, UNCHANGED
    first = starts[0]
    number = max(0, bisect_right(starts, at) - 1)
    begin, end = starts[number], (*starts, len(text))[number + 1]
    entry = text[begin:end]
    if tactic := _TACTIC.search(entry):
        entry = f"{entry[: tactic.start()]}End.\n"
    lines = text.count("\n", first, begin)
    return text[:first] + "\n" * lines + entry, Shift(first, first + lines, begin - first - lines)
