"""Every name in a file: where it stands and what it stands for.

In: the entries of an archive, as parsed. Out: `Names`, an occurrence for each place where a name is
declared, read, written or called, annotations included. Parameters and the variables of quantifiers hide
other names in their scope. A definition that entries share is one symbol; a name in it may stand for
another symbol in each entry. Tactics and prose are not looked into.
"""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.parse.annotations import EXPRESSIONS, expression
from dl2c.parse.scan import Code
from dl2c.resolve.bind import IN_HINTS
from dl2c.resolve.infer import with_inferred
from dl2c.resolve.quantified import without_quantifiers
from dl2c.resolve.scene import written_terms
from dl2c.resolve.symbols import BUILTINS, NULLARY_BUILTINS, Node, Symbols, children, collect, own_names
from dl2c.source import Span
from dl2c.work import spend

Kind: TypeAlias = Literal[
    "variable", "constant", "function", "predicate", "program", "parameter", "quantified", "library"
]
Use: TypeAlias = Literal["declared", "read", "written"]

LIBRARY = frozenset({*BUILTINS, *NULLARY_BUILTINS, *(name.removesuffix("()") for name in IN_HINTS)})
"""Names that mean something without a declaration."""

_FIRST_NAME = re.compile(r"[\s({\[<]*([A-Za-z]\w*)", re.ASCII)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_QUANTIFIER = re.compile(r"[\s(]*(?:\\forall|\\exists|∀|∃)([\sA-Za-z0-9_,]+)")
_IMPORT = re.compile(r"\bimport\s+\w+(?:\.\w+)*\.(?:\{([^{};]*)\}|(\w+))\s*;", re.ASCII)
_TABOO = re.compile(r"\|([^|]*)\|")


@dataclass(frozen=True, slots=True, eq=False)
class Symbol:
    """What a name stands for: `place` is where it is declared, or first used if nothing declares it; None for
    functions of the library, which a model may declare without definition. `declaration` is None for names
    with a scope of their own.
    """

    name: str
    kind: Kind
    place: Span | None
    declaration: tree.Declaration | None = None

    @property
    def local(self) -> bool:
        return self.kind in ("parameter", "quantified")


Scope: TypeAlias = Mapping[str, Symbol]


@dataclass(frozen=True, slots=True, eq=False)
class Occurrence:
    """A name at `start` to `end` of the text. `within` is the definition around it, None in a problem;
    `local` are the names with a scope of their own that can be used there.
    """

    start: int
    end: int
    symbol: Symbol
    use: Use
    within: tree.Declaration | None
    local: Scope


@dataclass(frozen=True, slots=True, eq=False)
class EntryNames:
    """The names of one entry: what can be used everywhere in it, and all occurrences."""

    entry: tree.Entry
    symbols: Symbols
    scope: Scope
    occurrences: tuple[Occurrence, ...]


@dataclass(frozen=True, eq=False)
class Names:
    """The names of all entries."""

    entries: tuple[EntryNames, ...] = ()

    @cached_property
    def occurrences(self) -> tuple[Occurrence, ...]:
        """In the order of the text; one for each symbol that a name at a place may stand for."""
        found: dict[tuple[int, int], Occurrence] = {}
        for entry in self.entries:
            for o in entry.occurrences:
                found.setdefault((o.start, id(o.symbol)), o)
        return tuple(sorted(found.values(), key=lambda o: o.start))

    @cached_property
    def _by_symbol(self) -> Mapping[int, list[Occurrence]]:
        found: dict[int, list[Occurrence]] = {}
        for o in self.occurrences:
            found.setdefault(id(o.symbol), []).append(o)
        return found

    def at(self, offset: int) -> tuple[Occurrence, ...]:
        """The occurrences that touch a place: several where a shared name has several meanings."""
        last = bisect_right(self.occurrences, offset, key=lambda o: o.start)
        near = self.occurrences[max(0, last - 2 * len(self.entries) - 2) : last]
        touched = [o for o in near if o.start <= offset <= o.end]
        starts = [o.start for o in touched if offset < o.end] or [o.start for o in touched]
        return tuple(o for o in touched if o.start == starts[-1])

    def of(self, symbol: Symbol) -> Sequence[Occurrence]:
        """All occurrences of a symbol, in order."""
        return self._by_symbol.get(id(symbol), ())

    def together(self, symbols: Iterable[Symbol]) -> tuple[Symbol, ...]:
        """The symbols, and all that share a place in the text with one of them."""
        places: dict[int, list[Symbol]] = {}
        for o in self.occurrences:
            places.setdefault(o.start, []).append(o.symbol)
        found = {id(s): s for s in symbols}
        waiting = list(found.values())
        while waiting:
            for o in self.of(waiting.pop()):
                for other in places[o.start]:
                    if id(other) not in found:
                        found[id(other)] = other
                        waiting.append(other)
        return tuple(found.values())

    def entry_at(self, offset: int) -> EntryNames | None:
        """The entry around a place, or the first one for what stands before all entries."""
        around = [e for e in self.entries if e.entry.span.start <= offset]
        return around[-1] if around else next(iter(self.entries), None)


