"""Archive files: entries, their sections, their declarations.

In: a source in the dialect of KeYmaera X 5 or 4, or a mixture. Out: an `Archive` and warnings. Sections and
declarations are found by the reserved words that begin them, so that an error in one
declaration does not hide the errors of the next.
"""

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise

from dl2c.diagnostics import CompileError, Diagnostic, in_source_order
from dl2c.parse import build, comments, declarations, errors, placement
from dl2c.parse.build import Reading
from dl2c.parse.characters import check_controls, check_text
from dl2c.parse.placement import Block, Statement
from dl2c.parse.scan import Code, Comment, scan
from dl2c.parse.sections import (
    OLD_SORT,
    Section,
    bare_entry,
    entry_name,
    find_sections,
    first_in_line,
    is_bare,
    previous_characters,
    sign_of_old_dialect,
    trimmed_end,
)
from dl2c.parse.syntax import MAX_MISTAKES, Recovery, parse_tree
from dl2c.parse.tree import Annotation, Archive, Declaration, Entry, Formula, Truth
from dl2c.source import Source, Span

_STATEMENT = re.compile(
    r"(?<![A-Za-z0-9_])(?:(?:Real|Bool|HP|HG|implicit|import)(?![A-Za-z0-9_])"
    rf"|(?P<old>{OLD_SORT}))"
)
_SIGN = re.compile(r"<->|::=|=")
_STRAY = re.compile(r"(?P<word>\w+|\S)[^;]*;?")
MAX_DECLARATIONS = 1000
"""Names that one section may declare."""

MAX_ANNOTATIONS = 5000
MAX_ENTRIES = 500
MAX_SECTIONS = 5000
"""Of one file."""

_SEAM = re.compile(r"(?:(?:HP|HG)\s+\w+\s*::=\s*\{)?\s*\Z")


@dataclass(frozen=True, slots=True)
class Work:
    """A file being read. Errors outside of declarations and Problems, such as misplaced sections, are
    appended to `problems`, those inside to `recovery.problems`, warnings to `read.warnings`.
    """

    code: Code
    read: Reading
    annotations: tuple[Annotation, ...]
    problems: list[Diagnostic]
    recovery: Recovery

    def fail(self, refused: CompileError) -> None:
        """Enter why a declaration or Problem cannot be read, but for what is wrong with stand-ins."""
        self.recovery.problems.extend(d for d in refused.diagnostics if not self.recovery.covers(d))


class Unreadable(CompileError):
    """A file with syntax errors. `archive` is what could be read of it, with stand-ins: see `recovery`."""

    def __init__(self, diagnostics: Iterable[Diagnostic], archive: Archive, recovery: Recovery) -> None:
        super().__init__(diagnostics)
        self.archive, self.recovery = archive, recovery


def read_archive(source: Source) -> tuple[Archive, tuple[Diagnostic, ...]]:
    """Read a whole file; see `parser.parse_archive`."""
    check_text(source)
    code = scan(source)
    warnings = [*check_controls(code)]
    problems: list[Diagnostic] = []
    if old := sign_of_old_dialect(code):
        warnings.append(old)
    recovery = Recovery()
    annotations = comments.read_annotations(code, problems)
    read = Reading(source, warnings, placement.by_statement(annotations, code), recovery=recovery)
    work = Work(code, read, annotations, problems, recovery)
    _check_count("annotations", [a.span for a in work.annotations], MAX_ANNOTATIONS)
    sections = find_sections(code, problems)
    _check_count("sections", [code.span(s.start, s.begin) for s in sections], MAX_SECTIONS)
    if any(s.kind == "Problem" for s in sections) and all(s.kind != "entry" for s in sections):
        sections.insert(0, bare_entry())
    heads = [i for i, section in enumerate(sections) if section.kind == "entry"]
    _check_count("entries", [code.span(sections[i].start, sections[i].end) for i in heads], MAX_ENTRIES)
    if not heads:
        raise CompileError(errors.no_entry(code.span(0, min(1, len(source.text)))))
    shared = _shared(sections[: heads[0]], sections[heads[0]].start, work)
    entries = [
        _entry(sections[head:following], shared, _over(sections, following, code), work)
        for head, following in pairwise([*heads, None])
    ]
    archive = Archive(tuple(entries), span=code.span(0, len(source.text)))
    recovery.lost |= bool(problems)
    if problems or recovery.problems:
        raise Unreadable((*problems, *recovery.problems), archive, recovery)
    return archive, in_source_order(work.read.warnings)


