"""The command `dl2c lsp`."""

from typing import Annotated

import typer


def lsp(
    stdio: Annotated[
        bool, typer.Option("--stdio", help="What some editors add; there is no other way.")
    ] = False,
) -> None:
    """Serve an editor over stdin and stdout by the language server protocol."""
    from dl2c.lsp.serve import serve

    serve()
