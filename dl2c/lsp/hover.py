"""What a name is, as Markdown: its definition, the same expanded, its unit, limits and description, and who
writes it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress

from dl2c.diagnostics import CompileError
from dl2c.ir.functions import DEFINED, KYX_MATH
from dl2c.lsp import words
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.context import comment_before
from dl2c.lsp.names import EntryNames, Occurrence, Symbol
from dl2c.parse import tree
from dl2c.parse.annotations import Bound, ConstantAnnotation, VariableAnnotation, decode_declaration
from dl2c.parse.printer import decimal, print_formula, print_program, print_term
from dl2c.resolve.expand import NONE, Expander, Values
from dl2c.resolve.symbols import nodes
from dl2c.work import budgeted

LONGEST = 500
"""Characters of a definition that are shown."""

MOST_NODES = 2000
"""Larger definitions are not printed, and neither are larger expansions."""

SECONDS = 0.05
"""For an expansion."""

MANY_LINES = 6

Limits = Mapping[str, tuple[float, float]]
"""Between which numbers names of an entry are at first."""

_AT_WORD = re.compile(r"@?[A-Za-z_]\w*", re.ASCII)


def hover(analysis: Analysis, offset: int, limits: Sequence[Limits] = ()) -> tuple[str, int, int] | None:
    """The text about what stands at a place, and where that is. `limits` has one for each entry."""
    found = analysis.names.at(offset)
    if not found:
        return _word(analysis, offset)
    parts = [text for o in found if (text := "\n\n".join(_about(analysis, o, offset, limits)))]
    return "\n\n---\n\n".join(dict.fromkeys(parts)), found[0].start, found[0].end


def _about(
    analysis: Analysis, occurrence: Occurrence, offset: int, limits: Sequence[Limits]
) -> Iterator[str]:
    symbol = occurrence.symbol
    if symbol.kind == "library":
        yield _library(symbol.name)
        return
    number, entry = _entry(analysis, symbol, offset)
    declaration = symbol.declaration
    yield _code(_signature(symbol) + (_definition(declaration) if declaration else ""))
    yield _role(symbol, occurrence)
    if declaration is not None:
        if number < len(analysis.problems) and analysis.problems[number] is not None:
            yield from _expanded(declaration, entry)
        yield from _annotated(declaration, symbol)
    if number < len(limits) and (ends := limits[number].get(symbol.name)) and not symbol.local:
        yield f"at first in `[{ends[0]:g}, {ends[1]:g}]`"
    if symbol.kind == "variable":
        yield _writers(analysis.names.of(symbol))


def _entry(analysis: Analysis, symbol: Symbol, offset: int) -> tuple[int, EntryNames]:
    """The entry around a place, or else the first that has the symbol, with its number."""
    entries = analysis.names.entries
    around = analysis.names.entry_at(offset)
    assert around is not None
    having = [n for n, e in enumerate(entries) if e is around or e.scope.get(symbol.name) is symbol]
    number = next((n for n in having if entries[n] is around), having[0])
    return number, entries[number]


def _code(text: str) -> str:
    return f"```dl\n{text}\n```"


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."


def _signature(symbol: Symbol) -> str:
    declaration = symbol.declaration
    if declaration is None:
        return f"Real {symbol.name}"
    parameters = declaration.parameters
    listed = "" if parameters is None else f"({', '.join(f'Real {p.name}' for p in parameters)})"
    return f"{declaration.sort} {symbol.name}{listed}"


def _definition(declaration: tree.Declaration) -> str:
    if declaration.body is None:
        return ""
    sign = "=" if declaration.implicit else {"Real": "=", "Bool": "<->", "HP": "::="}[declaration.sort]
    return f" {sign} {_printed(declaration.body)}"


def _printed(node: tree.Expression) -> str:
    if sum(1 for _ in nodes(node)) > MOST_NODES:
        return "..."
    if isinstance(node, tree.Term):
        return _short(print_term(node))
    if isinstance(node, tree.Formula):
        return _short(print_formula(node))
    return _short(f"{{ {print_program(node)} }}")


def _role(symbol: Symbol, occurrence: Occurrence) -> str:
    if symbol.kind == "parameter" and occurrence.within is not None:
        return f"parameter of `{occurrence.within.name}`"
    if symbol.kind == "quantified":
        return "variable of a quantifier"
    return {"variable": "program variable"}.get(symbol.kind, symbol.kind) + (
        "" if symbol.declaration is not None else ", without declaration"
    )


def _expanded(declaration: tree.Declaration, entry: EntryNames) -> Iterator[str]:
    """The body without other definitions, where that is another text."""
    body = declaration.body
    if body is None or declaration.implicit:
        return
    expander = Expander(entry.symbols)
    values: Values = {p.name: tree.Variable(p.name) for p in declaration.parameters or ()}
    with suppress(CompileError), budgeted(SECONDS):
        if isinstance(body, tree.Term):
            expanded: tree.Expression = expander.term(body, values, NONE)
        elif isinstance(body, tree.Formula):
            expanded = expander.formula(body, values, NONE)
        else:
            expanded, _ = expander.program(body, values, NONE)
        if expanded != body and (text := _printed(expanded)) != "...":
            yield f"expanded:\n{_code(text)}"


def _annotated(declaration: tree.Declaration, symbol: Symbol) -> Iterator[str]:
    """What annotations say: in words of a variable or constant, else as they are written."""
    found: list[VariableAnnotation | ConstantAnnotation] = []
    with suppress(CompileError):
        decoded = decode_declaration(declaration, "variable" if symbol.kind == "variable" else "definition")
        found += (a for a in decoded if isinstance(a, VariableAnnotation | ConstantAnnotation))
    for annotation in found:
        if annotation.description:
            yield annotation.description
        if annotation.unit:
            yield f"unit `{annotation.unit}`"
        if annotation.bound is not None:
            low, high = annotation.bound
            yield f"bound `[{_end(low, '-inf')}:{_end(high, 'inf')}]`"
        if isinstance(annotation, VariableAnnotation) and annotation.role is not None:
            yield f"`{annotation.role}` gives `{symbol.name} := *` its value"
    if not found:
        for annotation in declaration.annotations:
            listed = ", ".join(
                f"{name}={value}" if value else name for name, value, _ in annotation.attributes
            )
            yield f"`@{annotation.name}{': ' if listed else ''}{_short(listed)}`"


def _end(end: Bound, infinite: str) -> str:
    if end is None:
        return infinite
    return f"-{decimal(-end)}" if end < 0 else decimal(end)


def _writers(occurrences: Sequence[Occurrence]) -> str:
    """The programs that write a variable, each with the lines."""
    lines: dict[str, list[int]] = {}
    for o in occurrences:
        if o.use == "written" and o.symbol.place is not None:
            name = "the problem" if o.within is None else f"`{o.within.name}`"
            lines.setdefault(name, []).append(o.symbol.place.source.position(o.start)[0])
    if not lines:
        return "nothing writes it: it keeps its first value"
    return "written by " + ", ".join(f"{name} ({_lines(found)})" for name, found in lines.items())


def _lines(found: Sequence[int]) -> str:
    numbers = sorted(set(found))
    shown = ", ".join(map(str, numbers[:MANY_LINES])) + (" ..." if len(numbers) > MANY_LINES else "")
    return f"line{'s' * (len(numbers) > 1)} {shown}"


def _library(name: str) -> str:
    if name not in KYX_MATH:
        return f"{_code(f'{name}(x)')}\n\nin an invariant: the value before the loop or flow"
    names = ("x", "y", "z")[: KYX_MATH[name]]
    call = f"{name}({', '.join(names)})" if names else name
    meaning = f" = {DEFINED[name][1]}" if name in DEFINED else ""
    return f"{_code(call + meaning)}\n\nof the library kyx.math"


def _word(analysis: Analysis, offset: int) -> tuple[str, int, int] | None:
    """What an annotation, an attribute of one, or a keyword means."""
    text = analysis.source.text
    line = text.rfind("\n", 0, offset) + 1
    found = next((m for m in _AT_WORD.finditer(text, line) if m.end() >= offset), None)
    if found is None or found.start() > offset:
        return None
    word = found.group()
    comment = comment_before(text, found.start())
    if word.startswith("@"):
        about = words.ANNOTATIONS.get(word[1:], "") if comment is not None else ""
    elif comment is not None:
        named = comment.annotation is not None and comment.named and comment.attribute is None
        about = words.meaning(comment.annotation or "", word) if named else ""
    else:
        about = words.KEYWORDS.get(word, "")
    return (f"`{word}`: {about}", found.start(), found.end()) if about else None