def _check_count(what: str, spans: Sequence[Span], limit: int) -> None:
    if len(spans) > limit:
        raise CompileError(errors.too_many(what, spans[limit], limit))


def _over(sections: Sequence[Section], following: int | None, code: Code) -> int:
    """Where the text of an entry ends: at the next entry or the end of the file."""
    return len(code.text) if following is None else sections[following].start


def _shared(sections: Sequence[Section], end: int, work: Work) -> list[Block]:
    """The definitions before the first entry; nothing else may stand there."""
    blocks = [_block(section, work) for section in sections if section.kind == "Definitions"]
    for section in sections:
        if section.kind != "Definitions":
            span = work.code.span(section.start, section.begin)
            work.problems.append(errors.misplaced_text(span, "`ArchiveEntry`"))
    for annotation in work.annotations:
        within = any(s.begin <= annotation.span.start < s.end for s in sections)
        if annotation.span.start < end and not within:
            work.problems.append(placement.misplaced(annotation))
    return [placement.annotate(block, work.annotations, work.code, work.problems) for block in blocks]


# ---------------------------------------------------------------- declarations


def _block(section: Section, work: Work) -> Block:
    """The statements of a section; those with errors are reported and left out."""
    if section.kind not in ("Definitions", "ProgramVariables"):
        return Block(section, ())
    code = work.code
    starts = _statement_starts(code, section)
    first = starts[0] if starts else section.end
    stray = islice(_STRAY.finditer(code.text, section.begin, first), MAX_MISTAKES)
    work.problems.extend(errors.not_a_declaration(code.span(*found.span("word"))) for found in stray)
    statements: list[Statement] = []
    declared = 0
    for start, following in pairwise([*starts, section.end]):
        end = trimmed_end(code, start, following)
        try:
            statements.append(_statement(section, start, end, work))
        except CompileError as found:
            work.fail(found)
            statements.append(Statement(start, end, _head(section, start, end, work), ()))
            work.recovery.lost |= not statements[-1].declared
        _check_comments(start, end, work)
        declared += max(1, len(statements[-1].declared))
        if declared > MAX_DECLARATIONS:
            raise CompileError(errors.too_many("declarations", code.span(start, end), MAX_DECLARATIONS))
    return Block(section, tuple(statements))


def _statement_starts(code: Code, section: Section) -> list[int]:
    """Where statements begin: at a sort that is neither that of a parameter nor after `implicit`.

    The letters of the old dialect are sorts only after a statement or first in their line.
    """
    starts: list[int] = []
    for word in _STATEMENT.finditer(code.text, section.begin, section.end):
        before = previous_characters(code, section.begin, word.start(), len("implicit"))
        if word.group() == "import":
            if not before or before.endswith(";"):
                starts.append(word.start())
        elif word.group("old"):
            if before[-1:] in ("", ";", ".", "}") or first_in_line(code, word.start()):
                starts.append(word.start())
        elif not before.endswith(("(", ",", "implicit")):
            starts.append(word.start())
    return starts


def _statement(section: Section, start: int, end: int, work: Work) -> Statement:
    code, read = work.code, work.read
    if code.text.startswith("import", start):
        return Statement(start, end, (), declarations.read_import(code, start, end, read))
    if section.kind == "ProgramVariables":
        return Statement(start, end, declarations.read_variables(code, start, end, read), ())
    return Statement(start, end, declarations.read_definition(code, start, end, read), ())


def _head(section: Section, start: int, end: int, work: Work) -> tuple[Declaration, ...]:
    """What a definition that cannot be read declares, without its body; nothing where that is not clear."""
    sign = _SIGN.search(work.code.text, start, end)
    if sign is None or section.kind != "Definitions":
        return ()
    text = work.code.text
    headed = replace(work.code, text=f"{text[: sign.start()]};{text[sign.start() + 1 :]}")
    try:
        declared = declarations.read_definition(
            headed, start, sign.start() + 1, Reading(work.read.source, [], {})
        )
    except CompileError:
        return ()
    work.recovery.gaps.append((sign.start(), end))
    return declared


