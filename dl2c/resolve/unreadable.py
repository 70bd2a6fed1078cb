"""What is wrong with the names of a model that has syntax errors too.

Comes in: a file. Goes out: one of its entries. Where there are syntax errors, stand-ins take the place of
what cannot be read, and errors of names in other lines are told too, but for names that the missing text
may declare or write.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse.archive import Unreadable
from dl2c.parse.parser import parse_archive
from dl2c.parse.tree import Archive, Entry
from dl2c.resolve.bind import check_entry
from dl2c.resolve.infer import with_inferred
from dl2c.resolve.symbols import collect
from dl2c.source import Source


def read_entry(source: Source, chosen: Callable[[Archive], Entry]) -> tuple[Entry, tuple[Diagnostic, ...]]:
    """The entry chosen from a file; the warnings come second. Raises `CompileError`."""
    try:
        archive, warnings = parse_archive(source)
    except Unreadable as broken:
        raise _explained(broken, chosen) from None
    return chosen(archive), warnings


def _explained(broken: Unreadable, chosen: Callable[[Archive], Entry]) -> CompileError:
    """All errors of a file, in the entry chosen also those of names."""
    names: list[Diagnostic] = []
    with suppress(CompileError):
        names += _name_errors(chosen(broken.archive)) if broken.archive.entries else ()
    lines = {d.span.line for d in broken.diagnostics}
    found = (d for d in names if d.span.line not in lines and not broken.recovery.hides(d))
    return CompileError((*broken.diagnostics, *found))


def _name_errors(entry: Entry) -> Iterator[Diagnostic]:
    entry, _ = with_inferred(entry)
    symbols, found = collect(entry)
    yield from found
    if all(d.code != "recursive-definition" for d in found):
        yield from check_entry(entry, symbols)
