"""The parts of a file: what an editor lists, and what it can fold."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

from dl2c.lsp.analysis import Analysis
from dl2c.parse.declarations import SORTS
from dl2c.parse.scan import Code
from dl2c.parse.sections import Section, entry_name, trimmed_end

PartKind: TypeAlias = Literal["entry", "variable", "constant", "function", "predicate", "program", "problem"]

_BRACES = re.compile(r"[{}]")
_DECLARED = r"[A-Za-z]\w*(?:\s*\([^()]*\))?"
_DECLARATION = re.compile(
    rf"""\([^()]*\)|(?<!\w)(?P<sort>{"|".join(SORTS)})\s+
    (?P<names>{_DECLARED}(?:\s*,\s*{_DECLARED})*)(?P<value>\s*=)?""",
    re.ASCII | re.VERBOSE,
)
_NAME = re.compile(r"(?P<name>[A-Za-z]\w*)(?:\s*\((?P<parameters>[^()]*)\))?", re.ASCII)


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
    """The entries with what each declares; what a file without an entry declares by itself. Sections tell all
    of this, so that it is known before the text is read.
    """
    code, sections = analysis.code, analysis.sections
    if code is None:
        return ()
    heads = [n for n, section in enumerate(sections) if section.kind == "entry"]
    found = [part for section in sections[: heads[0] if heads else None] for part in _inside(code, section)]
    for n, following in pairwise((*heads, len(sections))):
        head, own = sections[n], sections[n + 1 : following]
        inner = tuple(part for section in own for part in _inside(code, section))
        name, over = entry_name(code, head, []) or head.word, sections[following - 1].over
        found.append(Part("entry", name, head.word, head.start, over, head.start, head.end, inner))
    return tuple(found)


def _inside(code: Code, section: Section) -> Iterator[Part]:
    """The problem, or what a section declares."""
    if section.kind == "Problem":
        word_end = section.start + len(section.word)
        yield Part("problem", "Problem", "", section.start, section.over, section.start, word_end)
    if section.kind not in ("Definitions", "ProgramVariables"):
        return
    found = [d for d in _DECLARATION.finditer(code.text, section.begin, section.end) if d["sort"]]
    for statement, end in zip(found, [*(d.start() for d in found[1:]), section.end], strict=False):
        for name in _NAME.finditer(code.text, *statement.span("names")):
            parameters = tuple(_parameters(name["parameters"] or ""))
            kind = _kind(section, statement["sort"], bool(parameters or statement["value"]))
            detail = f"{kind} of {', '.join(parameters)}" if parameters else kind
            over = trimmed_end(code, statement.start(), end)
            yield Part(kind, name["name"], detail, statement.start(), over, *name.span("name"))


def _parameters(text: str) -> Iterator[str]:
    """Their names; the dialect of KeYmaera X 4 gives sorts alone."""
    for place, written in enumerate(text.split(",") if text.strip() else (), 1):
        words = written.split()
        yield words[-1] if len(words) > 1 else f"x{place}"


def _kind(section: Section, sort: str, known: bool) -> PartKind:
    """`known` says whether a value is not free: it is given, or depends on parameters."""
    if section.kind == "ProgramVariables":
        return "variable"
    match SORTS[sort]:
        case "Real":
            return "function" if known else "constant"
        case "Bool":
            return "predicate"
        case "HP":
            return "program"


def folds(analysis: Analysis) -> tuple[Fold, ...]:
    """Entries, sections, blocks in braces, and comments, of several lines each."""
    code = analysis.code
    if code is None:
        return ()
    found = [Fold(s.start, s.over) for s in analysis.sections if s.kind not in ("entry", "End")]
    found += (Fold(p.start, p.end) for p in parts(analysis) if p.kind == "entry")
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
