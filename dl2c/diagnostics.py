"""Messages about a user's text, and how they are shown.

A `Diagnostic` holds facts; `render` alone turns it into text. Errors travel as one
`CompileError` that carries every independent diagnostic found so far.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypeVar

from dl2c.source import NOWHERE, Source, Span

_T = TypeVar("_T")

Severity: TypeAlias = Literal["error", "warning"]

MAX_EXCERPT = 120
"""Longer source lines are shown as a window of this many characters."""

MOST_SHOWN = 100
"""Of more messages the first ones are shown."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One message: a stable `code`, a title, the place, what is wrong there, and advice."""

    severity: Severity
    code: str
    title: str
    span: Span
    label: str = ""
    help: str = ""
    notes: tuple[str, ...] = ()


def error(
    code: str, title: str, span: Span, label: str = "", help: str = "", notes: tuple[str, ...] = ()
) -> Diagnostic:
    """A diagnostic that stops the build."""
    return Diagnostic("error", code, title, span, label, help, notes)


def warning(
    code: str, title: str, span: Span, label: str = "", help: str = "", notes: tuple[str, ...] = ()
) -> Diagnostic:
    """A diagnostic that does not stop the build."""
    return Diagnostic("warning", code, title, span, label, help, notes)


class Mistake(ValueError):
    """A wrong option, file or policy; the message says what is wrong with it."""


class CompileError(Exception):
    """The model cannot be compiled. `diagnostics` says why; at least one is an error."""

    def __init__(self, diagnostics: Iterable[Diagnostic] | Diagnostic) -> None:
        items = (diagnostics,) if isinstance(diagnostics, Diagnostic) else tuple(diagnostics)
        self.diagnostics: tuple[Diagnostic, ...] = in_source_order(items)
        super().__init__(self.diagnostics)

    def __str__(self) -> str:
        shown = [render(d) for d in self.diagnostics[:MOST_SHOWN]]
        return "\n\n".join((*shown, *not_shown(self.diagnostics)))


def not_shown(diagnostics: Sequence[Diagnostic]) -> tuple[str, ...]:
    """What to say of those after the first `MOST_SHOWN`."""
    left = len(diagnostics) - MOST_SHOWN
    return (f"... and {left} more",) if left > 0 else ()


def together(tasks: Iterable[Callable[[], _T]]) -> list[_T]:
    """What independent tasks return. The mistakes of all of them are raised as one `CompileError`."""
    results: list[_T] = []
    problems: list[Diagnostic] = []
    for task in tasks:
        try:
            results.append(task())
        except CompileError as found:
            problems.extend(found.diagnostics)
    if problems:
        raise CompileError(problems)
    return results


def in_source_order(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Sorted by place, each one once."""
    return tuple(sorted(dict.fromkeys(diagnostics), key=lambda d: (d.span.source.name, d.span.start, d.code)))


def render(diagnostic: Diagnostic) -> str:
    """The message as plain text: headline with place, excerpt with caret, notes, help."""
    d = diagnostic
    headline = f"{d.severity}: {d.title}"
    lines = [headline if d.span == NOWHERE else f"{headline:<52} {d.span.place}"]
    if d.span != NOWHERE:
        lines += _excerpt(d.span, d.label)
    elif d.label:
        lines.append(f"  {d.label}")
    lines += [f"note: {note}" for note in d.notes]
    if d.help:
        lines.append(f"help: {d.help}")
    return "\n".join(_printable(line) for line in lines)


def _excerpt(span: Span, label: str) -> list[str]:
    """The line before (for context), the line itself, and a caret line below it."""
    line, column = span.source.position(span.start)
    width = len(str(line))
    shown: list[str] = []
    if line > 1 and (before := span.source.line(line - 1)).strip():
        shown.append(f"{line - 1:>{width}} | {_printable(before[:MAX_EXCERPT])}")
    text = span.source.line(line)
    length = max(1, min(span.end - span.start, len(text) - column + 1))
    window = max(0, column + min(length, MAX_EXCERPT // 2) - MAX_EXCERPT) if len(text) > MAX_EXCERPT else 0
    excerpt = _printable(text[window : window + MAX_EXCERPT])
    carets = "^" * max(1, min(length, MAX_EXCERPT - (column - 1 - window)))
    shown.append(f"{line:>{width}} | {excerpt}".rstrip())
    shown.append(f"{'':>{width}} | {'':>{column - 1 - window}}{carets} {label}".rstrip())
    return shown


def _printable(text: str) -> str:
    """Tabs and control characters as one blank each, so that carets stay aligned."""
    return "".join(c if c.isprintable() else " " for c in text)


def as_stored(diagnostic: Diagnostic) -> dict[str, Any]:
    """A warning as data that a build keeps."""
    span = diagnostic.span
    return {
        "code": diagnostic.code,
        "title": diagnostic.title,
        "range": [span.start, span.end],
        "label": diagnostic.label,
        "help": diagnostic.help,
        "notes": list(diagnostic.notes),
    }


def restored(stored: dict[str, Any], source: Source) -> Diagnostic:
    """A warning that a build kept. Raises `KeyError`, `TypeError` for other data."""
    span = Span(source, *stored["range"])
    notes = tuple(stored["notes"])
    return warning(stored["code"], stored["title"], span, stored["label"], stored["help"], notes)
