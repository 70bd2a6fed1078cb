"""What is known of a text at once: its entries, its names, and every diagnostic that needs no solver and no
step model. A text that nothing can be read of is read without what is in the way.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from dl2c.diagnostics import CompileError, Diagnostic, in_source_order
from dl2c.lint.allowed import allowed, unknown
from dl2c.lint.portable import Read
from dl2c.lsp.names import Names, names_of
from dl2c.options import Options
from dl2c.parse.archive import Unreadable
from dl2c.parse.characters import check_controls, check_text
from dl2c.parse.parser import parse_archive
from dl2c.parse.scan import Code, scan
from dl2c.parse.sections import Section, find_sections
from dl2c.parse.tree import Entry
from dl2c.resolve.episode import completed, deprecated_values
from dl2c.resolve.problem import Problem, resolve
from dl2c.resolve.unreadable import name_errors
from dl2c.source import Source
from dl2c.work import budgeted

MOST_OBSTACLES = 20
"""How often a text is read again without what is in the way."""

NEVER_CLOSED = "never-closed"
OBSTACLES = (NEVER_CLOSED, "control-character", "not-utf8")
"""Codes of what can be left out of a text, so that the rest of it is read."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """`code` and `sections` are those of the text, where it could be scanned. `problems` has one for each
    entry, None for one with errors; it is empty, and `readable` False, where there are errors of syntax.
    `read` is what the parser made of the text, perhaps without what had to be left out.
    """

    source: Source
    code: Code | None = None
    sections: tuple[Section, ...] = ()
    names: Names = field(default_factory=Names)
    problems: tuple[Problem | None, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    readable: bool = False
    read: Read | None = None

    @property
    def entries(self) -> tuple[Entry, ...]:
        return tuple(e.entry for e in self.names.entries)


def analyse(source: Source, options: Options, stopped: Callable[[], bool] | None = None) -> Analysis:
    """The analysis of a text; never raises `CompileError`. `stopped` says whether nobody waits for it."""
    try:
        with budgeted(stopped=stopped):
            read = _read(source)
    except CompileError as unfinished:
        return Analysis(source, diagnostics=unfinished.diagnostics)
    if read.read is None:
        return read
    try:
        with budgeted(stopped=stopped):
            return _resolved(read, options)
    except CompileError as unfinished:
        return replace(read, diagnostics=in_source_order((*read.diagnostics, *unfinished.diagnostics)))


def skimmed(source: Source) -> Analysis:
    """What is known of a text without its formulas and programs: its comments and sections."""
    try:
        code, found = _readable(source)
    except CompileError as refused:
        return Analysis(source, diagnostics=refused.diagnostics)
    return Analysis(source, code, tuple(find_sections(code, [])), diagnostics=in_source_order(found))


def _read(source: Source) -> Analysis:
    """All that is known without resolving names."""
    read = skimmed(source)
    if (code := read.code) is None:
        return read
    view, found = code.source, [*read.diagnostics]
    try:
        archive, warnings = parse_archive(view)
    except Unreadable as broken:
        found += broken.diagnostics
        for entry in broken.archive.entries:
            found += name_errors(broken, entry)
        return replace(read, names=names_of(broken.archive, code), diagnostics=in_source_order(found))
    except CompileError as refused:
        return replace(read, diagnostics=in_source_order((*found, *refused.diagnostics)))
    found += warnings
    read = replace(read, names=names_of(archive, code), diagnostics=in_source_order(found))
    return replace(read, readable=view is source, read=(archive, warnings))


def _readable(source: Source) -> tuple[Code, list[Diagnostic]]:
    """The code of a text of the same length that can be scanned, and why that is not the text itself. Blank
    in it are characters that must not be there, and a line from where a comment or string is never closed.

    Raises `CompileError` where nothing can be read.
    """
    found: list[Diagnostic] = []
    view = source
    for _ in range(MOST_OBSTACLES):
        try:
            check_text(view)
            check_controls(code := scan(view))
        except CompileError as refused:
            if not all(d.code in OBSTACLES for d in refused.diagnostics):
                raise
            found += refused.diagnostics
            view = _without(view, refused.diagnostics)
        else:
            return code, found
    raise CompileError(found)


def _without(source: Source, obstacles: Iterable[Diagnostic]) -> Source:
    text = source.text
    for d in obstacles:
        end = d.span.end
        if d.code == NEVER_CLOSED and (stop := text.find("\n", end)) >= 0:
            end = stop
        elif d.code == NEVER_CLOSED:
            end = len(text)
        text = text[: d.span.start] + " " * (end - d.span.start) + text[end:]
    return Source(source.name, text)


def _resolved(read: Analysis, options: Options) -> Analysis:
    """The same with the problem of each entry, and what is wrong with it."""
    found = list(read.diagnostics)
    problems: list[Problem | None] = []
    for entry in read.entries:
        try:
            problem = resolve(entry, options.loop)
            if problem.episode is not None:
                completed(options, problem.episode)
        except CompileError as refused:
            found += refused.diagnostics
            problems.append(None)
            continue
        found += (*problem.warnings, *deprecated_values(problem), *unknown(problem))
        problems.append(problem)
    shown = tuple(d for d in in_source_order(found) if _is_shown(d, problems))
    return replace(read, problems=tuple(problems) if read.readable else (), diagnostics=shown)


def _is_shown(found: Diagnostic, problems: Iterable[Problem | None]) -> bool:
    """Whether the entry that a warning stands in does not allow it."""
    around = [p for p in problems if p is not None and p.entry.span.start <= found.span.start]
    return found.severity == "error" or not around or any(allowed([found], around[-1]))
