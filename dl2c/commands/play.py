"""`dl2c play`: a page in which a model is driven by hand."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from dl2c.commands.arguments import Model
from dl2c.commands.waiting import working
from dl2c.outputs import write_output


def play(
    model: Model,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="HTML", help="Default: <model>.html here.", show_default=False
        ),
    ] = None,
    policy: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR", help="A trained policy that can drive too: policy.json, SB3's zip, ONNX."
        ),
    ] = None,
    *,
    options: Mapping[str, Any],
) -> None:
    """Write one HTML page in which a model is driven by hand; it needs nothing but a browser."""
    from dl2c.emit.names import file_stem
    from dl2c.env.opening import source_of
    from dl2c.play.build import playable
    from dl2c.play.page import page_of

    trained = None
    if policy is not None:
        from dl2c.commands.policy import policy_for

        trained, options = policy_for(model, policy, options)
    with working(f"making a page of {model}") as note:
        made = playable(source_of(model), options, trained, note)
        text = page_of(made)
    path = output or Path(f"{file_stem(made.manifest.name)}.html")
    write_output(path, text)
    print(path)
