"""What may be typed at a place: annotations, their attributes and values, names, keywords, snippets."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from dl2c.ir.functions import KYX_MATH
from dl2c.ir.scene import FORMS
from dl2c.lsp import words
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.context import comment_before, section_at, word_before
from dl2c.lsp.names import EntryNames, Kind, Symbol
from dl2c.parse.comments import KNOWN
from dl2c.parse.sections import Section

ItemKind: TypeAlias = Kind | Literal["annotation", "attribute", "value", "keyword", "snippet"]

IN_PROGRAMS = ("true", "false", "if", "else")
IN_DEFINITIONS = ("Real", "Bool", "HP", "implicit", "import")


@dataclass(frozen=True, slots=True)
class Item:
    """`text` is what is written: a snippet, with `$1` for places to fill in, where `fill` says so."""

    label: str
    kind: ItemKind
    detail: str = ""
    text: str = ""
    fill: bool = False


def completions(analysis: Analysis, text: str, at: int, known: int) -> tuple[int, tuple[Item, ...]]:
    """Where the word begins that is completed, and what it may become.

    `text` is the text now, `at` the place in it; `known` is that place in the text of the analysis, which may
    be an earlier one.
    """
    word = word_before(text, at)
    start = at - len(word)
    comment = comment_before(text, at)
    if comment is None:
        start = at - len(word.rpartition("-")[2])
        return start, tuple(dict.fromkeys(_code(analysis, text, start, known)))
    if comment.annotation is None:
        return start, ()
    if not comment.named:
        return at - len(comment.annotation) - 1, tuple(_annotations())
    if comment.annotation == "scene":
        shapes = (Item(shape, "attribute", "a shape", f"{shape}($1)", fill=True) for shape in FORMS)
        return start, tuple(dict.fromkeys((*shapes, *_names(analysis, known, programs=False))))
    if comment.attribute is None:
        return start, tuple(_attributes(comment.annotation))
    if words.is_expression(comment.attribute):
        return start, tuple(dict.fromkeys(_names(analysis, known, programs=False)))
    values = words.values(comment.annotation, comment.attribute)
    return start, tuple(Item(value, "value", text=value) for value in values)


def _annotations() -> Iterator[Item]:
    for name in KNOWN:
        colon = ": " if words.attributes(name) else ""
        yield Item(f"@{name}", "annotation", words.ANNOTATIONS.get(name, ""), f"@{name}{colon}")


def _attributes(annotation: str) -> Iterator[Item]:
    for name in words.attributes(annotation):
        about = words.meaning(annotation, name).replace("`", "")
        yield Item(name, "attribute", about, words.begun(annotation, name), fill=True)


def _code(analysis: Analysis, text: str, start: int, known: int) -> Iterator[Item]:
    section = section_at(analysis.sections, known)
    kind = section.kind if section is not None else ""
    first = _first_in_statement(text, start)
    match kind:
        case "Tactic":
            return
        case "ProgramVariables":
            yield Item("Real", "keyword", words.KEYWORDS["Real"], "Real ")
            yield from _snippets("variables")
        case "Definitions" if first:
            yield from (Item(word, "keyword", words.KEYWORDS[word], f"{word} ") for word in IN_DEFINITIONS)
            yield from _snippets("definitions")
        case "Definitions" | "Problem":
            yield from _names(analysis, known)
            yield from (Item(word, "keyword", words.KEYWORDS[word], word) for word in IN_PROGRAMS)
            yield from _snippets("program")
        case _:
            yield from _snippets("entry" if analysis.names.entries else "file")
            yield from _headings(analysis, section)


def _first_in_statement(text: str, start: int) -> bool:
    """Whether a declaration begins here: behind `;`, the word of the section, or a comment, first in its line
    and not inside braces.
    """
    before = text[text.rfind("\n", 0, start) + 1 : start]
    if before.strip():
        return False
    line = text.rfind("Definitions", 0, start)
    inside = text[line:start]
    return inside.count("{") == inside.count("}") and inside.count("(") == inside.count(")")


def _headings(analysis: Analysis, section: Section | None) -> Iterator[Item]:
    for word in ("ArchiveEntry", "Theorem", "Lemma", "Definitions", "ProgramVariables", "Problem"):
        yield Item(word, "keyword", words.KEYWORDS[word], word)
    yield Item("End.", "keyword", words.KEYWORDS["End"], "End.")


def _snippets(place: words.Place) -> Iterator[Item]:
    for snippet in words.SNIPPETS:
        if place in snippet.places:
            yield Item(snippet.label, "snippet", snippet.meaning, snippet.text, fill=True)


def _names(analysis: Analysis, known: int, *, programs: bool = True) -> Iterator[Item]:
    """The names in scope, local ones first, and those of the library."""
    entry = analysis.names.entry_at(known)
    if entry is None:
        return
    yield from (_named(symbol) for symbol in _local(entry, known))
    for symbol in entry.scope.values():
        if programs or symbol.kind != "program":
            yield _named(symbol)
    for name, arity in KYX_MATH.items():
        if name not in entry.scope:
            yield Item(
                name, "library", "library kyx.math", f"{name}($1)" if arity else name, fill=bool(arity)
            )


def _local(entry: EntryNames, known: int) -> Iterator[Symbol]:
    """The names with a scope of their own of the last declaration before a place, if that is near."""
    before = [o for o in entry.occurrences if o.start <= known and o.use == "declared"]
    last = max(before, key=lambda o: o.start, default=None)
    if last is not None:
        yield from last.local.values()


def _named(symbol: Symbol) -> Item:
    declaration = symbol.declaration
    if declaration is None:
        return Item(symbol.name, symbol.kind, symbol.kind, symbol.name)
    parameters = ", ".join(p.name for p in declaration.parameters or ())
    detail = f"{symbol.kind} of {parameters}" if parameters else symbol.kind
    if symbol.kind == "program":
        return Item(symbol.name, "program", detail, f"{symbol.name};")
    if declaration.parameters is None:
        return Item(symbol.name, symbol.kind, detail, symbol.name)
    filled = ", ".join(f"${{{k}:{p.name}}}" for k, p in enumerate(declaration.parameters, 1))
    return Item(symbol.name, symbol.kind, detail, f"{symbol.name}({filled})", fill=bool(parameters))
