"""Renaming a symbol, with everything that is bound by its name.

In: an analysis without errors of syntax, a place, a new name. Out: edits, after which the text means the
same. A parameter of an annotated definition that no call binds stands for the variable or constant of its
name: then both get the new name.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import get_args

from dl2c.diagnostics import CompileError, Mistake
from dl2c.lint.edits import Edit
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.names import LIBRARY, EntryNames, Occurrence, Symbol
from dl2c.parse import tree
from dl2c.parse.annotations import Category
from dl2c.parse.parser import parse_term
from dl2c.resolve.predicates import arguments_of
from dl2c.resolve.problem import Problem

_CALLED = re.compile(r"\s*\(")
PREDICATES = get_args(Category)

RESERVED = frozenset({"if", "else"})
"""Words of programs that the grammar takes for names elsewhere."""


class Refused(Mistake):
    """A name that cannot be changed, or not to this; the message says why."""


@dataclass(frozen=True, slots=True)
class Renaming:
    """`tactics` are the entries whose tactics, which stay as they are, have the old name."""

    edits: tuple[Edit, ...]
    tactics: tuple[str, ...]


def renamable(analysis: Analysis, offset: int) -> Occurrence:
    """The name at a place. Raises `Refused`."""
    if not analysis.readable:
        raise Refused("correct the errors of syntax first: names in what cannot be read would be missed")
    found = analysis.names.at(offset)
    if not found:
        raise Refused("there is no name of the model here")
    if any(o.symbol.kind == "library" for o in found):
        raise Refused(f"`{found[0].symbol.name}` belongs to the library")
    return found[0]


def rename(analysis: Analysis, offset: int, new: str) -> Renaming:
    """Raises `Refused` where the new name is none, or means something already where the old one is used."""
    old = renamable(analysis, offset).symbol.name
    _check_name(new)
    if new == old:
        return Renaming((), ())
    symbols = _linked(analysis, [o.symbol for o in analysis.names.at(offset)])
    for symbol in symbols:
        _check_meaning(analysis, symbol, new)
    places = {(o.start, o.end) for symbol in symbols for o in analysis.names.of(symbol)}
    edits = tuple(Edit(start, end, new) for start, end in sorted(places))
    return Renaming(edits, tuple(_tactics(analysis, old, symbols)))


def _check_name(new: str) -> None:
    try:
        is_name = parse_term(new) == tree.Variable(new) and new not in RESERVED
    except CompileError:
        is_name = False
    if not is_name:
        raise Refused(f"`{new}` is not a name: letters and digits, then perhaps `_` and a number")
    if new in LIBRARY:
        raise Refused(f"`{new}` means a function or number of the library")


def _check_meaning(analysis: Analysis, symbol: Symbol, new: str) -> None:
    """That the new name means nothing where the symbol is used, nor the symbol where the new name is."""
    for occurrence in analysis.names.of(symbol):
        if (other := occurrence.local.get(new)) is not None:
            raise _clash(new, other)
    if symbol.local:
        for o in analysis.names.occurrences:
            if o.symbol.name == new and o.local.get(symbol.name) is symbol:
                raise _clash(new, o.symbol)
        return
    for entry in analysis.names.entries:
        if entry.scope.get(symbol.name) is symbol and new in entry.scope:
            raise _clash(new, entry.scope[new])


def _clash(new: str, other: Symbol) -> Refused:
    where = f", declared at {other.place.line}:{other.place.column}" if other.place is not None else ""
    return Refused(f"`{new}` is the name of another {other.kind} there{where}")


def _linked(analysis: Analysis, symbols: Iterable[Symbol]) -> tuple[Symbol, ...]:
    """The symbols, and those that must have the same name."""
    names = analysis.names
    pairs = [
        pair
        for entry, problem in zip(names.entries, analysis.problems, strict=True)
        for pair in _namesakes(entry, problem, analysis.source.text)
    ]
    found = names.together(symbols)
    while True:
        known = {id(s) for s in found}
        more = [s for pair in pairs for s in pair if known & {id(p) for p in pair} and id(s) not in known]
        if not more:
            return found
        found = names.together((*found, *more))


def _namesakes(entry: EntryNames, problem: Problem | None, text: str) -> Iterator[tuple[Symbol, Symbol]]:
    """Parameters, each with the symbol that it stands for because it has the same name: those of annotated
    definitions, and of predicates without arguments in rewards.
    """
    parameters = {o.start: o.symbol for o in entry.occurrences if o.symbol.kind == "parameter"}
    bare = {
        o.symbol.name
        for o in entry.occurrences
        if o.symbol.kind == "predicate" and o.use == "read" and not _CALLED.match(text, o.end)
    }
    for declaration in entry.entry.definitions:
        if declaration.name not in bare and all(a.name not in PREDICATES for a in declaration.annotations):
            continue
        for parameter in _unbound(declaration, problem):
            own, other = parameters.get(parameter.span.start), entry.scope.get(parameter.name)
            if own is not None and other is not None:
                yield own, other


def _unbound(declaration: tree.Declaration, problem: Problem | None) -> Iterator[tree.Parameter]:
    """The parameters that no call binds; all, where that is not known."""
    parameters = declaration.parameters or ()
    arguments: tuple[tree.Term, ...] = ()
    if problem is not None:
        try:
            arguments = arguments_of(declaration, problem.shape, problem.symbols)
        except CompileError:
            arguments = ()
    for k, parameter in enumerate(parameters):
        if not arguments or arguments[k].span == parameter.span:
            yield parameter


def _tactics(analysis: Analysis, old: str, symbols: Iterable[Symbol]) -> Iterator[str]:
    """The names of entries that have one of the symbols, and the old name in a tactic."""
    word = re.compile(rf"(?<![A-Za-z0-9_]){re.escape(old)}(?![A-Za-z0-9_])")
    text = analysis.source.text
    wanted = {id(s) for s in symbols}
    for entry in analysis.names.entries:
        span = entry.entry.span
        tactics = (s for s in analysis.sections if s.kind == "Tactic" and span.start <= s.start < span.end)
        if any(word.search(text, s.begin, s.end) for s in tactics) and any(
            id(o.symbol) in wanted for o in entry.occurrences
        ):
            yield entry.entry.name
