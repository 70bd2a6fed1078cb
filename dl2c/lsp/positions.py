"""Places as an editor counts them, and places in one text as places in a later one.

An editor counts lines, and units of an encoding within a line: UTF-16 unless both sides agree on another
one. dl2c counts characters of the whole text. A line ends with `\\n`, `\\r\\n` or `\\r` for both.
"""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

Encoding: TypeAlias = Literal["utf-8", "utf-16", "utf-32"]
Position: TypeAlias = tuple[int, int]
"""Line and units before it in the line, both counted from 0."""

_BYTES = {"utf-8": 1, "utf-16": 2, "utf-32": 4}
_CODEC = {"utf-8": "utf-8", "utf-16": "utf-16-le", "utf-32": "utf-32-le"}


@dataclass(frozen=True)
class Lines:
    """A text that has `\\n` as its only line end, in the units of an encoding."""

    text: str
    encoding: Encoding = "utf-16"

    @cached_property
    def starts(self) -> list[int]:
        """Offset of the first character of every line."""
        starts, at = [0], self.text.find("\n")
        while at >= 0:
            starts.append(at + 1)
            at = self.text.find("\n", at + 1)
        return starts

    def position(self, offset: int) -> Position:
        """Of an offset, which lies in the text or at its end."""
        line = bisect_right(self.starts, offset) - 1
        return line, self.units(self.text[self.starts[line] : offset])

    def offset(self, position: Position) -> int:
        """Of a position; beyond the end of a line its end, beyond the text the end of that."""
        line, units = position
        if line >= len(self.starts):
            return len(self.text)
        start = self.starts[line]
        end = self.starts[line + 1] - 1 if line + 1 < len(self.starts) else len(self.text)
        text = self.text[start:end]
        if text.isascii() or self.encoding == "utf-32":
            return start + min(units, len(text))
        before = 0
        for index, character in enumerate(text):
            if before >= units:
                return start + index
            before += self.units(character)
        return end

    def units(self, text: str) -> int:
        """How many units a part of a line has."""
        if text.isascii():
            return len(text)
        return len(text.encode(_CODEC[self.encoding], "surrogatepass")) // _BYTES[self.encoding]


def normal(text: str) -> str:
    """The text of an editor as `Source` has it; a byte order mark becomes a blank, so that columns stay."""
    blank = " " + text[1:] if text.startswith("\ufeff") else text
    return blank.replace("\r\n", "\n").replace("\r", "\n")


@dataclass(frozen=True, slots=True)
class Shift:
    """From one text to a later one that has other characters between `start` and `end`, and is `longer`."""

    start: int
    end: int
    longer: int

    @staticmethod
    def between(old: str, new: str) -> "Shift":
        """The smallest change."""
        most = min(len(old), len(new))
        start = _same(old, new, most)
        tail = _same_end(old, new, most - start)
        return Shift(start, len(old) - tail, len(new) - len(old))

    def later(self, start: int, end: int) -> tuple[int, int]:
        """Where a range of the old text is in the new one. What is put in beside it does not belong to it."""
        inserted = self.start == self.end
        stays = start < self.start or (start == self.start and not inserted)
        first = start if stays else max(start, self.end) + self.longer
        return first, max(first, end if end <= self.start else max(end, self.end) + self.longer)

    def earlier(self, offset: int) -> int:
        """Where a place of the new text was in the old one; inside the change, its beginning."""
        if offset <= self.start:
            return offset
        return max(self.start, offset - self.longer) if offset >= self.end + self.longer else self.start

    def touches(self, start: int, end: int) -> bool:
        """Whether a range of the old text has changed, or something was put into it."""
        return start < self.end and self.start < end


UNCHANGED = Shift(0, 0, 0)


def _same(old: str, new: str, most: int) -> int:
    """How many characters at the beginning are the same."""
    low, high = 0, most
    while low < high:
        middle = (low + high + 1) // 2
        if old[low:middle] == new[low:middle]:
            low = middle
        else:
            high = middle - 1
    return low


def _same_end(old: str, new: str, most: int) -> int:
    low, high = 0, most
    while low < high:
        middle = (low + high + 1) // 2
        if old[len(old) - middle : len(old) - low] == new[len(new) - middle : len(new) - low]:
            low = middle
        else:
            high = middle - 1
    return low