def _check_comments(start: int, end: int, work: Work) -> None:
    """Warn, once per file, of a `//` comment where KeYmaera X reads a formula or program."""
    if any(warning == errors.line_comment(warning.span) for warning in work.read.warnings):
        return
    comments = work.code.comments
    first, last = (bisect_left(comments, at, key=lambda c: c.span.start) for at in (start, end))
    for comment in comments[first:last]:
        if comment.line and not _SEAM.match(work.code.text, start, comment.span.start):
            work.read.warnings.append(errors.line_comment(comment.span))
            return


# ---------------------------------------------------------------- entries


def _entry(sections: Sequence[Section], shared: Sequence[Block], over: int, work: Work) -> Entry:
    """One entry from its sections, of which the first is its head."""
    head, code, problems = sections[0], work.code, work.problems
    name = entry_name(code, head, problems)
    ended = next((i for i, section in enumerate(sections) if section.kind == "End"), None)
    if ended is None and not is_bare(head):
        end = trimmed_end(code, head.start, over)
        work.read.warnings.append(errors.entry_not_ended(code.span(end - 1, end), name))
    elif ended is not None and ended + 1 < len(sections):
        extra = sections[ended + 1]
        problems.append(errors.misplaced_text(code.span(extra.start, extra.begin), "a new entry"))
    own = [
        placement.annotate(_block(section, work), work.annotations, code, problems)
        if section.kind in ("Definitions", "ProgramVariables")
        else Block(section, ())
        for section in sections
    ]
    problem = _problem(sections, name, work)
    blocks = [*shared, *own]
    inside = placement.inside_programs(blocks, work.annotations, problems)
    above = placement.above_problem(sections, over, work.annotations, problems)
    return Entry(
        head.word,
        name,
        tuple(name for block in blocks for statement in block.statements for name in statement.imported),
        _declared(blocks, "Definitions"),
        _declared(blocks, "ProgramVariables"),
        problem,
        above,
        inside,
        span=code.span(head.start, trimmed_end(code, head.start, over)),
    )


def _declared(blocks: Sequence[Block], kind: str) -> tuple[Declaration, ...]:
    return tuple(
        declaration
        for block in blocks
        if block.section.kind == kind
        for statement in block.statements
        for declaration in statement.declared
    )


def _problem(sections: Sequence[Section], name: str, work: Work) -> Formula:
    """The formula of the entry's only Problem; after an error `true` stands in for it."""
    problems = [section for section in sections if section.kind == "Problem"]
    for extra in problems[1:]:
        work.problems.append(errors.second_problem(work.code.span(extra.start, extra.begin)))
    if not problems:
        head = sections[0]
        work.problems.append(errors.no_problem(work.code.span(head.start, head.end), name))
        return Truth(True, span=work.code.span(head.start, head.end))
    begin, end = problems[0].begin, trimmed_end(work.code, problems[0].begin, problems[0].end)
    _check_comments(begin, end, work)
    try:
        root = parse_tree(work.code, begin, max(end, begin), "start_formula", work.recovery)
        return build.formula(build.nodes(build.parts(root))[0], work.read)
    except CompileError as found:
        work.fail(found)
        work.recovery.gaps.append((begin, end))
        return Truth(True, span=work.code.span(begin, end))


def refused_comments(source: Source) -> tuple[Comment, ...]:
    """All `//` comments where KeYmaera X reads a formula or program, of a file that can be read."""
    code = scan(source)
    ranges: list[tuple[int, int]] = []
    for section in find_sections(code, []):
        begin, end = section.begin, trimmed_end(code, section.begin, section.end)
        match section.kind:
            case "Problem":
                ranges.append((begin, end))
            case "Definitions" | "ProgramVariables":
                starts = _statement_starts(code, section)
                pairs = pairwise([*starts, section.end])
                ranges += ((start, trimmed_end(code, start, following)) for start, following in pairs)
            case _:
                pass
    found: list[Comment] = []
    for comment in code.comments:
        at = comment.span.start
        start, end = ranges[k - 1] if (k := bisect_right(ranges, (at, len(code.text)))) else (at, at)
        if comment.line and at < end and not _SEAM.match(code.text, start, at):
            found.append(comment)
    return tuple(found)
