"""The language server: questions of the protocol, each answered from a `Document`.

Positions are in the units that the editor offers, UTF-16 by default. Texts come whole with each change.
"""

import asyncio
import gc
import logging
import os
import sys
import traceback
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar, cast

from lsprotocol import types
from pygls.exceptions import FeatureRequestError, JsonRpcException
from pygls.lsp.server import LanguageServer
from pygls.uris import to_fs_path

from dl2c.lsp import convert
from dl2c.lsp.analysis import Analysis
from dl2c.lsp.checker import Checker
from dl2c.lsp.complete import completions
from dl2c.lsp.context import comment_before
from dl2c.lsp.documents import LONG_PATIENCE, Document, View
from dl2c.lsp.fixes import corrections
from dl2c.lsp.hover import hover
from dl2c.lsp.names import Occurrence
from dl2c.lsp.outline import folds, parts
from dl2c.lsp.positions import Encoding
from dl2c.lsp.rename import Refused, Renaming, renamable, rename
from dl2c.lsp.tokens import KINDS, MODIFIERS, tokens
from dl2c.progress import LOG
from dl2c.version import __version__

SWITCH_INTERVAL = 0.001
"""Seconds that a thread may work before another one gets its turn: questions wait for it."""

GARBAGE = (100_000, 50, 100)
"""When Python looks for circles: trees have none, and looking through large ones delays answers."""

TRIGGERS = ("@", ":", ",", "=", " ")

_Params = TypeVar("_Params")
_Answer = TypeVar("_Answer")
_Handler = Callable[["ModelServer", Document, _Params], Coroutine[Any, Any, _Answer]]


class ModelServer(LanguageServer):
    """The server, with the files that are open."""

    def __init__(self) -> None:
        whole = types.TextDocumentSyncKind.Full
        super().__init__("dl2c", __version__, text_document_sync_kind=whole)  # pyright: ignore[reportUnknownMemberType]
        self.documents: dict[str, Document] = {}
        self.checker = Checker()
        self._executor = ThreadPoolExecutor(2, "analysis")

    @property
    def encoding(self) -> Encoding:
        return cast("Encoding", _value(self.workspace.position_encoding))

    @property
    def snippets(self) -> bool:
        """Whether the editor can fill in the places of a snippet."""
        text = self.client_capabilities.text_document
        item = text.completion.completion_item if text and text.completion else None
        return bool(item and item.snippet_support)

    def open(self, uri: str, text: str, version: int | None) -> None:
        name = to_fs_path(uri) or uri

        def published(document: Document) -> None:
            self._publish(uri, document)

        document = Document(name, self.encoding, self._executor, self.checker, published, self.complain)
        self.documents[uri] = document
        document.change(text, version)

    async def aside(self, work: Callable[[], _Answer]) -> _Answer:
        """The result of work that may take longer, while other questions are answered."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)

    def _publish(self, uri: str, document: Document) -> None:
        if self.documents.get(uri) is document:
            found = convert.diagnostics(document.diagnostics, document.lines)
            self.text_document_publish_diagnostics(
                types.PublishDiagnosticsParams(uri=uri, diagnostics=found, version=document.version)
            )
            if document.coloured_before and self._can_colour_again:
                document.coloured_before = False
                self.workspace_semantic_tokens_refresh(None)

    @property
    def _can_colour_again(self) -> bool:
        """Whether the editor can be told to ask for colours again."""
        workspace = self.client_capabilities.workspace
        tokens = workspace.semantic_tokens if workspace else None
        return bool(tokens and tokens.refresh_support)

    def complain(self, message: str) -> None:
        """Tell the user, and the log, what went wrong."""
        LOG.error("%s", message)
        self.window_show_message(types.ShowMessageParams(types.MessageType.Error, f"dl2c: {message}"))

    def report_server_error(self, error: Exception, source: type[Any]) -> None:
        """Tell of messages that cannot be read or followed; a question has its answer."""
        if not issubclass(source, FeatureRequestError):
            self.complain(f"{type(error).__name__}: {error}")


def serve() -> None:
    """Talk to an editor over stdin and stdout until it ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no message
    sys.setswitchinterval(SWITCH_INTERVAL)
    logging.getLogger("pygls").setLevel(logging.CRITICAL)  # `ModelServer` tells what goes wrong
    server = make_server()
    gc.freeze()
    gc.set_threshold(*GARBAGE)
    server.start_io(sys.stdin.buffer, out)


