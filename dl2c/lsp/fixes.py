"""Corrections of single diagnostics: those of `check --fix`, and the name that a message proposes."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.lint.edits import Edit, apart
from dl2c.lint.fix import fixes
from dl2c.lsp.analysis import Analysis
from dl2c.resolve.errors import UNDECLARED

_PROPOSED = re.compile(r"did you mean `([^`]+)`\?")
_WORD = re.compile(r"@?[A-Za-z_]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Correction:
    """`answers` is the diagnostic; None for all corrections of a file together."""

    title: str
    edits: tuple[Edit, ...]
    answers: Diagnostic | None = None


def corrections(analysis: Analysis, shown: Sequence[Diagnostic]) -> Iterator[Correction]:
    """What can be done about the diagnostics, and about all that `check --fix` corrects."""
    for d in shown:
        yield from _proposed(d)
    if not analysis.readable:
        return
    found = ()
    with suppress(CompileError):
        found = tuple(fixes(analysis.source))
    for fix in found:
        for d in shown:
            same = d.span.start == fix.span.start or (
                d.code == UNDECLARED
                and analysis.names.entry_at(d.span.start) is analysis.names.entry_at(fix.span.start)
            )
            if d.code == fix.code and same:
                yield Correction(d.help.partition(":")[0] or d.title, apart(fix.edits), d)
    if found:
        yield Correction(
            "correct all that `dl2c check --fix` does", apart(e for fix in found for e in fix.edits)
        )


def _proposed(d: Diagnostic) -> Iterator[Correction]:
    """Another name in place of the one that stands at the beginning of the diagnostic's range."""
    proposed = _PROPOSED.match(d.help)
    written = _WORD.match(d.span.source.text, d.span.start, d.span.end)
    if proposed and written and _WORD.fullmatch(proposed.group(1)):
        edit = Edit(*written.span(), proposed.group(1))
        yield Correction(f"write `{proposed.group(1)}`", (edit,), d)
