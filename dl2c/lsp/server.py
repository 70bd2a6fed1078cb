"""The language server: questions of the protocol, each answered from a `Document`.

Positions are in the units that the editor offers, UTF-16 by default. Texts come whole with each change.
"""

import asyncio
import traceback
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar, cast

from lsprotocol import types
from pygls.exceptions import FeatureRequestError, JsonRpcException
from pygls.lsp.server import LanguageServer
from pygls.uris import to_fs_path

from dl2c.lsp import convert
from dl2c.lsp.checker import Checker
from dl2c.lsp.documents import Document, View
from dl2c.lsp.positions import Encoding
from dl2c.lsp.rename import Refused
from dl2c.progress import LOG
from dl2c.version import __version__

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
        self._executor = ThreadPoolExecutor(3, "analysis")

    @property
    def encoding(self) -> Encoding:
        return cast("Encoding", value(self.workspace.position_encoding))

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


def about(server: ModelServer, kind: str, options: Any = None) -> Callable[[_Handler[Any, Any]], None]:
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
            finally:
                document.answered()

        server.feature(kind, options)(answer)

    return register


def _failed(code: types.LSPErrorCodes | types.ErrorCodes, message: str) -> JsonRpcException:
    """The answer to a question that has no other one."""
    error = JsonRpcException(message)
    error.code = code.value
    return error


def written(position: types.Position) -> tuple[int, int]:
    return position.line, position.character


def place(view: View, position: types.Position) -> int:
    """A position of the present text in the text of the analysis."""
    return view.shift.earlier(view.lines.offset(written(position)))


def value(kind: Any) -> str:
    return str(getattr(kind, "value", kind))
