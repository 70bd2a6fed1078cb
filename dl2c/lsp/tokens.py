"""What each word of a text is, for colours."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from dl2c.lsp import words
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.names import Kind
from dl2c.parse.comments import KNOWN

KINDS = (
    *("variable", "parameter", "function", "method", "macro"),
    *("keyword", "number", "string", "operator", "comment", "decorator", "property"),
)
"""Kinds of the protocol: a predicate is a `method`, a program a `macro`."""

MODIFIERS = ("declaration", "readonly", "defaultLibrary", "modification")

_OF: dict[Kind, str] = {
    "variable": "variable",
    "constant": "variable",
    "function": "function",
    "predicate": "method",
    "program": "macro",
    "parameter": "parameter",
    "quantified": "parameter",
    "library": "function",
}
_WORD = re.compile(
    r"""(?P<string>"(?:[^"\\]|\\.)*")
      | (?P<number>(?<![A-Za-z0-9_.])[0-9]+(?:\.[0-9]+)?)
      | (?P<keyword>\\(?:forall|exists)\b|∀|∃|@(?:in)?variant\b|\bEnd\.
        |(?<![A-Za-z0-9_])[A-Za-z]+(?![A-Za-z0-9_]))
      | (?P<operator>:=|::=|<->|->|<-|\+\+|∪|<=|>=|!=|≤|≥|≠|[-+*/^=<>&|!?∧∨→↔])""",
    re.VERBOSE | re.DOTALL,
)
_KEYWORDS = frozenset({*words.KEYWORDS, "R", "B", "P", "T", "F", "Functions", "Variables"})
_ANNOTATION = re.compile(
    rf"(?P<decorator>@(?:{'|'.join(KNOWN)})\b)|(?P<string>\"[^\"\n]*\")|(?P<property>\b[a-z_]+(?==))"
)


@dataclass(frozen=True, slots=True)
class Token:
    """A range of one line. `kind` is one of `KINDS`; `modifiers` are bits, in the order of `MODIFIERS`."""

    start: int
    end: int
    kind: str
    modifiers: int = 0


def tokens(analysis: Analysis, begin: int = 0, end: int | None = None) -> tuple[Token, ...]:
    """The words between two places, in order; none where the text cannot be scanned."""
    code = analysis.code
    if code is None:
        return ()
    stop = len(code.text) if end is None else end
    found = {t.start: t for t in _plain(code.text, begin, stop)}
    for comment in code.comments:
        if comment.span.start < stop and begin < comment.span.end:
            found |= {
                t.start: t for t in _comment(analysis.source.text, comment.span.start, comment.span.end)
            }
    for o in analysis.names.occurrences:
        if begin <= o.start < stop:
            bits = 1 * (o.use == "declared") | 2 * (o.symbol.kind == "constant")
            bits |= 4 * (o.symbol.kind == "library") | 8 * (o.use == "written")
            found[o.start] = Token(o.start, o.end, _OF[o.symbol.kind], bits)
    return tuple(_apart(sorted(found.values(), key=lambda t: t.start)))


def _apart(found: list[Token]) -> Iterator[Token]:
    """Without those that begin inside the one before."""
    end = 0
    for token in found:
        if token.start >= end:
            yield token
            end = token.end


def _plain(text: str, begin: int, end: int) -> Iterator[Token]:
    for word in _WORD.finditer(text, begin, end):
        kind = word.lastgroup
        if kind == "keyword" and word.group().rstrip(".") not in _KEYWORDS and word.group()[0].isalpha():
            continue
        assert kind is not None
        yield from _lines(text, word.start(), word.end(), kind)


def _comment(text: str, start: int, end: int) -> Iterator[Token]:
    """A comment without annotations as a whole; of others what is an annotation."""
    marks = list(_ANNOTATION.finditer(text, start, end))
    if not any(m.lastgroup == "decorator" for m in marks):
        yield from _lines(text, start, end, "comment")
        return
    for mark in marks:
        kind = mark.lastgroup
        assert kind is not None
        yield Token(mark.start(), mark.end(), kind)


def _lines(text: str, start: int, end: int, kind: str) -> Iterator[Token]:
    """A token for each line, as editors ask."""
    while start < end:
        stop = text.find("\n", start, end)
        stop = end if stop < 0 else stop
        if stop > start:
            yield Token(start, stop, kind)
        start = stop + 1
