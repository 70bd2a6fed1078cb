"""From code to the concrete syntax tree, by the grammar in grammar.lark.

In: a range of `Code`. Out: a lark tree whose positions are offsets into the source, no deeper
than `MAX_DEPTH`. Syntax errors are raised as a `CompileError` in words of dL.
"""

import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fcntl import LOCK_EX, flock
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import lark
from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken
from lark.utils import TextSlice

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.storage import StorageError, private_folder
from dl2c.work import spend

if TYPE_CHECKING:
    from dl2c.parse.mistakes import Failure

Node: TypeAlias = Tree[Token]

STARTS = ("start_term", "start_formula", "start_value", "start_program", "declaration")

MAX_DEPTH = 200
"""Deeper nested text is refused, so that no later stage can run out of stack."""

MAX_MISTAKES = 20
"""Reported for one declaration or Problem."""

COUNTED = ("NAME", "NUMBER")
"""Words that count as work."""

_RIGHT = frozenset({"and", "or", "imply", "sequence", "open_sequence", "choice"})
_LEFT = frozenset({"sum", "product"})


TABLES = "tables.json"
"""The parser's tables for one version of lark, written by tests/parse/tables.py."""


@dataclass(slots=True)
class Recovery:
    """Mistakes in declarations and Problems: the `problems`, and the ranges that stand-ins took the place of
    (`gaps`). `lost` where declarations may be missing.
    """

    problems: list[Diagnostic] = field(default_factory=list[Diagnostic])
    gaps: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])
    lost: bool = False

    def covers(self, found: Diagnostic) -> bool:
        """Whether it is about a stand-in."""
        return any(start < found.span.end and found.span.start < end for start, end in self.gaps)

    def hides(self, found: Diagnostic) -> bool:
        """Whether it is about a stand-in, or a name that what was there may have declared or written."""
        if self.covers(found) or not found.code.startswith(("undeclared-", "undefined-")):
            return self.covers(found)
        name = re.compile(rf"\b{re.escape(found.span.text)}\b")
        return self.lost or any(name.search(found.span.source.text, *gap) for gap in self.gaps)


@cache
def _parser() -> Lark:
    """The parser, from the tables that come with dl2c. For another version of lark they are made, which takes
    longer than to read them, so lark keeps those.
    """
    kept = _read(files("dl2c.parse").joinpath(TABLES).read_text(encoding="utf-8"))
    if kept["facts"] == facts():
        return Lark._load_from_dict(kept["data"], kept["memo"], lexer_callbacks=_callbacks())  # pyright: ignore
    try:
        folder = private_folder("parser")
        with (folder / "lock").open("w") as lock:  # lark writes in place
            flock(lock, LOCK_EX)
            name = sha256(repr((facts(), sys.version)).encode()).hexdigest()[:32]
            return made_parser(cache=str(folder / name))
    except (StorageError, OSError):
        return made_parser()


def made_parser(cache: str | bool = False, callbacks: bool = True) -> Lark:
    """The parser, from the grammar. `cache` is lark's, where it keeps tables; without `callbacks` no word
    counts as work.
    """
    return Lark(
        _grammar(),
        parser="lalr",
        lexer="contextual",
        start=list(STARTS),
        propagate_positions=True,
        maybe_placeholders=True,
        lexer_callbacks=_callbacks() if callbacks else {},
        cache=cache,
    )


def facts() -> list[str]:
    """What the tables depend on."""
    return [lark.__version__, sha256(_grammar().encode()).hexdigest(), *STARTS]


def _grammar() -> str:
    return files("dl2c.parse").joinpath("grammar.lark").read_text(encoding="utf-8")


def _read(text: str) -> dict[str, Any]:
    """Tables as lark has them: what JSON has as pairs are dicts with keys that are not words."""
    return json.loads(text, object_hook=lambda found: dict(found[""]) if found.keys() == {""} else found)


def _callbacks() -> dict[str, Callable[[Token], Token]]:
    return dict.fromkeys(COUNTED, _counted)


def _counted(token: Token) -> Token:
    spend()
    return token


def parse_tree(code: Code, start: int, end: int, symbol: str, recovery: Recovery | None = None) -> Node:
    """The tree of `code.text[start:end]` read as `symbol`, one of `STARTS`. With a `recovery` mistakes behind
    which reading can go on are entered there, and the tree has stand-ins.
    """
    if not code.text[start:end].strip():
        raise CompileError(errors.nothing_there(code.span(start, end), symbol))
    try:
        tree = _parser().parse(TextSlice(code.text, start, end), start=symbol)  # pyright: ignore[reportUnknownMemberType]
    except UnexpectedInput as problem:
        tree = _recovered(_failure(problem, code, start, end, symbol), recovery)
    _check_depth(tree, code)
    return tree


def _recovered(failure: "Failure", recovery: Recovery | None) -> Node:
    """The tree with stand-ins, if there is one and it is wanted. Else raises the first mistake, and those
    that are found when reading goes on behind it.
    """
    from dl2c.parse.mistakes import closes_nothing, explain
    from dl2c.parse.recovery import without_mistake

    found: list[Diagnostic] = [explain(failure)]
    gaps: list[tuple[int, int]] = []
    lost = False
    while len(found) < MAX_MISTAKES and (resumed := without_mistake(failure)):
        gaps.append(resumed.gap)
        lost |= resumed.blank
        code = replace(failure.code, text=resumed.text)
        start, end = failure.start, failure.end
        try:
            tree = _parser().parse(TextSlice(code.text, start, end), start=failure.symbol)  # pyright: ignore[reportUnknownMemberType]
            if recovery is None:
                break
            recovery.problems += found
            recovery.gaps += gaps
            recovery.lost |= lost
            return tree
        except UnexpectedInput as problem:
            failure = _failure(problem, code, start, end, failure.symbol)
        if failure.length == 0 or failure.place < resumed.after or closes_nothing(failure):
            break
        found.append(explain(failure))
    raise CompileError(found) from None


def _failure(problem: UnexpectedInput, code: Code, start: int, end: int, symbol: str) -> "Failure":
    """The facts of a lark exception. Terminal names become dL words in `mistakes`."""
    from dl2c.parse.mistakes import Failure

    finish = start + len(code.text[start:end].rstrip())
    place, length, is_token = finish, 0, isinstance(problem, UnexpectedToken)
    match problem:
        case UnexpectedToken(token=Token(type="$END")):
            pass
        case UnexpectedToken(token=Token() as token):
            place, length = cast("int", token.start_pos), len(token)
        case UnexpectedCharacters():
            place, length = cast("int", problem.pos_in_stream), 1  # pyright: ignore[reportUnknownMemberType]
        case _:
            raise AssertionError(problem)
    parser = getattr(problem, "interactive_parser", None)
    accepted = frozenset[str](parser.accepts()) if parser is not None else frozenset[str]()
    return Failure(code, start, finish, place, length, is_token, accepted, symbol)


def _check_depth(tree: Node, code: Code) -> None:
    """Refuse text whose syntax tree would be too deep; in a chain every operand is a level."""
    stack = [(tree, 1)]
    while stack:
        spend()
        node, depth = stack.pop()
        if depth > MAX_DEPTH:
            raise CompileError(errors.too_deep(code.span(node.meta.start_pos, node.meta.end_pos), MAX_DEPTH))
        children = [child for child in node.children if isinstance(child, Tree)]
        for place, child in enumerate(children):
            below = place + 1 if node.data in _RIGHT else len(children) - place if node.data in _LEFT else 1
            stack.append((child, depth + below))