def make_server() -> ModelServer:
    """A server with all its answers."""
    server = ModelServer()
    _follow_texts(server)
    _answer_about_names(server)
    _answer_about_files(server)
    return server


def _about(server: ModelServer, kind: str, options: Any = None) -> Callable[[_Handler[Any, Any]], None]:
    """Answer questions of this kind about open files; of others nothing is known."""

    def register(handler: _Handler[Any, Any]) -> None:
        async def answer(params: Any) -> Any:
            document = server.documents.get(params.text_document.uri)
            if document is None:
                return None
            try:
                return await handler(server, document, params)
            except Refused as refused:
                raise _failed(types.LSPErrorCodes.RequestFailed, str(refused)) from None
            except Exception as failure:
                LOG.error("%s", traceback.format_exc())
                message = f"a bug of dl2c: {type(failure).__name__}: {failure}"
                raise _failed(types.ErrorCodes.InternalError, message) from None

        server.feature(kind, options)(answer)

    return register


# ---------------------------------------------------------------- texts


def _follow_texts(server: ModelServer) -> None:
    @server.feature(types.INITIALIZED)
    async def begin(params: types.InitializedParams) -> None:
        try:
            await server.checker.start()
        except OSError as failure:
            server.complain(f"checks that need more time cannot be started: {failure}")

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    async def opened(params: types.DidOpenTextDocumentParams) -> None:
        document = params.text_document
        server.open(document.uri, document.text, document.version)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    async def changed(params: types.DidChangeTextDocumentParams) -> None:
        document = server.documents.get(params.text_document.uri)
        if document is not None and params.content_changes:
            document.change(params.content_changes[-1].text, params.text_document.version)

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    async def closed(params: types.DidCloseTextDocumentParams) -> None:
        uri = params.text_document.uri
        if (document := server.documents.pop(uri, None)) is not None:
            document.close()
            server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, []))

    @server.feature(types.SHUTDOWN)
    async def end(params: None) -> None:
        for document in server.documents.values():
            document.close()
        await server.checker.stop()


# ---------------------------------------------------------------- names


def _answer_about_names(server: ModelServer) -> None:
    _about(server, types.TEXT_DOCUMENT_HOVER)(_hover)
    _about(server, types.TEXT_DOCUMENT_DEFINITION)(_definition)
    _about(server, types.TEXT_DOCUMENT_REFERENCES)(_references)
    _about(server, types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)(_highlights)
    _about(server, types.TEXT_DOCUMENT_PREPARE_RENAME)(_prepare_rename)
    _about(server, types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))(_rename)
    triggers = types.CompletionOptions(trigger_characters=list(TRIGGERS))
    _about(server, types.TEXT_DOCUMENT_COMPLETION, triggers)(_complete)


def _place(view: View, position: types.Position) -> int:
    """A position of the present text in the text of the analysis."""
    return view.shift.earlier(view.lines.offset((position.line, position.character)))


def _occurrences(view: View, position: types.Position) -> tuple[Occurrence, ...]:
    return view.analysis.names.at(_place(view, position))


async def _hover(server: ModelServer, document: Document, params: types.HoverParams) -> types.Hover | None:
    view = await document.view()
    found = hover(view.analysis, _place(view, params.position), view.limits)
    if found is None:
        return None
    text, start, end = found
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, convert.moved(view, start, end))


async def _definition(
    server: ModelServer, document: Document, params: types.DefinitionParams
) -> list[types.Location] | None:
    view = await document.view()
    places = [o.symbol.place for o in _occurrences(view, params.position) if o.symbol.place is not None]
    uri = params.text_document.uri
    return [types.Location(uri, convert.moved(view, p.start, p.end)) for p in places] or None


async def _references(
    server: ModelServer, document: Document, params: types.ReferenceParams
) -> list[types.Location]:
    view = await document.view()
    found = _all_of(view, params.position)
    if not params.context.include_declaration:
        found = [o for o in found if o.use != "declared"]
    uri = params.text_document.uri
    return [types.Location(uri, convert.moved(view, o.start, o.end)) for o in found]


