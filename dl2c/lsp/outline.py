"""The parts of a file: what an editor lists, and what it can fold."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from dl2c.lsp.analysis import Analysis
from dl2c.lsp.names import EntryNames
from dl2c.parse.scan import Code
from dl2c.parse.sections import is_bare

PartKind: TypeAlias = Literal["entry", "variable", "constant", "function", "predicate", "program", "problem"]

_BRACES = re.compile(r"[{}]")
_STATEMENT_END = re.compile(r";")


@dataclass(frozen=True, slots=True)
class Part:
    """`start` to `end` is all of it, `name_start` to `name_end` its name. `detail` is more about it."""

    kind: PartKind
    name: str
    detail: str
    start: int
    end: int
    name_start: int
    name_end: int
    parts: tuple["Part", ...] = ()


@dataclass(frozen=True, slots=True)
class Fold:
    """A range that can be folded; `comment` tells comments from code."""

    start: int
    end: int
    comment: bool = False


def parts(analysis: Analysis) -> tuple[Part, ...]:
    """The entries with what each declares; what a file without an entry declares by itself."""
    found = [*_shared(analysis)]
    for entry in analysis.names.entries:
        span = entry.entry.span
        own = tuple(_declared(analysis, entry, span.start, span.end))
        head = next((s for s in analysis.sections if s.kind == "entry" and s.start == span.start), None)
        if head is None or is_bare(head):
            found += own
        else:
            name = entry.entry.name or head.word
            found.append(
                Part("entry", name, entry.entry.kind, span.start, span.end, head.start, head.end, own)
            )
    return tuple(found)


def _shared(analysis: Analysis) -> Iterator[Part]:
    """What stands before the first entry."""
    if analysis.names.entries:
        first = analysis.names.entries[0]
        yield from _declared(analysis, first, 0, first.entry.span.start)


def _declared(analysis: Analysis, entry: EntryNames, begin: int, end: int) -> Iterator[Part]:
    code = analysis.code
    assert code is not None
    for declaration in (*entry.entry.definitions, *entry.entry.variables):
        span = declaration.span
        if not begin <= span.start < end or span.text != declaration.name:
            continue
        kind = entry.scope[declaration.name].kind
        kind = "function" if kind == "library" else kind
        assert kind not in ("parameter", "quantified")
        start = code.text.rfind("\n", 0, span.start) + 1
        start += len(code.text[start : span.start]) - len(code.text[start : span.start].lstrip())
        last = span.end if declaration.body is None else max(span.end, declaration.body.span.end)
        stop = _STATEMENT_END.search(code.text, last)
        parameters = ", ".join(p.name for p in declaration.parameters or ())
        detail = kind + (f" of {parameters}" if parameters else "")
        whole = max(
            last, stop.end() if stop and not code.text[last : stop.start()].strip(" \t\n})") else last
        )
        yield Part(kind, declaration.name, detail, min(start, span.start), whole, span.start, span.end)
    for s in analysis.sections:
        if s.kind == "Problem" and begin <= s.start < end:
            yield Part("problem", "Problem", "", s.start, s.over, s.start, s.start + len(s.word))


def folds(analysis: Analysis) -> tuple[Fold, ...]:
    """Entries, sections, blocks in braces, and comments, of several lines each."""
    code = analysis.code
    if code is None:
        return ()
    found = [Fold(s.start, s.over) for s in analysis.sections if s.kind not in ("entry", "End")]
    found += (Fold(e.span.start, e.span.end) for e in analysis.entries)
    found += _blocks(code)
    found += _comments(code)
    text = analysis.source.text
    return tuple(f for f in sorted(found, key=lambda f: (f.start, -f.end)) if "\n" in text[f.start : f.end])


def _blocks(code: Code) -> Iterator[Fold]:
    opened: list[int] = []
    for brace in _BRACES.finditer(code.text):
        if brace.group() == "{":
            opened.append(brace.start())
        elif opened:
            yield Fold(opened.pop(), brace.end())


def _comments(code: Code) -> Iterator[Fold]:
    """Block comments, and `//` comments in neighbouring lines."""
    start = end = -1
    for comment in code.comments:
        span = comment.span
        between = code.source.text[end : span.start] if end >= 0 else ""
        if not (comment.line and end >= 0 and not between.strip() and between.count("\n") == 1):
            if end > start:
                yield Fold(start, end, comment=True)
            start = span.start
        end = span.end if comment.line else -1
        if not comment.line:
            yield Fold(span.start, span.end, comment=True)
    if end > start:
        yield Fold(start, end, comment=True)
