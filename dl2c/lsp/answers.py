"""Answers to questions about names and files: what a name is, where it is declared and used, what to type;
the outline and colours of a file, what may be folded, how its mistakes are mended.
"""

from typing import Any

from lsprotocol import types

from dl2c.lsp import convert
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.complete import completions
from dl2c.lsp.context import comment_before
from dl2c.lsp.documents import LONG_PATIENCE, Document, View
from dl2c.lsp.fixes import corrections
from dl2c.lsp.hover import hover
from dl2c.lsp.names import Occurrence
from dl2c.lsp.outline import folds, parts
from dl2c.lsp.rename import Refused, Renaming, renamable, rename
from dl2c.lsp.server import ModelServer, about, place, value, written
from dl2c.lsp.tokens import KINDS, MODIFIERS, tokens

TRIGGERS = ("@", ":", ",", "=", " ")


# ---------------------------------------------------------------- names


def answer_about_names(server: ModelServer) -> None:
    about(server, types.TEXT_DOCUMENT_HOVER)(_hover)
    about(server, types.TEXT_DOCUMENT_DEFINITION)(_definition)
    about(server, types.TEXT_DOCUMENT_REFERENCES)(_references)
    about(server, types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)(_highlights)
    about(server, types.TEXT_DOCUMENT_PREPARE_RENAME)(_prepare_rename)
    about(server, types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))(_rename)
    triggers = types.CompletionOptions(trigger_characters=list(TRIGGERS))
    about(server, types.TEXT_DOCUMENT_COMPLETION, triggers)(_complete)


def _occurrences(view: View, position: types.Position) -> tuple[Occurrence, ...]:
    return view.analysis.names.at(place(view, position))


async def _hover(server: ModelServer, document: Document, params: types.HoverParams) -> types.Hover | None:
    view = await document.view_at(written(params.position))
    found = hover(view.analysis, place(view, params.position), view.limits)
    if found is None:
        return None
    text, start, end = found
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, convert.moved(view, start, end))


async def _definition(
    server: ModelServer, document: Document, params: types.DefinitionParams
) -> list[types.Location] | None:
    view = await document.view_at(written(params.position))
    places = [o.symbol.place for o in _occurrences(view, params.position) if o.symbol.place is not None]
    uri = params.text_document.uri
    return [types.Location(uri, convert.moved(view, p.start, p.end)) for p in places] or None


async def _references(
    server: ModelServer, document: Document, params: types.ReferenceParams
) -> list[types.Location]:
    view = await _view_of_name(document, params.position)
    found = _all_of(view, params.position)
    if not params.context.include_declaration:
        found = [o for o in found if o.use != "declared"]
    uri = params.text_document.uri
    return [types.Location(uri, convert.moved(view, o.start, o.end)) for o in found]


async def _highlights(
    server: ModelServer, document: Document, params: types.DocumentHighlightParams
) -> list[types.DocumentHighlight]:
    view = await _view_of_name(document, params.position)
    kinds = {True: types.DocumentHighlightKind.Write, False: types.DocumentHighlightKind.Read}
    return [
        types.DocumentHighlight(convert.moved(view, o.start, o.end), kinds[o.use == "written"])
        for o in _all_of(view, params.position)
    ]


async def _view_of_name(document: Document, position: types.Position) -> View:
    """What is known about every place of a name; one that entries share may be anywhere in the file."""
    view = await document.view_at(written(position))
    places = [o.symbol.place for o in _occurrences(view, position)]
    shared = any(place is None or place.start < view.shift.start for place in places)
    return await document.view() if shared else view


def _all_of(view: View, position: types.Position) -> list[Occurrence]:
    """Every place of what the name at a position may stand for, each once."""
    names = view.analysis.names
    found = {o.start: o for here in _occurrences(view, position) for o in names.of(here.symbol)}
    return [found[start] for start in sorted(found)]


async def _prepare_rename(
    server: ModelServer, document: Document, params: types.PrepareRenameParams
) -> types.Range:
    view = await document.view(LONG_PATIENCE)
    found = renamable(_present(view), place(view, params.position))
    return convert.moved(view, found.start, found.end)


async def _rename(server: ModelServer, document: Document, params: types.RenameParams) -> types.WorkspaceEdit:
    view = await document.view(LONG_PATIENCE)
    done = rename(_present(view), place(view, params.position), params.new_name)
    _tell_of_tactics(server, done)
    edits = convert.text_edits(view.lines, done.edits, document.ending)
    return types.WorkspaceEdit(changes={params.text_document.uri: edits})


