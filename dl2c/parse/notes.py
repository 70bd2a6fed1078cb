"""Annotations inside programs, put back into a printed entry.

In: the text of an entry without them, the entry that was printed, and the same entry read from the text.
Out: the text with each annotation before the statement that it stood before, which is where `@choice`
and `@fallback` find the choice or alternative that begins there.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import cast

from dl2c.parse.tree import Annotation, Assign, AssignAny, Entry, ODESystem, Program, ProgramConst, Test

Statement = Assign | AssignAny | Test | ProgramConst | ODESystem


def with_notes(text: str, entry: Entry, read: Entry, show: Callable[[Annotation], str]) -> str:
    """`read` is equal to `entry`; `show` prints an annotation."""
    pairs = list(zip(_in(entry), _in(read), strict=True))
    insertions: list[tuple[int, str]] = []
    for annotation in entry.program_annotations:
        later = [(s.span.start, new.span.start) for s, new in pairs if s.span.start >= annotation.span.end]
        if later:
            insertions.append((min(later, key=lambda starts: starts[0])[1], show(annotation)))
    insertions.sort(key=lambda insertion: insertion[0])
    for at, note in reversed(insertions):
        text = f"{text[:at]}{note} {text[at:]}"
    return text


def _in(entry: Entry) -> list[Statement]:
    bodies = (*(d.body for d in entry.definitions if isinstance(d.body, Program)), entry.problem)
    return [statement for body in bodies for statement in _statements(body)]


def _statements(node: object) -> Iterator[Statement]:
    """All statements, those in formulas included, in a fixed order."""
    if isinstance(node, Statement):
        yield node
    if is_dataclass(node):
        parts = tuple(getattr(node, f.name) for f in fields(node) if f.name not in ("span", "invariants"))
    else:
        parts = cast("tuple[object, ...]", node) if isinstance(node, tuple) else ()
    for part in parts:
        yield from _statements(part)
