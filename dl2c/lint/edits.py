"""Changes to the text of a file that leave the rest of its bytes as they are.

Places are those of `Source.text`, which has neither a byte order mark nor carriage returns; the
file may have both. New lines end as the file's first line does.
"""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Edit:
    """`text` in place of the characters `start` to `end`."""

    start: int
    end: int
    text: str


def edited(content: bytes, edits: Iterable[Edit]) -> bytes:
    """The content of a file with edits, in any order; of edits that overlap the first is made."""
    raw = content.decode("utf-8", "surrogateescape")
    places = _places(raw)
    ending = "\r\n" if "\r\n" in raw[: raw.find("\n") + 1] else "\n"
    pieces: list[str] = []
    at = 0
    for edit in apart(edits):
        pieces += [raw[at : places[edit.start]], edit.text.replace("\n", ending)]
        at = places[edit.end]
    return "".join((*pieces, raw[at:])).encode("utf-8", "surrogateescape")


def apart(edits: Iterable[Edit]) -> tuple[Edit, ...]:
    """Edits in the order of their places; of those that overlap the first."""
    found: list[Edit] = []
    for edit in sorted(edits, key=lambda e: (e.start, e.end)):
        if not found or edit.start >= found[-1].end:
            found.append(edit)
    return tuple(found)


def _places(raw: str) -> list[int]:
    """For every character of `Source.text`, and its end, where it is in the file."""
    start = 1 if raw.startswith("\ufeff") else 0
    kept = [i for i in range(start, len(raw)) if not (raw[i] == "\n" and i > start and raw[i - 1] == "\r")]
    return [*kept, len(raw)]
