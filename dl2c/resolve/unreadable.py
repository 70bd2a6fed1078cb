"""Reading one entry of a file, and what is wrong with the names of a model that has syntax errors too.

Comes in: a file. Goes out: one of its entries. Where there are syntax errors, stand-ins take the place of
what cannot be read, and errors of names and annotations in other lines are told too, but for names that the
missing text may declare or write.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.parse.archive import Unreadable
from dl2c.parse.parser import parse_archive
from dl2c.parse.tree import Archive, Entry
from dl2c.resolve.bind import check_entry
from dl2c.resolve.infer import with_inferred
from dl2c.resolve.problem import annotation_errors
from dl2c.resolve.symbols import collect
from dl2c.source import Source, Span


def read_entry(source: Source, name: str | None) -> Entry:
    """The entry of this name or number, or the only one. Raises `CompileError`."""
    return entry_of(read_file(source, name)[0], name)


def read_file(source: Source, name: str | None) -> tuple[Archive, tuple[Diagnostic, ...]]:
    """All entries; the warnings come second. Raises `CompileError`, in which errors of names are those of the
    entry of this name.
    """
    try:
        return parse_archive(source)
    except Unreadable as broken:
        raise _explained(broken, name) from None


def entry_of(archive: Archive, chosen: str | None = None) -> Entry:
    """The entry of this name, or else number, of an archive, or its only one. Raises `CompileError`."""
    named = [e for e in archive.entries if chosen in (None, e.name)]
    named = named or [e for number, e in enumerate(archive.entries, 1) if chosen == str(number)]
    if len(named) == 1:
        return named[0]
    names = ", ".join(f'"{e.name}"' for e in archive.entries)
    if (chosen or "").isdigit():
        names += f", or its number, from 1 to {len(archive.entries)}"
    several = "the file has several entries" + (f" `{chosen}`: give its number" if chosen else "")
    title = several if named else f"no entry `{chosen}`"
    start = archive.entries[0].span
    place = Span(start.source, start.start, start.start + 1)
    raise CompileError(error("entry-not-found", title, place, help=f"choose one with --entry: {names}"))


def _explained(broken: Unreadable, name: str | None) -> CompileError:
    """All errors of a file, in the entry chosen also those of names."""
    names: list[Diagnostic] = []
    with suppress(CompileError):
        names += name_errors(broken, entry_of(broken.archive, name))
    return CompileError((*broken.diagnostics, *names))


def name_errors(broken: Unreadable, entry: Entry) -> Iterator[Diagnostic]:
    """Errors of names in one entry of a file with syntax errors, but for those that come of them."""
    lines = {d.span.line for d in broken.diagnostics}
    for found in _name_errors(entry):
        if found.span.line not in lines and not broken.recovery.hides(found):
            yield found


def _name_errors(entry: Entry) -> Iterator[Diagnostic]:
    entry, _ = with_inferred(entry)
    symbols, found = collect(entry)
    yield from found
    if all(d.code != "recursive-definition" for d in found):
        yield from check_entry(entry, symbols)
    kept = (d for d in entry.definitions if d.body is not None or d.sort == "Real")
    yield from annotation_errors(replace(entry, definitions=tuple(kept)), symbols)
