"""A model's text as HTML: numbered lines, annotations and other comments told apart by colour."""

import re
from collections.abc import Iterator

from dl2c.report.markup import Markup, tag

COMMENT = re.compile(r'/\*.*?(?:\*/|\Z)|//[^\n]*|"(?:[^"\\]|\\.)*"', re.S)
"""Comments, and strings, which may hold what looks like one."""


def listing(text: str) -> Markup:
    """The text with line numbers."""
    rows = [
        tag("li", *(tag("span", part, class_=kind) if kind else part for kind, part in line))
        for line in _lines(text)
    ]
    return tag("ol", *rows, class_="model")


def _lines(text: str) -> Iterator[list[tuple[str, str]]]:
    """Each line as parts with their kinds: "annotation", "comment", or none."""
    line: list[tuple[str, str]] = []
    for kind, part in _parts(text):
        first, *rest = part.split("\n")
        line.append((kind, first))
        for other in rest:
            yield line
            line = [(kind, other)]
    yield line


def _parts(text: str) -> Iterator[tuple[str, str]]:
    end = 0
    for found in COMMENT.finditer(text):
        yield "", text[end : found.start()]
        part = found.group()
        kind = "" if part.startswith('"') else "annotation" if "@" in part else "comment"
        yield kind, part
        end = found.end()
    yield "", text[end:]
