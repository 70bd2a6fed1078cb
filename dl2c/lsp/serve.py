"""The process that an editor starts: the server with all its answers, over stdin and stdout."""

import gc
import logging
import os
import sys

from lsprotocol import types

from dl2c.lsp.answers import answer_about_files, answer_about_names
from dl2c.lsp.server import ModelServer

SWITCH_INTERVAL = 0.001
"""Seconds that a thread may work before another one gets its turn: questions wait for it."""

GARBAGE = (100_000, 50, 100)
"""When Python looks for circles: trees have none, and looking through large ones delays answers."""


def serve() -> None:
    """Talk to an editor over stdin and stdout until it ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is not a message
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
    answer_about_names(server)
    answer_about_files(server)
    return server


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
