"""How much dl2c says on stderr, and in which colours: -v, -q and --no-color of every command.

The level of the logger `dl2c` is the one place that knows: DEBUG with -v, ERROR with -q, else WARNING.
Rich reads NO_COLOR by itself, so --no-color sets it.
"""

import inspect
import logging
import os
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer

from dl2c.progress import LOG


def begin() -> None:
    """Start a command line: errors and warnings to stderr as it is now, no details."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(message)s"))
    LOG.handlers = [handler]
    LOG.setLevel(logging.WARNING)


def detailed() -> bool:
    """Whether stages, commands and tracebacks are wanted."""
    return LOG.isEnabledFor(logging.DEBUG)


def quiet() -> bool:
    """Whether only errors are wanted."""
    return not LOG.isEnabledFor(logging.WARNING)


def _detailed(wanted: bool) -> None:
    if wanted:
        LOG.setLevel(logging.DEBUG)


def _quiet(wanted: bool) -> None:
    if wanted:
        LOG.setLevel(logging.ERROR)


def _plain(wanted: bool) -> None:
    if wanted:
        os.environ["NO_COLOR"] = "1"


def _flag(name: str, *flags: str, does: Callable[[bool], None], help: str) -> inspect.Parameter:
    option = typer.Option(*flags, callback=does, help=help, rich_help_panel="Messages")
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Annotated[bool, option]
    )


FLAGS = (
    _flag(
        "verbose", "--verbose", "-v", does=_detailed, help="Show stages, compiler commands and tracebacks."
    ),
    _flag("quiet", "--quiet", "-q", does=_quiet, help="Show only errors, besides the result."),
    _flag("no_color", "--no-color", does=_plain, help="No colours; so does NO_COLOR=1."),
)


def talkative(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command these flags."""
    own = inspect.signature(command).parameters.values()

    @wraps(command)
    def run(**arguments: Any) -> None:
        for flag in FLAGS:
            arguments.pop(flag.name)
        command(**arguments)

    return with_parameters(run, (*own, *FLAGS))


def with_parameters(
    command: Callable[..., None], parameters: tuple[inspect.Parameter, ...]
) -> Callable[..., None]:
    """A command that typer sees with these parameters."""
    signature = inspect.Signature([p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters])
    command.__signature__ = signature  # pyright: ignore[reportFunctionMemberAccess] # read by inspect.signature
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command