def _present(view: View) -> Analysis:
    """The analysis, which must be of the present text. Raises `Refused`."""
    if not view.fresh:
        raise Refused("the text is still being read: try again in a moment")
    return view.analysis


def _tell_of_tactics(server: ModelServer, done: Renaming) -> None:
    if done.tactics:
        entries = ", ".join(f'"{name}"' for name in done.tactics)
        message = f"dl2c: the tactics of {entries} still have the old name: they are not read"
        server.window_show_message(types.ShowMessageParams(types.MessageType.Warning, message))


async def _complete(
    server: ModelServer, document: Document, params: types.CompletionParams
) -> types.CompletionList:
    view = await document.view_at(written(params.position))
    at = view.lines.offset(written(params.position))
    start, items = completions(view.analysis, view.lines.text, at, view.shift.earlier(at))
    where = convert.range_of(view.lines, start, at)
    if params.context is not None and not _is_wanted(view.lines.text, at, params.context.trigger_character):
        items = ()
    return types.CompletionList(False, [convert.item(item, where, server.snippets) for item in items])


def _is_wanted(text: str, at: int, trigger: str | None) -> bool:
    """Whether a character by itself asks for completion: in comments alone, a blank before attributes."""
    if trigger is None:
        return True
    listed = trigger != " " or text[max(0, at - 100) : at].rstrip().endswith((":", ",", ";"))
    return listed and comment_before(text, at) is not None


# ---------------------------------------------------------------- files


def answer_about_files(server: ModelServer) -> None:
    about(server, types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)(_symbols)
    about(server, types.TEXT_DOCUMENT_FOLDING_RANGE)(_folding)
    actions = [types.CodeActionKind.QuickFix, types.CodeActionKind.SourceFixAll]
    about(server, types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions(code_action_kinds=actions))(
        _actions
    )
    legend = types.SemanticTokensLegend(list(KINDS), list(MODIFIERS))
    about(server, types.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL, legend)(_tokens)
    about(server, types.TEXT_DOCUMENT_SEMANTIC_TOKENS_RANGE, legend)(_tokens_of_range)


async def _symbols(
    server: ModelServer, document: Document, params: types.DocumentSymbolParams
) -> list[types.DocumentSymbol]:
    view = await document.view_of_sections()
    return convert.symbols(parts(view.analysis), view)


async def _folding(
    server: ModelServer, document: Document, params: types.FoldingRangeParams
) -> list[types.FoldingRange]:
    view = await document.view_of_sections()
    return convert.folding(folds(view.analysis), view)


async def _actions(
    server: ModelServer, document: Document, params: types.CodeActionParams
) -> list[types.CodeAction]:
    if document.long and not document.settled:
        return []  # asked again when there are diagnostics
    view = await document.view()
    if not view.fresh:
        return []
    lines, uri = view.lines, params.text_document.uri
    start, end = (lines.offset(written(p)) for p in (params.range.start, params.range.end))
    found: list[types.CodeAction] = []
    diagnostics = document.diagnostics
    for correction in await server.aside(lambda: [*corrections(view.analysis, diagnostics, start, end)]):
        answers = correction.answers
        action = types.CodeAction(
            correction.title,
            kind=types.CodeActionKind.QuickFix if answers else types.CodeActionKind.SourceFixAll,
            diagnostics=convert.diagnostics([answers], lines) if answers else None,
            edit=types.WorkspaceEdit({uri: convert.text_edits(lines, correction.edits, document.ending)}),
        )
        found.append(action)
    wanted = params.context.only
    return [a for a in found if wanted is None or any(_is_kind(a.kind, kind) for kind in wanted)]


def _is_kind(kind: Any, wanted: Any) -> bool:
    """Whether a kind is another one, or a part of it: `source.fixAll` is one of `source`."""
    return f"{value(kind)}.".startswith(f"{value(wanted)}.")


async def _tokens(
    server: ModelServer, document: Document, params: types.SemanticTokensParams
) -> types.SemanticTokens:
    view = await (document.view_of_sections() if document.long else document.view())
    document.coloured_before |= not document.settled
    return types.SemanticTokens(convert.all_encoded(view))


async def _tokens_of_range(
    server: ModelServer, document: Document, params: types.SemanticTokensRangeParams
) -> types.SemanticTokens:
    view = await document.view()
    begin, end = place(view, params.range.start), place(view, params.range.end)
    return types.SemanticTokens(convert.encoded(tokens(view.analysis, begin, end), view))
