"""What KeYmaera X 5.0.2 does not read as dl2c does, in the text of a model.

Comes in: a source that dl2c can parse. Go out: diagnostics, from the text and from the parser.
"""

import re
from collections.abc import Iterator
from typing import TypeAlias

from dl2c.diagnostics import Diagnostic, in_source_order, warning
from dl2c.parse import errors, tree
from dl2c.parse.archive import refused_comments
from dl2c.parse.scan import scan
from dl2c.resolve.symbols import BUILTINS, NULLARY_BUILTINS, nodes
from dl2c.source import Source, Span

Read: TypeAlias = tuple[tree.Archive, tuple[Diagnostic, ...]]
"""What `parse_archive` returns."""

SYMBOLS = "→←↔∧∨•∀∃⎵≠≥≤∪∩×"
"""The characters beyond ASCII that KeYmaera X reads outside strings."""

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)


def portability(source: Source, read: Read) -> tuple[Diagnostic, ...]:
    """`keymaera-rejects`, everything once. `read` is what the parser makes of the source."""
    archive, warnings = read
    found = [d for d in warnings if d.code == errors.REJECTS]
    found += [errors.line_comment(comment.span) for comment in refused_comments(source)]
    found += _characters(source)
    for entry in archive.entries:
        found += _imports(entry)
    return in_source_order(found)


def quotients(source: Source, archive: tree.Archive) -> Iterator[Diagnostic]:
    """`minus-in-quotient`: a bare minus after `/` takes all the rest of the product."""
    code = scan(source).text
    seen: set[Span] = set()
    for entry in archive.entries:
        for expression in _expressions(entry):
            for node in nodes(expression):
                match node:
                    case tree.Divide(_, tree.Neg(tree.Divide()) as minus):
                        span = _bare(minus, code)
                        if span is not None and span not in seen:
                            seen.add(span)
                            yield _quotient(span)
                    case _:
                        pass


def _quotient(span: Span) -> Diagnostic:
    return warning(
        "minus-in-quotient",
        "a minus after `/` belongs to the whole product that follows",
        span,
        f"read as `(-({span.text[1:].strip()}))`",
        "put what you mean in parentheses",
    )


def _bare(minus: tree.Neg, code: str) -> Span | None:
    """The minus with its operand; None where either stands in parentheses."""
    start = minus.span.start if code[minus.span.start] == "-" else code.rfind("-", 0, minus.span.start)
    operand = code[start + 1 : minus.span.end].strip()
    before = start
    while code[before - 1].isspace():
        before -= 1
    if code[before - 1] != "/" or _closes(operand) == len(operand) - 1:
        return None
    return Span(minus.span.source, start, minus.span.end)


def _closes(text: str) -> int:
    """Where the parenthesis closes with which a text begins; -1 if it begins with none."""
    depth = 0
    for at, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0:
            return at if at else -1
    return -1


def _characters(source: Source) -> Iterator[Diagnostic]:
    """The first place of each character."""
    pieces: list[str] = []
    at = 0
    for string in _STRING.finditer(scan(source).text):
        pieces += [source.text[at : string.start()], " " * len(string.group())]
        at = string.end()
    pieces.append(source.text[at:])
    seen = set(SYMBOLS)
    for found in re.finditer(r"[^\x00-\x7f]", "".join(pieces)):
        if found.group() not in seen:
            seen.add(found.group())
            yield warning(
                errors.REJECTS,
                "KeYmaera X rejects this character outside strings, even in comments",
                Span(source, *found.span()),
                "",
                "write it in ASCII",
            )


def _imports(entry: tree.Entry) -> Iterator[Diagnostic]:
    """The first use of every library function that is neither imported nor declared."""
    known = {name.rsplit(".", 1)[-1] for name in entry.imports} | {d.name for d in entry.definitions}
    if "*" in known:
        return
    for expression in _expressions(entry):
        for node in nodes(expression):
            match node:
                case tree.FuncOf(name) if name not in known and name in (*BUILTINS, *NULLARY_BUILTINS):
                    known.add(name)
                    yield warning(
                        errors.REJECTS,
                        f"KeYmaera X does not know `{name}` without an import",
                        node.span,
                        "",
                        f"write `import kyx.math.{name};` in Definitions",
                    )
                case _:
                    pass


def _expressions(entry: tree.Entry) -> Iterator[tree.Expression]:
    yield from (d.body for d in entry.definitions if d.body is not None)
    yield entry.problem
