"""Arguments that several commands share, declared for typer."""

from pathlib import Path
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

Film = Annotated[
    Path | None,
    typer.Option(metavar="MP4|GIF", help="Show it in a film, in the model's time; at most a minute long."),
]


def check_film(path: Path | None) -> None:
    """Whether a film can be written there, if one is wanted. Raises `OSError`, `ModuleNotFoundError`."""
    if path is not None:
        from dl2c.report import film

        film.check_film(path)


# What is said of a trained policy that is verified ---------------------------------------------------

PANEL = "A trained policy"
Trained = Annotated[
    Path | None,
    typer.Option(
        "--policy",
        metavar="FILE|DIR",
        help="Prove instead that this policy asks for admissible actions only: policy.json, SB3's zip, ONNX.",
        rich_help_panel=PANEL,
    ),
]
Arithmetic = Annotated[
    str | None,
    typer.Option(
        metavar="double|float32|real",
        help="Numbers that the policy computes with; default: double.",
        autocompletion=words("double", "float32", "real"),
        rich_help_panel=PANEL,
    ),
]
Except = Annotated[
    str | None,
    typer.Option(
        "--except",
        metavar="FORMULA",
        help="States of which nothing is claimed, because a fallback acts there.",
        rich_help_panel=PANEL,
    ),
]
Fixed = Annotated[
    list[str] | None,
    typer.Option(
        "--fix",
        metavar="NAME=VALUE",
        help="Only states with this value, which is still observed. May be repeated.",
        rich_help_panel=PANEL,
    ),
]
Takes = Annotated[
    str | None,
    typer.Option(
        "--takes", metavar="NAMES", help="What an ONNX network takes, in order.", rich_help_panel=PANEL
    ),
]
Gives = Annotated[
    list[str] | None,
    typer.Option(
        "--gives",
        metavar="NAME=LOW:HIGH",
        help="The variable that an ONNX network gives a value, and what that is clipped to. May be repeated.",
        rich_help_panel=PANEL,
    ),
]
Certificate = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write the certificate of a proof.", rich_help_panel=PANEL),
]
Check = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Check a certificate instead of searching.", rich_help_panel=PANEL),
]
Resume = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Go on with the search in this file, if it is there, and write how far it comes.",
        rich_help_panel=PANEL,
    ),
]
Picture = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Draw what is proved, open and refuted over two names, and how the search went: PNG, SVG, PDF.",
        rich_help_panel=PANEL,
    ),
]
Over = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="The names of the picture; default: those along which boxes were split most often.",
        rich_help_panel=PANEL,
    ),
]
