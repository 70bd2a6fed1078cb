"""Where annotations belong: above a declaration, above Problem, or inside a program.

In: the annotations of a file and the ranges of its declarations and sections. Out: each
annotation at its place. An annotation that stands nowhere useful is an error.
"""

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dl2c.diagnostics import Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.parse.sections import Section
from dl2c.parse.tree import Annotation, Declaration

INSIDE_PROGRAMS = ("choice", "fallback")
ABOVE_PROBLEM = ("episode", "scene", "safety", "progress")
_PLACES = {
    "var": "above a declaration in ProgramVariables",
    "const": "above a `Real` declaration in Definitions",
    "episode": "above Problem",
    "scene": "above Problem",
    "choice": "inside a program, before a choice",
    "fallback": "inside a program, before an alternative of a choice",
}
_STATEMENT = re.compile(r"[^\s{+∪]")
_ABOVE_PREDICATE = "above a `Bool` definition"
_ABOVE_CONCLUSION = f"{_ABOVE_PREDICATE}, or above Problem"


@dataclass(frozen=True, slots=True)
class Statement:
    """What one statement of a block declares or imports, at `start` to `end`."""

    start: int
    end: int
    declared: tuple[Declaration, ...]
    imported: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """A section and its statements; none unless it holds declarations."""

    section: Section
    statements: tuple[Statement, ...]


def annotate(
    block: Block, annotations: Sequence[Annotation], code: Code, problems: list[Diagnostic]
) -> Block:
    """The block with every annotation above a declaration attached to it.

    One above `Real x, y;` belongs to both names.
    """
    above: dict[int, list[Annotation]] = {}
    for annotation in annotations:
        at = annotation.span.start
        if not block.section.begin <= at < block.section.end or _inside(block, at):
            continue
        later = bisect_right(block.statements, at, key=lambda statement: statement.start)
        alone = annotation.name in (*INSIDE_PROGRAMS, "episode", "scene") or later == len(block.statements)
        if alone or _trails(code, at, block):
            problems.append(misplaced(annotation))
        else:
            above.setdefault(later, []).append(annotation)
    return replace(
        block,
        statements=tuple(
            replace(
                statement, declared=tuple(replace(d, annotations=tuple(above[i])) for d in statement.declared)
            )
            if i in above
            else statement
            for i, statement in enumerate(block.statements)
        ),
    )


def inside_programs(
    blocks: Sequence[Block], annotations: Sequence[Annotation], problems: list[Diagnostic]
) -> tuple[Annotation, ...]:
    """The annotations inside the bodies of definitions and inside Problem."""
    found: list[Annotation] = []
    for annotation in annotations:
        if any(_inside(block, annotation.span.start) for block in blocks):
            if annotation.name in INSIDE_PROGRAMS:
                found.append(annotation)
            else:
                problems.append(misplaced(annotation))
    return tuple(found)


def by_statement(annotations: Sequence[Annotation], code: Code) -> Mapping[int, tuple[Annotation, ...]]:
    """The annotations inside programs, by the place of the statement before which they stand: only blanks,
    comments, opening braces and signs of choice are between. `annotations` are in source order.
    """
    found: dict[int, tuple[Annotation, ...]] = {}
    place, following = len(code.text), len(code.text)
    for annotation in reversed(annotations):
        if statement := _STATEMENT.search(code.text, annotation.span.end, following):
            place = statement.start()
        following = annotation.span.start
        if annotation.name in INSIDE_PROGRAMS:
            found[place] = (annotation, *found.get(place, ()))
    return found


def above_problem(
    sections: Sequence[Section], over: int, annotations: Sequence[Annotation], problems: list[Diagnostic]
) -> tuple[Annotation, ...]:
    """The annotations between the sections of an entry, before its Problem."""
    start = sections[0].start
    last = max((s.start for s in sections if s.kind == "Problem"), default=start)
    found: list[Annotation] = []
    for annotation in annotations:
        at = annotation.span.start
        within = any(s.begin <= at < s.end for s in sections)
        if not start <= at < over or within:
            continue
        if annotation.name in ABOVE_PROBLEM and at < last:
            found.append(annotation)
        else:
            problems.append(misplaced(annotation))
    return tuple(found)


def misplaced(annotation: Annotation) -> Diagnostic:
    above = _ABOVE_CONCLUSION if annotation.name in ABOVE_PROBLEM else _ABOVE_PREDICATE
    place = _PLACES.get(annotation.name, above)
    return errors.misplaced_annotation(annotation.span, annotation.name, place)


def _inside(block: Block, at: int) -> bool:
    if block.section.kind == "Problem":
        return block.section.begin <= at < block.section.end
    before = bisect_right(block.statements, at, key=lambda statement: statement.start)
    return before > 0 and at < block.statements[before - 1].end


def _trails(code: Code, at: int, block: Block) -> bool:
    """Whether a declaration stands before the annotation in its line."""
    line = code.text.rfind("\n", 0, at) + 1
    return bool(code.text[max(line, block.section.begin) : at].strip())
