"""How failures reach the user: mistakes in a model as diagnostics, the rest in one line.

Exit code 1: the model, a file or the machine. 2: the command line. 70: a bug of dl2c; 130: Ctrl-C. `verify`
ends with 0 where the theorem is proved, 1 where it is refuted, 3 where neither is known.
"""

import json
import math
import os
import sys
import traceback
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, cast

from dl2c.commands.verbosity import detailed, quiet
from dl2c.diagnostics import MOST_SHOWN, CompileError, Diagnostic, Mistake, not_shown, render
from dl2c.native.errors import NativeError
from dl2c.options import UnknownOption
from dl2c.source import NOWHERE
from dl2c.version import __version__, install

if TYPE_CHECKING:
    from rich.text import Text

USER, USAGE, BUG = 1, 2, 70
"""Exit codes; 70 is EX_SOFTWARE of sysexits.h."""

COLOURS = {"error": "bold red", "warning": "bold yellow", "note": "cyan", "help": "green"}

EXTRA: dict[str | None, str] = {
    **dict.fromkeys(("torch", "stable_baselines3", "sb3_contrib", "matplotlib", "yaml"), "train"),
    **dict.fromkeys(("ray", "pyarrow"), "ray"),
    **dict.fromkeys(("onnx", "google"), "onnx"),
    "imageio_ffmpeg": "film",
    **dict.fromkeys(("pygls", "lsprotocol"), "lsp"),
}
"""Which extra installs an optional library."""

STARVED = ("failed to map segment", "cannot allocate memory", "can't start new thread")
"""How a library that finds no memory, or no thread, says so."""


class CommandError(Mistake):
    """Something a command cannot do; the message says why."""


def report(failure: BaseException) -> int:
    """Say on stderr what went wrong; the exit code."""
    match failure:
        case CompileError(diagnostics=diagnostics):
            show(diagnostics)
            return USER
        case UnknownOption():
            _line(str(failure))
            return USAGE
        case NativeError() | Mistake():
            _line(str(failure))
            return USER
        case BrokenPipeError():
            return USER
        case OSError():
            name = f": {os.fsdecode(failure.filename)}" if failure.filename is not None else ""
            _line(f"{failure.strerror or failure}{name}")
            return USER
        case MemoryError():
            _line(": ".join(filter(None, ("out of memory", str(failure)))))
            return USER
        case ImportError() | RuntimeError() if any(words in str(failure).lower() for words in STARVED):
            _line(f"out of memory: {failure}")
            return USER
        case ModuleNotFoundError(name=name) if name in EXTRA:
            _line(f"this needs {name}; install it with `{install(EXTRA[name])}`")
            return USER
        case _:
            if detailed():
                traceback.print_exception(failure)
            _line(f"internal error: {type(failure).__name__}: {failure}")
            advice = "with the model and the output of the same command with -v"
            print(f"This is a bug in dl2c {__version__}. Please report it {advice}.", file=sys.stderr)
            return BUG


def show(diagnostics: Iterable[Diagnostic]) -> None:
    """Diagnostics on stderr, in colour on a terminal; of warnings none with -q."""
    wanted = [d for d in diagnostics if d.severity == "error" or not quiet()]
    if not wanted:
        return
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    for k, diagnostic in enumerate(wanted[:MOST_SHOWN]):
        text = render(diagnostic)
        if k:
            print(file=sys.stderr)
        if console.is_terminal:
            console.print(_coloured(text), soft_wrap=True)
        else:
            print(text, file=sys.stderr)
    for line in not_shown(wanted):
        print(f"\n{line}", file=sys.stderr)


def _coloured(text: str) -> "Text":
    from rich.text import Text

    styled = Text(text)
    for word, style in COLOURS.items():
        styled.highlight_regex(rf"(?m)^{word}:", style)
    styled.highlight_regex(r"(?m)^ +\| +\^+.*$", COLOURS["error"])
    return styled


def _line(message: str) -> None:
    print(f"error: {message}", file=sys.stderr)


def as_json(diagnostics: Iterable[Diagnostic]) -> str:
    """Diagnostics for scripts: a list of objects; `file`, `line` and `column` where there is a place."""
    return to_json(as_data(diagnostics))


def as_data(diagnostics: Iterable[Diagnostic]) -> list[Mapping[str, Any]]:
    """The same before it is text."""
    return [_plain(d) for d in diagnostics]


def _plain(d: Diagnostic) -> Mapping[str, Any]:
    what = {"severity": d.severity, "code": d.code, "title": d.title, "label": d.label, "help": d.help}
    if d.span == NOWHERE:
        return what | {"notes": list(d.notes)}
    place = {"file": d.span.source.name, "line": d.span.line, "column": d.span.column, "text": d.span.text}
    return what | {"notes": list(d.notes)} | place


def to_json(value: Any) -> str:
    """JSON as every command prints it; numbers that JSON has not are null."""
    return json.dumps(_finite(value), indent=1, sort_keys=True, allow_nan=False)


def _finite(value: Any) -> Any:
    match value:
        case dict():
            return {key: _finite(part) for key, part in cast("dict[str, Any]", value).items()}
        case list() | tuple():
            return [_finite(part) for part in cast("Iterable[Any]", value)]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
