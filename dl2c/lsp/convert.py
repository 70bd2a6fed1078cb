"""What is known of a model, in the types of the protocol."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

from lsprotocol import types

from dl2c.diagnostics import Diagnostic
from dl2c.lint.edits import Edit
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.complete import Item, ItemKind
from dl2c.lsp.documents import View
from dl2c.lsp.outline import Fold, Part, PartKind
from dl2c.lsp.positions import UNCHANGED, Encoding, Lines
from dl2c.lsp.tokens import KINDS, Token, all_tokens

MOST_SHOWN = 500
"""Diagnostics of one file."""

_SYMBOLS: dict[PartKind, types.SymbolKind] = {
    "entry": types.SymbolKind.Module,
    "variable": types.SymbolKind.Variable,
    "constant": types.SymbolKind.Constant,
    "function": types.SymbolKind.Function,
    "predicate": types.SymbolKind.Boolean,
    "program": types.SymbolKind.Method,
    "problem": types.SymbolKind.Interface,
}
_ITEMS: dict[ItemKind, types.CompletionItemKind] = {
    "variable": types.CompletionItemKind.Variable,
    "constant": types.CompletionItemKind.Constant,
    "function": types.CompletionItemKind.Function,
    "predicate": types.CompletionItemKind.Function,
    "program": types.CompletionItemKind.Method,
    "parameter": types.CompletionItemKind.Variable,
    "quantified": types.CompletionItemKind.Variable,
    "library": types.CompletionItemKind.Function,
    "annotation": types.CompletionItemKind.Property,
    "attribute": types.CompletionItemKind.Property,
    "value": types.CompletionItemKind.EnumMember,
    "keyword": types.CompletionItemKind.Keyword,
    "snippet": types.CompletionItemKind.Snippet,
}
_KNOWN: WeakKeyDictionary[Analysis, tuple[Encoding, list[int]]] = WeakKeyDictionary()
_NUMBERS = {kind: number for number, kind in enumerate(KINDS)}


def position_of(lines: Lines, offset: int) -> types.Position:
    return types.Position(*lines.position(min(offset, len(lines.text))))


def range_of(lines: Lines, start: int, end: int) -> types.Range:
    return types.Range(position_of(lines, start), position_of(lines, max(start, end)))


def moved(view: View, start: int, end: int) -> types.Range:
    """A range of the analysis in the present text."""
    return range_of(view.lines, *view.shift.later(start, end))


def text_edits(lines: Lines, edits: Iterable[Edit], ending: str) -> list[types.TextEdit]:
    return [types.TextEdit(range_of(lines, e.start, e.end), e.text.replace("\n", ending)) for e in edits]


def diagnostics(found: Sequence[Diagnostic], lines: Lines) -> list[types.Diagnostic]:
    """The first of them: what is wrong and where in the title and the label, then notes and advice."""
    return [_diagnostic(d, lines) for d in found[:MOST_SHOWN]]


def _diagnostic(d: Diagnostic, lines: Lines) -> types.Diagnostic:
    headline = f"{d.title}: {d.label}" if d.label else d.title
    advice = [f"help: {d.help}"] if d.help else []
    error = d.severity == "error"
    return types.Diagnostic(
        range=range_of(lines, d.span.start, d.span.end),
        message="\n".join((headline, *d.notes, *advice)),
        severity=types.DiagnosticSeverity.Error if error else types.DiagnosticSeverity.Warning,
        code=d.code,
        source="dl2c",
    )


def symbols(parts: Iterable[Part], view: View) -> list[types.DocumentSymbol]:
    return [
        types.DocumentSymbol(
            name=part.name,
            kind=_SYMBOLS[part.kind],
            range=moved(view, part.start, part.end),
            selection_range=moved(view, part.name_start, part.name_end),
            detail=part.detail or None,
            children=symbols(part.parts, view) or None,
        )
        for part in parts
    ]


def folding(folds: Iterable[Fold], view: View) -> list[types.FoldingRange]:
    found: list[types.FoldingRange] = []
    for fold in folds:
        first, last = (view.lines.position(at)[0] for at in view.shift.later(fold.start, fold.end))
        kind = types.FoldingRangeKind.Comment if fold.comment else types.FoldingRangeKind.Region
        if last > first:
            found.append(types.FoldingRange(start_line=first, end_line=last, kind=kind))
    return found


def item(found: Item, where: types.Range, snippets: bool) -> types.CompletionItem:
    """`snippets` says whether the editor can fill places in."""
    fill = found.fill and snippets
    return types.CompletionItem(
        label=found.label,
        kind=_ITEMS[found.kind],
        detail=found.detail or None,
        filter_text=found.label,
        insert_text_format=types.InsertTextFormat.Snippet if fill else types.InsertTextFormat.PlainText,
        text_edit=types.TextEdit(where, found.text if fill or not found.fill else found.label),
    )


def all_encoded(view: View) -> list[int]:
    """The words of the whole text: as they are in the analysis, but for where the text has changed since."""
    found, shift, encoding = all_tokens(view.analysis), view.shift, view.lines.encoding
    known = _KNOWN.get(view.analysis)
    if known is None or known[0] != encoding:
        lines = Lines(view.analysis.source.text, encoding)
        _KNOWN[view.analysis] = known = encoding, encoded(found, replace(view, lines=lines, shift=UNCHANGED))
    if view.fresh:
        return known[1]
    first = bisect_right(found, shift.start, key=lambda t: t.end)
    last = bisect_left(found, shift.end, lo=first, key=lambda t: t.start) + 1
    before = found[first - 1].start if first else 0
    return known[1][: 5 * first] + encoded(found[first:last], view, before) + known[1][5 * last :]


def encoded(tokens: Iterable[Token], view: View, before: int = 0) -> list[int]:
    """Five numbers for each: lines and units since the one before, length, kind, modifiers. `before` is where
    one begins in the present text that is before the first.
    """
    data: list[int] = []
    text, starts, later = view.lines.text, [*view.lines.starts, len(view.lines.text) + 1], view.shift.later
    units = len if text.isascii() else view.lines.units
    line, column = view.lines.position(before)
    here = line
    for token in tokens:
        start, end = later(token.start, token.end)
        while starts[here + 1] <= start:
            here += 1
        at = units(text[starts[here] : start])
        data += (here - line, at - column if here == line else at, units(text[start:end]))
        data += (_NUMBERS[token.kind], token.modifiers)
        line, column = here, at
    return data
