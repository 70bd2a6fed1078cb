"""Arguments that several commands share, declared for typer."""

from typing import Annotated

import typer

from dl2c.commands.completion import models, words

Model = Annotated[
    str, typer.Argument(help="A .kyx file, or example:NAME.", show_default=False, autocompletion=models)
]
PolicyName = Annotated[
    str,
    typer.Option(
        "--policy", help="random, first, or a policy's zip file.", autocompletion=words("random", "first")
    ),
]
Episodes = Annotated[int, typer.Option(min=1, help="How many episodes.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the first episode; the next ones count up.")]
Masked = Annotated[bool, typer.Option("--masked/--unmasked", help="Keep the policy to enabled alternatives.")]
