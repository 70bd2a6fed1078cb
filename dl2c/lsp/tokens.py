"""What each word of a text is, for colours."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

from dl2c.lsp import words
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.names import Kind
from dl2c.parse.comments import KNOWN
from dl2c.parse.sections import Section

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


class Token(NamedTuple):
    """A range of one line. `kind` is one of `KINDS`; `modifiers` are bits, in the order of `MODIFIERS`."""

    start: int
    end: int
    kind: str
    modifiers: int = 0


_KNOWN: WeakKeyDictionary[Analysis, tuple[Token, ...]] = WeakKeyDictionary()


def all_tokens(analysis: Analysis) -> tuple[Token, ...]:
    """The words of the whole text, found once: after a change they are asked of the analysis before it."""
    found = _KNOWN.get(analysis)
    if found is None:
        found = _KNOWN[analysis] = tokens(analysis)
    return found


def tokens(analysis: Analysis, begin: int = 0, end: int | None = None) -> tuple[Token, ...]:
    """The words between two places, in order; none where the text cannot be scanned."""
    code = analysis.code
    if code is None:
        return ()
    stop = len(code.text) if end is None else end
    found: dict[int, Token] = {}
    for first, last in _without_tactics(analysis.sections, begin, stop):
        _plain(code.text, first, last, found)
    for comment in code.comments:
        if comment.span.start < stop and begin < comment.span.end:
            _comment(analysis.source.text, comment.span.start, comment.span.end, found)
    for o in analysis.names.occurrences:
        if begin <= o.start < stop:
            bits = 1 * (o.use == "declared") | 2 * (o.symbol.kind == "constant")
            bits |= 4 * (o.symbol.kind == "library") | 8 * (o.use == "written")
            found[o.start] = Token(o.start, o.end, _OF[o.symbol.kind], bits)
    return tuple(_apart(sorted(found.values())))


def _without_tactics(sections: Sequence[Section], begin: int, end: int) -> Iterator[tuple[int, int]]:
    """A range without the tactics in it, which are blank and may be long."""
    for section in sections:
        if section.kind == "Tactic" and begin < section.end and section.begin < end:
            yield begin, max(begin, section.begin)
            begin = max(begin, section.end)
    yield begin, max(begin, end)


def _apart(found: Iterable[Token]) -> Iterator[Token]:
    """Without those that begin inside the one before."""
    end = 0
    for token in found:
        if token.start >= end:
            yield token
            end = token.end


def _plain(text: str, begin: int, end: int, found: dict[int, Token]) -> None:
    for word in _WORD.finditer(text, begin, end):
        kind, (first, last) = word.lastgroup or "", word.span()
        if kind == "keyword" and text[first].isalpha() and word.group().rstrip(".") not in _KEYWORDS:
            continue
        if kind == "string":
            found |= {t.start: t for t in _lines(text, first, last, kind)}
        else:
            found[first] = Token(first, last, kind)


def _comment(text: str, start: int, end: int, found: dict[int, Token]) -> None:
    """A comment without annotations as a whole; of others what is an annotation."""
    marks = list(_ANNOTATION.finditer(text, start, end)) if text.find("@", start, end) >= 0 else []
    if not any(m.lastgroup == "decorator" for m in marks):
        found |= {t.start: t for t in _lines(text, start, end, "comment")}
        return
    found |= {m.start(): Token(m.start(), m.end(), m.lastgroup or "") for m in marks}


def _lines(text: str, start: int, end: int, kind: str) -> Iterator[Token]:
    """A token for each line, as editors ask."""
    while start < end:
        stop = text.find("\n", start, end)
        stop = end if stop < 0 else stop
        if stop > start:
            yield Token(start, stop, kind)
        start = stop + 1
