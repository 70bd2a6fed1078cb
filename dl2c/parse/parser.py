"""Reading KeYmaera X text: archives, formulas, terms and programs.

In: a `Source`, a `Span` of one, or a string. Out: the syntax tree of tree.py, every node with
its span. Mistakes are raised as `CompileError`. Names need not be declared: resolving them is
the next stage.
"""

from collections.abc import Callable
from typing import TypeAlias, TypeVar

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import archive, build, comments, errors
from dl2c.parse.scan import Code, scan
from dl2c.parse.syntax import Node, parse_tree
from dl2c.parse.tree import Archive, Formula, Program, Term
from dl2c.source import Source, Span

Text: TypeAlias = Source | Span | str
_T = TypeVar("_T")


def parse_archive(source: Source) -> tuple[Archive, tuple[Diagnostic, ...]]:
    """Read a whole .kyx file; the warnings come second. Independent errors are raised together, as
    `archive.Unreadable` with what could be read.
    """
    return archive.read_archive(source)


def parse_term(text: Text, *, strict: bool = False) -> Term:
    """Read a term. `strict` refuses what KeYmaera X refuses."""
    return _parsed(text, "start_term", build.term, strict)


def parse_formula(text: Text, *, strict: bool = False) -> Formula:
    """Read a formula. `strict` refuses what KeYmaera X refuses."""
    return _parsed(text, "start_formula", build.formula, strict)


def parse_program(text: Text, *, strict: bool = False) -> Program:
    """Read a program. `strict` refuses what KeYmaera X refuses."""
    return _parsed(text, "start_program", build.program, strict)


def parse_value(text: Text, *, strict: bool = False) -> Term | Formula:
    """Read a term or a formula, whichever it is; a bare name is a Variable, a call a FuncOf."""
    return _parsed(text, "start_value", build.value, strict)


def parse_annotated(span: Span) -> Term | Formula:
    """Read a value inside comments; the comment markers of its later lines are not part of it."""
    text = span.source.text
    view = scan(Source("", comments.visible(span))).text
    code = Code(span.source, text[: span.start] + view + text[span.end :], ())
    read = build.Reading(span.source, [], {})
    node = build.nodes(build.parts(parse_tree(code, span.start, span.end, "start_value")))[0]
    return build.value(node, read)


def _parsed(text: Text, symbol: str, read_node: Callable[[Node, build.Reading], _T], strict: bool) -> _T:
    code, start, end = _code(text)
    read = build.Reading(code.source, [], {})
    if strict:
        read.warnings.extend(errors.line_comment(c.span) for c in code.comments if c.line)
    root = parse_tree(code, start, end, symbol)
    value = read_node(build.nodes(build.parts(root))[0], read)
    if strict and read.warnings:
        raise CompileError(errors.strictly(warning) for warning in read.warnings)
    return value


def _code(text: Text) -> tuple[Code, int, int]:
    match text:
        case Span(source, start, end):
            return scan(source, start, end), start, end
        case Source():
            return scan(text), 0, len(text.text)
        case str():
            return scan(Source("<text>", text)), 0, len(text)
