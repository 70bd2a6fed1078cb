"""Where reading goes on after a syntax error.

In: a `Failure`. Out: the text with a stand-in for the statement, the operand or the stray words that
hold the mistake, and where they end. Only mistakes found behind that end are reported: what fails before
it fails because of the first one. The stand-in has the length of what it stands for, so offsets stay true.
"""

import re
from dataclasses import dataclass

from dl2c.parse.mistakes import NOTHING, Failure

MAX_TEXT = 100_000
"""Longer texts are not read again after a mistake."""

_PIECE = re.compile(r"[(\[{)\]};,&|]|\+\+|∪|<->|->|→|∧|∨")
_CLOSERS = {")": "(", "]": "[", "}": "{"}
_BETWEEN_STATEMENTS = frozenset({";", "++", "∪"})
_BARS = re.compile(r"\|[^|;]*\|")
_FI = re.compile(r"[^{}\[\]]*?;\s*fi(?![A-Za-z0-9_])(?=\s*[};])?")
_PAREN = re.compile(r"[()]")
_FLOW = re.compile(r"\s*[A-Za-z]\w*\s*'\s*=")
_TAIL = re.compile(
    r"\s*(?:(?:[*×]|\^@)\s*;?)?(?:\s*@(?:in)?variant\([^()]*\))?(?P<more>\s*else(?![A-Za-z0-9_]))?"
)


@dataclass(frozen=True, slots=True)
class _Level:
    """An open bracket, "" for the text itself, and where the statement or operand inside it begins."""

    opener: str
    place: int
    begin: int


@dataclass(frozen=True, slots=True)
class Resumed:
    """The text to read instead, from where on mistakes in it are reported (`after`), and the range of the
    stand-in; `blank` where that is nothing but blanks.
    """

    text: str
    after: int
    gap: tuple[int, int]
    blank: bool


def without_mistake(failure: Failure) -> Resumed | None:
    """How to read on; None where that cannot be."""
    found = _region(failure)
    if found is None or failure.end - failure.start > MAX_TEXT:
        return None
    start, end, instead = found
    if end - start < len(instead) or end <= failure.place - 1:
        return None
    text = failure.code.text
    blanks = re.sub(r"[^\n]", " ", text[start + len(instead) : end])
    after = max(end, failure.place + 1)
    return Resumed(text[:start] + instead + blanks + text[end:], after, (start, end), not instead)


def _region(failure: Failure) -> tuple[int, int, str] | None:
    """What to replace, and by what."""
    text, place = failure.code.text, failure.place
    levels = _levels(text, failure.start, place)
    program = next((level for level in reversed(levels) if level.opener in ("{", "[")), None)
    if program is not None:
        return _statement(failure, program)
    if failure.symbol == "declaration" and failure.accepted == NOTHING:
        stop = text.find(";", place, failure.end) + 1
        return place, stop or failure.end, ""
    if failure.symbol == "start_formula":
        begin = levels[-1].begin
        bars = _BARS.match(text, place, failure.end)
        end = _operand_end(text, bars.end() if bars else place, failure.end)
        return begin, end, "p"
    return None


def _levels(text: str, start: int, place: int) -> list[_Level]:
    """The brackets open at `place`, outermost first."""
    levels = [_Level("", start, start)]
    for piece in _PIECE.finditer(text, start, place):
        sign, after = piece.group(), piece.end()
        if sign in "([{":
            levels.append(_Level(sign, piece.start(), after))
            continue
        if sign in _CLOSERS:
            known = [i for i, level in enumerate(levels) if level.opener == _CLOSERS[sign]]
            del levels[known[-1] if known else len(levels) :]
            tail = _TAIL.match(text, after, place)
            if sign == ")" or (sign == "}" and tail and tail.group("more")):
                continue
            after = tail.end() if sign == "}" and tail else after
        elif sign in _BETWEEN_STATEMENTS:
            while levels[-1].opener == "(":
                levels.pop()
        elif levels[-1].opener in ("{", "["):
            continue
        levels[-1] = _Level(levels[-1].opener, levels[-1].place, after)
    return levels


def _statement(failure: Failure, level: _Level) -> tuple[int, int, str] | None:
    """The statement around the place; a block of differential equations is one as a whole."""
    text = failure.code.text
    if level.opener == "{" and _FLOW.match(text, level.place + 1):
        end = _statement_end(text, level.place, failure.end)
        return None if end is None else (level.place, end, "a;")
    end = _statement_end(text, _skipped(failure), failure.end)
    if end is None:
        return None
    if text[level.begin : end].strip():
        begin = level.begin + len(text[level.begin : end]) - len(text[level.begin : end].lstrip())
        return begin, end, "a;"
    if level.opener == "{" and text[end : end + 1] == "}":
        tail = _TAIL.match(text, end + 1, failure.end)
        return level.place, tail.end() if tail else end + 1, "a;"
    return None


def _skipped(failure: Failure) -> int:
    """The place, or behind a `(...)` or `then ... fi` that begins there."""
    text, at = failure.code.text, failure.place
    if failure.rest.startswith("then") and (closed := _FI.match(text, at, failure.end)):
        return closed.end()
    depth = 0
    for bracket in _PAREN.finditer(text, at, failure.end) if failure.rest.startswith("(") else ():
        depth += 1 if bracket.group() == "(" else -1
        if depth == 0:
            return bracket.end()
    return at


def _statement_end(text: str, at: int, stop: int) -> int | None:
    """Behind the `;` or block that ends a statement, or before the bracket that does."""
    depth = 0
    pieces = _PIECE.finditer(text, at, stop)
    for piece in pieces:
        sign = piece.group()
        if sign in "{[":
            depth += 1
        elif sign in ("}", "]"):
            if depth == 0:
                return piece.start()
            depth -= 1
            tail = _TAIL.match(text, piece.end(), stop)
            if sign == "}" and depth == 0 and tail and not tail.group("more"):
                return tail.end()
        elif depth == 0 and sign == ";":
            return piece.end()
        elif depth == 0 and sign in ("++", "∪") and piece.start() > at + 1:
            return piece.start()
    return None


def _operand_end(text: str, at: int, stop: int) -> int:
    """Before the connective, `,` or bracket that ends an operand."""
    depth = 0
    for piece in _PIECE.finditer(text, at, stop):
        sign = piece.group()
        if sign in "([{":
            depth += 1
        elif sign in _CLOSERS:
            depth -= 1
        if depth < 0 or (depth == 0 and sign not in "([{)]}"):
            return piece.start()
    return stop
