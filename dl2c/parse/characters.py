"""What the text of a model may consist of.

In: a source. Out: warnings, or a `CompileError`. Refused are texts that are too long, bytes that
are not UTF-8, and characters that make a text look different from what it says: those that change
the direction of writing, and control characters, which in comments and tactics are only warned of.
"""

import re
from itertools import islice

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.source import MAX_TEXT, Source, Span

MAX_REPORTED = 10
"""One file may have many such characters; the first ones say enough."""

_CONTROLS = re.compile("[\x00-\x08\x0e-\x1f\x7f-\x9f]")
_REFUSED = re.compile("[\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def check_text(source: Source) -> None:
    """Raise `CompileError` for a text that nobody should read as a model."""
    if len(source.text) > MAX_TEXT:
        raise CompileError(errors.file_too_large(Span(source, 0, 1), MAX_TEXT))
    if source.text.startswith("\0"):
        raise CompileError(errors.not_text(Span(source, 0, 1)))
    found = [_refused(source, m.start()) for m in islice(_REFUSED.finditer(source.text), MAX_REPORTED)]
    if found:
        raise CompileError(next(((d,) for d in found if d.code == "not-utf8"), tuple(found)))


def check_controls(code: Code) -> tuple[Diagnostic, ...]:
    """A warning for the first control character in a comment or tactic. Raises `CompileError` for others."""
    found = [m.start() for m in _CONTROLS.finditer(code.source.text)]
    read = [at for at in found if _CONTROLS.match(code.text, at)]
    if read:
        raise CompileError([_refused(code.source, at) for at in read[:MAX_REPORTED]])
    return tuple(
        errors.control_character_aside(code.span(at, at + 1), ord(code.source.text[at])) for at in found[:1]
    )


def _refused(source: Source, at: int) -> Diagnostic:
    code = ord(source.text[at])
    span = Span(source, at, at + 1)
    if 0xDC80 <= code <= 0xDCFF:
        return errors.not_utf8(span, code - 0xDC00)
    return errors.control_character(span, code)
