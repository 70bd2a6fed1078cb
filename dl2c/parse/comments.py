"""Annotations in comments.

In: the comments of a file. Out: raw `Annotation`s, attributes split but values still text. An
annotation starts where `@word` is the first thing in a line of a comment. In a block comment it
goes on to the end of the comment or the next `@word`; in `//` comments it goes on in the next
line while a bracket, a quote or a separator is open. Other comments are ignored.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from dl2c.diagnostics import Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code, Comment
from dl2c.parse.tree import Annotation
from dl2c.source import Source, Span

KNOWN = ("var", "const", "safety", "progress", "stability", "choice", "fallback", "episode", "scene")

PROSE = ("author", "see", "note", "todo", "date", "version", "link", "title", "description", "provable")
"""Tags of documentation, which often have a colon too."""

_WORD = re.compile(r"\s*@(?P<name>[A-Za-z_][A-Za-z0-9_]*)\s*(?P<colon>:?)")
_ATTRIBUTE = re.compile(r"\s*(?P<name>[A-Za-z_][A-Za-z0-9_]*)\s*(?:=\s*(?P<value>.*)|\Z)", re.DOTALL)
_MARKER = re.compile(r"[ \t]*(?://+|/\*+|\*+(?!/))?")


@dataclass(frozen=True, slots=True)
class Line:
    """The text of one line of a comment, at `start` to `end` of the source."""

    source: Source
    comment: Comment
    start: int
    end: int

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]


def read_annotations(code: Code, problems: list[Diagnostic]) -> tuple[Annotation, ...]:
    """All annotations of a file in order; mistakes are appended to `problems`."""
    lines = [line for comment in code.comments for line in _lines(code.source, comment)]
    annotations: list[Annotation] = []
    at = 0
    while at < len(lines):
        word = _WORD.match(lines[at].text)
        size = 1
        if word is not None and _is_annotation(word, lines[at], problems):
            size = _extent(lines, at)
            annotations.append(_annotation(word, lines[at : at + size], problems))
        at += size
    return tuple(annotations)


def visible(span: Span) -> str:
    """The text of a span inside comments, with the comment markers of its later lines blank."""
    first, *later = span.text.split("\n")
    return "\n".join([first, *(_MARKER.sub(lambda m: " " * len(m.group()), line, count=1) for line in later)])


def _lines(source: Source, comment: Comment) -> Iterator[Line]:
    end = comment.span.end - (0 if comment.line else 2)
    start = comment.span.start
    for text in source.text[start:end].split("\n"):
        marker = _MARKER.match(text)
        assert marker is not None
        yield Line(source, comment, start + marker.end(), start + len(text.rstrip("\r")))
        start += len(text) + 1


def _is_annotation(word: re.Match[str], line: Line, problems: list[Diagnostic]) -> bool:
    """Whether `@word` is ours. Tags of prose and KeYmaera X's own `@invariant(...)` are not."""
    name = word.group("name")
    if name in KNOWN:
        return True
    if name not in ("invariant", "variant", *PROSE) and (
        word.group("colon") or get_close_matches(name, KNOWN, cutoff=0.7)
    ):
        start = line.start + word.start("name") - 1
        problems.append(
            errors.unknown_annotation(Span(line.source, start, start + 1 + len(name)), name, KNOWN)
        )
    return False


def _extent(lines: Sequence[Line], first: int) -> int:
    """How many lines, from `first`, belong to the annotation that starts there."""
    at, depth, quoted, last = first, 0, False, ""
    while True:
        before = lines[at]
        depth, quoted = _nesting(before.text, depth, quoted)
        last = before.text.rstrip()[-1:] or last
        at += 1
        if at == len(lines):
            return at - first
        line = lines[at]
        more = depth > 0 or quoted or last in (",", ";", ":", "=")
        if _WORD.match(line.text) and not more:
            return at - first
        if line.comment is not before.comment and not (
            _adjacent(before, line) and (more or re.match(r"\s*[,;]", line.text))
        ):
            return at - first


def _adjacent(before: Line, line: Line) -> bool:
    """Whether two `//` comments stand in neighbouring lines."""
    between = line.source.text[before.comment.span.end : line.comment.span.start]
    return line.comment.line and before.comment.line and between.count("\n") == 1 and not between.strip()


def _nesting(text: str, depth: int = 0, quoted: bool = False) -> tuple[int, bool]:
    """The depth of brackets at the end of `text`, and whether a string is open there."""
    for character in text:
        if character == '"':
            quoted = not quoted
        elif not quoted:
            depth += (character in "([{") - (character in ")]}")
    return depth, quoted


def _annotation(word: re.Match[str], lines: Sequence[Line], problems: list[Diagnostic]) -> Annotation:
    source, name = lines[0].source, word.group("name")
    start, end = lines[0].start + word.start("name") - 1, lines[-1].end
    span = Span(source, start, start + len(source.text[start:end].rstrip()))
    begin = lines[0].start + word.end()
    text = visible(Span(source, begin, end))
    if text.strip() and not word.group("colon"):
        problems.append(errors.no_colon(Span(source, start, begin), name))
    read = _shape if name == "scene" else _attribute
    attributes = [
        attribute
        for first, last in _split(text)
        if (attribute := read(text[first:last], Span(source, begin + first, begin + last), problems))
    ]
    return Annotation(name, tuple(attributes), span=span)


def _split(text: str) -> Iterator[tuple[int, int]]:
    """The ranges between separators that stand outside brackets and quotes; blank ones are left out."""
    start, depth, quoted = 0, 0, False
    for at, character in enumerate(text + ";"):
        if character == '"':
            quoted = not quoted
        elif not quoted:
            depth += (character in "([{") - (character in ")]}")
        if at == len(text) or (character in ",;" and depth <= 0 and not quoted):
            if text[start:at].strip():
                yield start, at
            start = at + 1


def _shape(text: str, span: Span, problems: list[Diagnostic]) -> tuple[str, str, Span] | None:
    """A shape as an attribute without a value, whose name is all of it."""
    trimmed = _trimmed(text, span)
    if _nesting(text) != (0, False):
        problems.append(errors.unbalanced_value(trimmed))
        return None
    return " ".join(text.split()), "", trimmed


def _trimmed(text: str, span: Span) -> Span:
    """The span of a text without the blanks around it."""
    blank = len(text) - len(text.lstrip())
    return Span(span.source, span.start + blank, span.start + len(text.rstrip()))


def parts_of(span: Span) -> tuple[Span, ...]:
    """What separators divide a span inside comments into, without the blanks around."""
    text = visible(span)
    return tuple(
        _trimmed(text[first:last], Span(span.source, span.start + first, span.start + last))
        for first, last in _split(text)
    )


def _attribute(text: str, span: Span, problems: list[Diagnostic]) -> tuple[str, str, Span] | None:
    """(attribute, value text, span of the value); without `=` the value is empty."""
    found = _ATTRIBUTE.match(text.rstrip())
    trimmed = _trimmed(text, span)
    if found is None:
        problems.append(errors.malformed_attribute(trimmed))
        return None
    if _nesting(text) != (0, False):
        problems.append(errors.unbalanced_value(trimmed))
        return None
    if not found.group("value"):
        return found.group("name"), "", trimmed
    start, end = found.span("value")
    return (
        found.group("name"),
        " ".join(found.group("value").split()),
        Span(span.source, span.start + start, span.start + end),
    )
