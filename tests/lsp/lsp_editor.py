"""An editor for tests: a client of `dl2c lsp` over stdio, which a test asks without waiting for itself."""

import asyncio
import sys
import threading
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from conftest import REPOSITORY
from lsprotocol import types
from pygls.lsp.client import LanguageClient

from dl2c.lsp.positions import Lines
from dl2c.source import Source

PATIENCE = 60.0
"""Seconds, on a machine that has other things to do."""


class Editor:
    """`diagnostics` are the last ones of each file, `messages` what was shown to the user."""

    def __init__(self, encodings: list[str] | None = None, snippets: bool = True) -> None:
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, daemon=True).start()
        self.client = LanguageClient("test", "1")
        self.told: dict[str, list[types.PublishDiagnosticsParams]] = {}
        self.messages: list[str] = []
        self.version = 0
        told, messages = self.told, self.messages

        @self.client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def tell(params: types.PublishDiagnosticsParams) -> None:
            told.setdefault(params.uri, []).append(params)

        @self.client.feature(types.WINDOW_SHOW_MESSAGE)
        def show(params: types.ShowMessageParams) -> None:
            messages.append(params.message)

        self.run(self.client.start_io(sys.executable, "-m", "dl2c", "lsp", cwd=str(REPOSITORY)))
        item = types.ClientCompletionItemOptions(snippet_support=snippets)
        text = types.TextDocumentClientCapabilities(
            completion=types.CompletionClientCapabilities(completion_item=item)
        )
        general = types.GeneralClientCapabilities(position_encodings=encodings) if encodings else None
        capabilities = types.ClientCapabilities(text_document=text, general=general)
        asked = types.InitializeParams(capabilities=capabilities)
        self.capabilities = self.run(self.client.initialize_async(asked)).capabilities
        self.client.initialized(types.InitializedParams())
        encoding = self.capabilities.position_encoding
        self.encoding: Any = getattr(encoding, "value", encoding)

    def run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(PATIENCE)

    def _notify(self, send: Callable[[], None]) -> None:
        self.loop.call_soon_threadsafe(send)

    def open(self, text: str, name: str = "model.kyx", uri: str = "") -> "File":
        uri = uri or f"file:///nowhere/{name}"
        document = types.TextDocumentItem(uri, "dl", self.next(), text)
        self._notify(lambda: self.client.text_document_did_open(types.DidOpenTextDocumentParams(document)))
        return File(self, uri, text)

    def read(self, path: Path) -> "File":
        return self.open(Source.read(path).text, path.name)

    def next(self) -> int:
        self.version += 1
        return self.version

    def end(self) -> int:
        """The exit code of the server."""
        self.run(self.client.shutdown_async(None))
        self._notify(lambda: self.client.exit(None))
        process = self.client._server
        self.run(process.wait())
        return process.returncode


class File:
    """A file that an editor has open."""

    def __init__(self, editor: Editor, uri: str, text: str) -> None:
        self.editor, self.uri = editor, uri
        self.identifier = types.TextDocumentIdentifier(uri)
        self.text, self.version = text, editor.version

    @property
    def lines(self) -> Lines:
        return Lines(self.text.replace("\r\n", "\n"), self.editor.encoding)

    def change(self, text: str) -> None:
        self.text, self.version = text, self.editor.next()
        params = types.DidChangeTextDocumentParams(
            types.VersionedTextDocumentIdentifier(self.version, self.uri),
            [types.TextDocumentContentChangeWholeDocument(text)],
        )
        self.editor._notify(lambda: self.editor.client.text_document_did_change(params))

    def close(self) -> None:
        params = types.DidCloseTextDocumentParams(self.identifier)
        self.editor._notify(lambda: self.editor.client.text_document_did_close(params))

    def until(self, wanted: Callable[[list[types.Diagnostic]], bool], patience: float = PATIENCE) -> float:
        """The seconds until the diagnostics of the present text are as wanted."""
        begun = time.perf_counter()
        while time.perf_counter() - begun < patience:
            if any(
                told.version == self.version and wanted([*told.diagnostics])
                for told in self.editor.told.get(self.uri, ())[-1:]
            ):
                return time.perf_counter() - begun
            time.sleep(0.002)
        last = self.editor.told.get(self.uri, [None])[-1]
        raise AssertionError(f"after {patience} s: {last and [d.message for d in last.diagnostics]}")

    def codes(self) -> set[Any]:
        """Those of the last diagnostics, whatever text they are of."""
        return {d.code for d in self.editor.told[self.uri][-1].diagnostics}

    def at(self, mark: str, within: int = 0) -> types.Position:
        """Where a piece of the text begins, or `within` it."""
        return types.Position(*self.lines.position(self.lines.text.index(mark) + within))

    def piece(self, where: types.Range) -> str:
        start, end = (self.lines.offset((p.line, p.character)) for p in (where.start, where.end))
        return self.lines.text[start:end]

    def edited(self, edits: list[types.TextEdit]) -> str:
        """The text with edits; none of them overlap."""
        places = [(self.lines.offset((e.range.start.line, e.range.start.character)), e) for e in edits]
        text, done = self.text, len(self.text)
        for start, e in sorted(places, key=lambda p: p[0], reverse=True):
            end = self.lines.offset((e.range.end.line, e.range.end.character))
            assert end <= done
            text, done = text[:start] + e.new_text + text[end:], start
        return text

    def ask(self, question: str, params: Any) -> Any:
        return self.editor.run(getattr(self.editor.client, f"text_document_{question}_async")(params))

    def hover(self, position: types.Position) -> str:
        found = self.ask("hover", types.HoverParams(self.identifier, position))
        return found.contents.value if found else ""

    def definitions(self, position: types.Position) -> list[types.Range]:
        found = self.ask("definition", types.DefinitionParams(self.identifier, position))
        return [place.range for place in found or ()]

    def references(self, position: types.Position, declaration: bool = True) -> list[types.Range]:
        context = types.ReferenceContext(declaration)
        found = self.ask("references", types.ReferenceParams(context, self.identifier, position))
        return [place.range for place in found or ()]

    def rename(self, position: types.Position, new: str) -> str:
        """The text afterwards."""
        found = self.ask("rename", types.RenameParams(self.identifier, position, new))
        return self.edited([*found.changes[self.uri]])

    def completions(self, position: types.Position) -> dict[str, types.CompletionItem]:
        found = self.ask("completion", types.CompletionParams(self.identifier, position))
        return {item.label: item for item in found.items}

    def actions(self, where: types.Range, only: list[Any] | None = None) -> dict[str, types.CodeAction]:
        context = types.CodeActionContext([], only=only)
        found = self.ask("code_action", types.CodeActionParams(self.identifier, where, context))
        return {action.title: action for action in found}

    @property
    def whole(self) -> types.Range:
        return types.Range(types.Position(0, 0), types.Position(*self.lines.position(len(self.lines.text))))
