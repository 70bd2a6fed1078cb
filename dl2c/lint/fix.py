"""What `dl2c check --fix` writes: corrections that do not change what a model means."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dl2c.diagnostics import Diagnostic
from dl2c.lint.edits import Edit, edited
from dl2c.lint.portable import Read, portability, quotients
from dl2c.outputs import write_output
from dl2c.parse import errors
from dl2c.parse.archive import refused_comments
from dl2c.parse.parser import parse_archive
from dl2c.parse.scan import Comment, scan
from dl2c.parse.sections import find_sections
from dl2c.parse.tree import Archive, Declaration
from dl2c.resolve.errors import UNDECLARED
from dl2c.resolve.infer import inferred
from dl2c.source import Source, Span

ROUNDS = 10
"""Corrections inside others are made one after the other."""


@dataclass(frozen=True, slots=True)
class Fix:
    """The edits that answer the warning with this code at `span`; names without declaration are warned of at
    the first of an entry.
    """

    code: str
    span: Span
    edits: tuple[Edit, ...]


def fix_file(path: Path) -> int:
    """Correct a model in place; how many corrections were made.

    Raises `OSError`, and `CompileError` for a model that cannot be parsed.
    """
    made = 0
    for _ in range(ROUNDS):
        content = path.read_bytes()
        changes = tuple(edits_of(Source.read(path)))
        new = edited(content, changes)
        if new == content:
            break
        write_output(path, new)
        made += len(changes)
    return made


def edits_of(source: Source) -> Iterator[Edit]:
    """The corrections of a source. Raises `CompileError` for one that cannot be parsed."""
    for fix in fixes(source):
        yield from fix.edits


def fixes(source: Source, read: Read | None = None) -> Iterator[Fix]:
    """The same, by the warnings that they answer. `read` is what the parser makes of the source."""
    read = read or parse_archive(source)
    for found in portability(source, read):
        if edits := tuple(_edits(found)):
            yield Fix(found.code, found.span, edits)
    for comments in _groups(source, refused_comments(source)):
        yield Fix(errors.REJECTS, comments[0].span, tuple(_comment(comments)))
    yield from _declarations(source, read[0])
    for found in quotients(source, read[0]):
        span = found.span
        edit = Edit(span.start, span.end, f"(-({span.text[1:].strip()}))")
        yield Fix(found.code, span, (edit,))


def declarations(source: Source, archive: Archive) -> Iterator[Edit]:
    """Declarations of what is not declared, before the problem of each entry, in sections of their own."""
    for fix in _declarations(source, archive):
        yield from fix.edits


def _declarations(source: Source, archive: Archive) -> Iterator[Fix]:
    code = scan(source)
    sections = find_sections(code, [])
    for entry in archive.entries:
        found = inferred(entry)
        text = _section("Definitions", found.constants) + _section("ProgramVariables", found.variables)
        if not text:
            continue
        first = min((*found.constants, *found.variables), key=lambda d: d.span.start).span
        number = next(k for k, s in enumerate(sections) if s.begin <= entry.problem.span.start < s.end)
        if number > 0:
            at = sections[number - 1].over
            yield Fix(UNDECLARED, first, (Edit(at, at, "\n\n" + text.rstrip("\n")),))
        else:
            at = 0 if not code.text[: sections[0].start].strip() else sections[0].start
            yield Fix(UNDECLARED, first, (Edit(at, at, text),))


def _section(word: str, declared: tuple[Declaration, ...]) -> str:
    lines = [f"  Real {d.name};" for d in declared]
    return "\n".join([word, *lines, "End.", "", ""]) if lines else ""


def _edits(found: Diagnostic) -> Iterator[Edit]:
    span = found.span
    if found == errors.doubled_connective(span):
        yield Edit(span.start, span.end, span.text[0])
    elif found == errors.open_statement(span):
        yield Edit(span.end, span.end, ";")
    elif found == errors.misspelt_package(span):
        start = span.start + span.text.index("keyx")
        yield Edit(start, start + 4, "kyx")
    elif found.title == errors.entry_not_ended(span, "").title:
        yield Edit(span.end, span.end, "\n\nEnd.")


def _groups(source: Source, comments: tuple[Comment, ...]) -> list[list[Comment]]:
    """`//` comments in neighbouring lines together: an annotation may go on."""
    groups: list[list[Comment]] = []
    for comment in comments:
        last = groups[-1][-1].span.end if groups else -1
        between = source.text[last : comment.span.start]
        if last >= 0 and not between.strip() and between.count("\n") == 1:
            groups[-1].append(comment)
        else:
            groups.append([comment])
    return groups


def _comment(group: list[Comment]) -> Iterator[Edit]:
    """A group of `//` comments as one `/* */`."""
    for k, comment in enumerate(group):
        text = comment.span.text.lstrip("/").rstrip().replace("*/", "* /")
        closing = " */" if k == len(group) - 1 else ""
        yield Edit(comment.span.start, comment.span.end, ("  " if k else "/*") + text + closing)