async def _highlights(
    server: ModelServer, document: Document, params: types.DocumentHighlightParams
) -> list[types.DocumentHighlight]:
    view = await document.view()
    kinds = {True: types.DocumentHighlightKind.Write, False: types.DocumentHighlightKind.Read}
    return [
        types.DocumentHighlight(convert.moved(view, o.start, o.end), kinds[o.use == "written"])
        for o in _all_of(view, params.position)
    ]


def _all_of(view: View, position: types.Position) -> list[Occurrence]:
    """Every place of what the name at a position may stand for, each once."""
    names = view.analysis.names
    found = {o.start: o for here in _occurrences(view, position) for o in names.of(here.symbol)}
    return [found[start] for start in sorted(found)]


async def _prepare_rename(
    server: ModelServer, document: Document, params: types.PrepareRenameParams
) -> types.Range:
    view = await document.view(LONG_PATIENCE)
    found = renamable(_present(view), _place(view, params.position))
    return convert.moved(view, found.start, found.end)


async def _rename(server: ModelServer, document: Document, params: types.RenameParams) -> types.WorkspaceEdit:
    view = await document.view(LONG_PATIENCE)
    done = rename(_present(view), _place(view, params.position), params.new_name)
    _tell_of_tactics(server, done)
    edits = convert.text_edits(view.lines, done.edits, document.ending)
    return types.WorkspaceEdit(changes={params.text_document.uri: edits})


def _present(view: View) -> Analysis:
    """The analysis, which must be of the present text. Raises `Refused`."""
    if not view.fresh:
        raise Refused("the text is still being read: try again in a moment")
    return view.analysis


def _failed(code: types.LSPErrorCodes | types.ErrorCodes, message: str) -> JsonRpcException:
    """The answer to a question that has no other one."""
    error = JsonRpcException(message)
    error.code = code.value
    return error


def _tell_of_tactics(server: ModelServer, done: Renaming) -> None:
    if done.tactics:
        entries = ", ".join(f'"{name}"' for name in done.tactics)
        message = f"dl2c: the tactics of {entries} still have the old name: they are not read"
        server.window_show_message(types.ShowMessageParams(types.MessageType.Warning, message))


async def _complete(
    server: ModelServer, document: Document, params: types.CompletionParams
) -> types.CompletionList:
    view = await document.view()
    at = view.lines.offset((params.position.line, params.position.character))
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


def _answer_about_files(server: ModelServer) -> None:
    _about(server, types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)(_symbols)
    _about(server, types.TEXT_DOCUMENT_FOLDING_RANGE)(_folding)
    actions = [types.CodeActionKind.QuickFix, types.CodeActionKind.SourceFixAll]
    _about(server, types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions(code_action_kinds=actions))(
        _actions
    )
    legend = types.SemanticTokensLegend(list(KINDS), list(MODIFIERS))
    _about(server, types.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL, legend)(_tokens)
    _about(server, types.TEXT_DOCUMENT_SEMANTIC_TOKENS_RANGE, legend)(_tokens_of_range)


async def _symbols(
    server: ModelServer, document: Document, params: types.DocumentSymbolParams
) -> list[types.DocumentSymbol]:
    view = await document.view()
    return convert.symbols(parts(view.analysis), view)


async def _folding(
    server: ModelServer, document: Document, params: types.FoldingRangeParams
) -> list[types.FoldingRange]:
    view = await document.view()
    return convert.folding(folds(view.analysis), view)


async def _actions(
    server: ModelServer, document: Document, params: types.CodeActionParams
) -> list[types.CodeAction]:
    view = await document.view()
    if not view.fresh:
        return []
    lines, uri = view.lines, params.text_document.uri
    start, end = (lines.offset((p.line, p.character)) for p in (params.range.start, params.range.end))
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
    return f"{_value(kind)}.".startswith(f"{_value(wanted)}.")


def _value(kind: Any) -> str:
    return str(getattr(kind, "value", kind))


async def _tokens(
    server: ModelServer, document: Document, params: types.SemanticTokensParams
) -> types.SemanticTokens:
    view = await document.view()
    document.coloured_before |= not view.fresh
    return types.SemanticTokens(convert.encoded(tokens(view.analysis), view))


async def _tokens_of_range(
    server: ModelServer, document: Document, params: types.SemanticTokensRangeParams
) -> types.SemanticTokens:
    view = await document.view()
    begin, end = _place(view, params.range.start), _place(view, params.range.end)
    return types.SemanticTokens(convert.encoded(tokens(view.analysis, begin, end), view))
