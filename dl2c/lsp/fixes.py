"""Corrections of single diagnostics: those of `check --fix`, and the name that a message proposes."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.lint.codes import LINTS
from dl2c.lint.edits import Edit, apart
from dl2c.lint.fix import fixes
from dl2c.lsp.analysis import Analysis
from dl2c.resolve.errors import UNDECLARED

FIXABLE = frozenset(lint.code for lint in LINTS if lint.fixable)

_PROPOSED = re.compile(r"did you mean `([^`]+)`\?")
_WORD = re.compile(r"@?[A-Za-z_]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Correction:
    """`answers` is the diagnostic; None for all corrections of a file together."""

    title: str
    edits: tuple[Edit, ...]
    answers: Diagnostic | None = None


def corrections(
    analysis: Analysis, diagnostics: Sequence[Diagnostic], start: int, end: int
) -> Iterator[Correction]:
    """What can be done about those of the diagnostics that touch a range, and about all that `check --fix`
    corrects.
    """
    shown = [d for d in diagnostics if d.span.start <= end and start <= d.span.end]
    for d in shown:
        yield from _proposed(d)
    if not analysis.readable or all(d.code not in FIXABLE for d in diagnostics):
        return
    with suppress(CompileError):
        yield from _fixes(analysis, shown)


def _fixes(analysis: Analysis, shown: Sequence[Diagnostic]) -> Iterator[Correction]:
    found = tuple(fixes(analysis.source, analysis.read))
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