def names_of(archive: tree.Archive, code: Code) -> Names:
    """The names of all entries of an archive, which was read from `code`."""
    known: dict[tuple[int, str], Symbol] = {}
    library: dict[str, Symbol] = {}
    return Names(tuple(_Entry(entry, code, known, library).read() for entry in archive.entries))


@dataclass(slots=True)
class _Entry:
    """One entry being read. `known` are symbols by the places of their declarations, in any entry."""

    entry: tree.Entry
    code: Code
    known: dict[tuple[int, str], Symbol]
    library: dict[str, Symbol]
    scope: dict[str, Symbol] = field(default_factory=dict[str, Symbol])
    opened: frozenset[tuple[str, Span]] = frozenset()
    found: dict[tuple[int, int], Occurrence] = field(default_factory=dict[tuple[int, int], Occurrence])
    within: tree.Declaration | None = None
    text: str = ""

    def read(self) -> EntryNames:
        complete, _ = with_inferred(self.entry)
        symbols, _ = collect(complete)
        self.opened = frozenset((d.name, d.span) for d in without_quantifiers(self.entry).declared)
        for name, declaration in symbols.declarations.items():
            arity = len(declaration.parameters or ())
            role = "library" if symbols.is_builtin(name, arity) else symbols.roles[name]
            self.scope[name] = self._symbol(declaration, role)
        self.text = self.code.text
        for declaration in (*self.entry.definitions, *self.entry.variables):
            self._add(declaration.span, self.scope[declaration.name], "declared", {})
        for group in _together(self.entry.definitions):
            self._definition(group)
        self.within = None
        self._visit(self.entry.problem, {})
        for annotation in self.entry.problem_annotations:
            self._annotation(annotation, {})
        self._imports()
        return EntryNames(self.entry, symbols, self.scope, tuple(self.found.values()))

    def _symbol(self, declaration: tree.Declaration, role: Kind) -> Symbol:
        """Declared names are known by their place; others are those of this entry."""
        written = any(d is declaration for d in (*self.entry.definitions, *self.entry.variables))
        place = declaration.span if written else self._first(declaration)
        key = (place.start, declaration.name)
        if key not in self.known:
            self.known[key] = Symbol(declaration.name, role, place, declaration if written else None)
        return self.known[key]

    def _first(self, inferred: tree.Declaration) -> Span:
        """Where a name that nothing declares is bound by a quantifier, or else first used."""
        span = next((span for name, span in self.opened if name == inferred.name), inferred.span)
        found = re.compile(rf"(?<!\w){inferred.name}(?!\w)").search(self.code.text, span.start, span.end)
        return Span(span.source, *found.span()) if found else span

    def _definition(self, group: Sequence[tree.Declaration]) -> None:
        """One statement: several functions may be defined together, with one body."""
        own = own_names(group[0]) - {d.name for d in group}
        local: dict[str, Symbol] = {}
        for declaration in group:
            self.within = declaration
            for parameter in declaration.parameters or ():
                kept = local.get(parameter.name) if group[0].implicit else None
                local[parameter.name] = kept or self._local(parameter.name, "parameter", parameter.span)
                self._add(parameter.span, local[parameter.name], "declared", local)
        self.within = group[0]
        for name in sorted(own - local.keys()):
            local[name] = self._local(name, "parameter", self._own_place(name, group[0].body))
        if group[0].body is not None:
            self._visit(group[0].body, local)
        for annotation in group[0].annotations:
            self._annotation(annotation, local)

    def _local(self, name: str, kind: Kind, place: Span) -> Symbol:
        return self.known.setdefault((place.start, name), Symbol(name, kind, place))

    def _own_place(self, name: str, body: tree.Expression | None) -> Span:
        """Where a variable of an implicit definition first stands."""
        assert body is not None
        found = re.compile(rf"\b{name}\b").search(self.code.text, body.span.start, body.span.end)
        return Span(body.span.source, *found.span()) if found else body.span

    # -------------------------------------------------------------- expressions

    def _visit(self, node: Node, local: Scope) -> None:
        spend()
        match node:
            case tree.Quantified(name, child):
                self._quantified(node, name, child, local)
                return
            case (
                tree.Variable(name)
                | tree.DifferentialSymbol(name)
                | tree.FuncOf(name)
                | tree.PredOf(name)
                | tree.ProgramConst(name)
                | tree.PredicationalOf(name)
            ):
                self._use(node.span, name, "read", local)
            case (
                tree.UnitFunctional(name, taboo)
                | tree.UnitPredicational(name, taboo)
                | tree.DifferentialProgramConst(name, taboo)
            ):
                self._use(node.span, name, "read", local)
                self._taboo(node.span, taboo or (), local)
            case tree.Assign(name) | tree.AssignAny(name) | tree.AtomicODE(name):
                self._use(node.span, name, "written", local)
            case _:
                pass
        for child in (*children(node), *_hints(node)):
            self._visit(child, local)

    def _quantified(self, node: tree.Quantified, name: str, child: tree.Formula, local: Scope) -> None:
        place = self._bound_place(node.span, name)
        if (name, node.span) in self.opened:
            if place is not None:
                self._add(place, self.scope[name], "declared", local)
            self._visit(child, local)
            return
        bound = self._local(name, "quantified", place or node.span)
        inner = {**local, name: bound}
        if place is not None:
            self._add(place, bound, "declared", inner)
        self._visit(child, inner)

    def _bound_place(self, span: Span, name: str) -> Span | None:
        names = _QUANTIFIER.match(self.text, span.start, span.end)
        found = re.compile(rf"(?<!\w){name}(?!\w)").search(self.text, *names.span(1)) if names else None
        return Span(span.source, *found.span()) if found else None

    def _taboo(self, span: Span, taboo: Iterable[str], local: Scope) -> None:
        bars = _TABOO.search(self.text, span.start, span.end)
        for word in _NAME.finditer(self.text, *bars.span(1)) if bars and taboo else ():
            self._use(Span(span.source, *word.span()), word.group(), "read", local)

    def _use(self, span: Span, name: str, use: Use, local: Scope) -> None:
        """A name that is the first one of a node, which may stand in parentheses."""
        first = _FIRST_NAME.match(self.text, span.start, span.end)
        if first is None or first.group(1) != name:
            return  # an argument without name, or the hole of an exercise
        symbol = local.get(name) or self.scope.get(name)
        if symbol is None and name in LIBRARY:
            symbol = self.library.setdefault(name, Symbol(name, "library", None))
        if symbol is not None:
            self._add(Span(span.source, *first.span(1)), symbol, use, local)

    def _add(self, span: Span, symbol: Symbol, use: Use, local: Scope) -> None:
        if span.text == symbol.name:
            kept = self.found.get((span.start, span.end))
            if kept is None or kept.use != "declared":
                self.found[span.start, span.end] = Occurrence(
                    span.start, span.end, symbol, use, self.within, local
                )

    # -------------------------------------------------------------- elsewhere

    def _annotation(self, annotation: tree.Annotation, local: Scope) -> None:
        for name, text, span in annotation.attributes:
            for value in _values(annotation.name, name, text, span):
                self.text = span.source.text
                self._visit(value, local)
                self.text = self.code.text

    def _imports(self) -> None:
        """The names in `import` statements of the entry; those before all entries belong to each."""
        if not self.entry.imports:
            return
        for statement in _IMPORT.finditer(self.code.text, 0, self.entry.span.end):
            for word in _NAME.finditer(self.code.text, *statement.span(1 if statement[1] else 2)):
                if word.group() in LIBRARY and word.group() not in self.scope:
                    symbol = self.library.setdefault(word.group(), Symbol(word.group(), "library", None))
                    self._add(Span(self.code.source, *word.span()), symbol, "read", {})


def _values(annotation: str, attribute: str, text: str, span: Span) -> Iterator[tree.Expression]:
    """The terms and formulas in an attribute, as far as they can be read."""
    if annotation == "scene":
        yield from written_terms(span)
    elif attribute in EXPRESSIONS and text:
        with suppress(CompileError):
            yield expression(text, span)


def _hints(node: Node) -> tuple[tree.Formula, ...]:
    """The invariants of a loop or flow."""
    return node.invariants if isinstance(node, (tree.Loop, tree.ODESystem)) else ()


def _together(declarations: Iterable[tree.Declaration]) -> Iterator[list[tree.Declaration]]:
    """Declarations, those of one implicit definition together."""
    group: list[tree.Declaration] = []
    for declaration in declarations:
        if group and declaration.implicit and group[0].body is declaration.body:
            group.append(declaration)
            continue
        if group:
            yield group
        group = [declaration]
    if group:
        yield group
