"""What surrounds the syntax of dL in a file: comments, strings and tactics.

In: a source. Out: its code, a text of the same length in which comments and tactics are blank,
so that offsets stay true, and the comments themselves. Strings stay where they are.
Assumes nothing; a comment or string that never ends is the one mistake found here.
"""

import re
from dataclasses import dataclass

from dl2c.diagnostics import CompileError
from dl2c.parse import errors
from dl2c.source import Source, Span

_PIECE = re.compile(
    r"""  "(?:[^"\\]|\\.)*"
      | /\*.*?\*/
      | //[^\n]*
      | T(?<![A-Za-z0-9_\\]T)actic(?![A-Za-z0-9_])
      | /\*
      | \"""",
    re.VERBOSE | re.DOTALL,
)
"""A string, comments, `Tactic`, or a comment or string that never ends. Each alternative begins with a
character: `re` looks for those fast, and slowly for groups or conditions.
"""
_TACTIC_END = re.compile(r'"(?:[^"\\]|\\.)*"|/\*.*?\*/|E(?<![A-Za-z0-9_]E)nd\.', re.DOTALL)
_NEXT_STRING = re.compile(r'\s*"(?:[^"\\]|\\.)*"')


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment with its delimiters; `line` tells `//` from `/* */`."""

    span: Span
    line: bool


@dataclass(frozen=True, slots=True)
class Code:
    """A source without its comments: `text` has the length of `source.text`."""

    source: Source
    text: str
    comments: tuple[Comment, ...]

    def span(self, start: int, end: int) -> Span:
        return Span(self.source, start, end)


def scan(source: Source, start: int = 0, end: int | None = None) -> Code:
    """Blank the comments and the tactics of `source`, looking only at `start` to `end`."""
    text = source.text
    stop = len(text) if end is None else end
    pieces: list[str] = [text[:start]]
    comments: list[Comment] = []
    at = start
    while piece := _PIECE.search(text, at, stop):
        first, last = piece.span()
        keep = first
        match piece.group():
            case '"' | "/*" as opening:
                raise CompileError(errors.never_closed(Span(source, first, last), opening))
            case "Tactic":
                keep, last = _tactic(text, last, stop)
            case found if found[0] == '"':
                keep = last
            case found:
                comments.append(Comment(Span(source, first, last), found[1] == "/"))
        pieces += [text[at:keep], _blank(text[keep:last])]
        at = last
    pieces.append(text[at:])
    return Code(source, "".join(pieces), tuple(comments))


def _tactic(text: str, after: int, stop: int) -> tuple[int, int]:
    """Where the opaque text of a tactic begins and ends, `End.` excluded."""
    name = _NEXT_STRING.match(text, after, stop)
    begin = at = name.end() if name else after
    while found := _TACTIC_END.search(text, at, stop):
        if found.group() == "End.":
            return begin, found.start()
        at = found.end()
    return begin, stop


def _blank(text: str) -> str:
    """Blanks of the same length; line ends stay."""
    return "\n".join(" " * len(line) for line in text.split("\n"))
