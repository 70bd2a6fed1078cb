"""Text and ranges in it.

A `Source` is one file (or string) a user wrote; a `Span` is a half-open range of
its characters. Nothing here knows what the text means.
"""

import hashlib
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from dl2c.inputs import open_input

MAX_TEXT = 2_000_000
"""Characters that a model may have; reading stops soon after them."""


@dataclass(frozen=True)
class Source:
    """A named text. `name` is what diagnostics show, usually the path as the user gave it."""

    name: str
    text: str = field(repr=False)

    @staticmethod
    def read(path: str | Path) -> "Source":
        """Read a UTF-8 file: no byte order mark, line ends as `\\n`. Raises `OSError`.

        Bytes that are not UTF-8 become lone surrogates, which the parser refuses with their place.
        """
        with open_input(path) as file:
            content = file.read(4 * MAX_TEXT + 4)
        text = content.decode("utf-8-sig", "surrogateescape")
        return Source(str(path), text.replace("\r\n", "\n").replace("\r", "\n"))

    @property
    def file_name(self) -> str:
        """`name` without the directory: what generated files call it, so that they are the same wherever the
        file is.
        """
        return self.name.replace("\\", "/").rsplit("/", 1)[-1]

    @property
    def start(self) -> "Span":
        """Its first character."""
        return Span(self, 0, min(1, len(self.text)))

    @cached_property
    def line_starts(self) -> tuple[int, ...]:
        """Offset of the first character of every line."""
        return (0, *(i + 1 for i, c in enumerate(self.text) if c == "\n"))

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column of an offset, both counted from 1."""
        line = bisect_right(self.line_starts, offset)
        return line, offset - self.line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """The text of a line counted from 1, without its end."""
        start = self.line_starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")


@dataclass(frozen=True, slots=True)
class Span:
    """The characters `start` to `end` (exclusive) of a source."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        return self.source.position(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.position(self.start)[1]

    @property
    def text(self) -> str:
        """The characters themselves."""
        return self.source.text[self.start : self.end]

    @property
    def place(self) -> str:
        """`file:line:column`, as diagnostics show it."""
        line, column = self.source.position(self.start)
        return f"{self.source.name}:{line}:{column}"

    def to(self, other: "Span") -> "Span":
        """The smallest span that covers both; both lie in one source."""
        assert self.source is other.source
        return Span(self.source, min(self.start, other.start), max(self.end, other.end))


NOWHERE = Span(Source("<none>", ""), 0, 0)
"""The span of nodes that no text was written for."""


def text_hash(text: str) -> str:
    """SHA-256 of a model's text."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
