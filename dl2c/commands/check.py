"""What `dl2c check` and `dl2c annotate` do with a model that a user names."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dl2c.commands.failures import CommandError
from dl2c.diagnostics import CompileError, Diagnostic, as_stored, restored
from dl2c.env.opening import EXAMPLE, source_of
from dl2c.native.notes import recalled, remember
from dl2c.source import Source

TIMED = {"undecided-precondition", "too-much-work"}
"""Codes that may not come again when there is more time."""


def diagnostics_of(model: str, options: Mapping[str, Any], portable: bool) -> tuple[Diagnostic, ...]:
    """All diagnostics of a model and of its project's defaults. Warnings of a model without errors are
    noted, so that it is looked at once.
    """
    from dl2c.configuration import resolve_options

    source = source_of(model)
    try:
        chosen = resolve_options(options)
    except CompileError as refused:
        return refused.diagnostics
    kind = "check --portable" if portable else "check"
    note = recalled(kind, source, chosen)
    with suppress(KeyError, TypeError, ValueError):
        return tuple(restored(w, source) for w in note["warnings"])
    from dl2c.lint.check import examine

    try:
        found = examine(source, chosen, portable=portable)
    except CompileError as refused:
        return refused.diagnostics
    if all(d.severity == "warning" and d.span.source == source and d.code not in TIMED for d in found):
        remember(kind, source, chosen, {"warnings": [as_stored(d) for d in found]})
    return found


def unverified(model: str, options: Mapping[str, Any]) -> bool:
    """Whether nothing is known of the theorem of a model, which has no errors."""
    from dl2c.configuration import resolve_options
    from dl2c.verify.results import Status, status

    return status(source_of(model), resolve_options(options)) == Status()


def fixed(model: str) -> int:
    """How many corrections were made in the file of a model; none in one that cannot be parsed."""
    from dl2c.lint.fix import fix_file

    if model.startswith(EXAMPLE):
        raise CommandError("--fix corrects files of yours, not examples")
    try:
        return fix_file(Path(model))
    except CompileError:
        return 0


def annotated(model: str, options: Mapping[str, Any]) -> bytes:
    """The file of a model with declarations of what it does not declare, and suggested annotations."""
    from dl2c.configuration import resolve_options
    from dl2c.lint.edits import edited
    from dl2c.lint.fix import declarations
    from dl2c.lint.suggest import suggestions
    from dl2c.pipeline import compilation

    source, given = source_of(model), resolve_options(options)
    path = Path(source.name) if not model.startswith(EXAMPLE) else None
    content = path.read_bytes() if path else source.text.encode()
    if declared := tuple(declarations(source, compilation(source, given).read[0])):
        content = edited(content, declared)
        source = Source(source.name, edited(source.text.encode(), declared).decode())
    return edited(content, suggestions(source, given))


def table_of_codes() -> str:
    """The table of the reference."""
    from dl2c.lint.codes import LINTS

    rows = [f"| `{lint.code}` | {lint.meaning} | {'yes' if lint.fixable else ''} |" for lint in LINTS]
    return "\n".join(("| code | warns that | `--fix` |", "| --- | --- | --- |", *rows))
