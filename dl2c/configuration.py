"""Defaults of options from `[tool.dl2c]` in the nearest `pyproject.toml`, from the working folder up.

Goes in: a folder. Come out: `Options` that neither the command line nor Python gave, so that
`@episode` and both of them win over the file, and the file over what is built in. Mistakes are
diagnostics with their place in the file. TOML's numbers are read as the decimals they are.
"""

import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any, cast

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.inputs import MALFORMED, reason
from dl2c.options import IN_EPISODE, OPTIONS, Options, UnknownOption, with_options
from dl2c.source import Source, Span

FILE = "pyproject.toml"
TABLE = ("tool", "dl2c")
NAMES = tuple(name for name in OPTIONS if name != "entry")
"""What may be configured; `entry` names a part of one file."""

_HEADER = re.compile(r"^[ \t]*\[([^\[\]\n]+)\]", re.MULTILINE)
_KEY = re.compile(r"^[ \t]*([\w.\"'-]+)[ \t]*=[ \t]*([^\n#]*)", re.MULTILINE)
_POSITION = re.compile(r"line (\d+), column (\d+)")


def configured(options: Options, folder: Path | None = None) -> Options:
    """`options` under the defaults that a project sets for `folder` (default: the working folder).

    Raises `CompileError` for a file that is no TOML, and for unknown names and wrong values in it.
    """
    path = _nearest(Path.cwd() if folder is None else folder.absolute())
    if path is None:
        return options
    source = Source.read(path)
    if "dl2c" not in source.text:
        return options
    table = _table(source)
    if found := tuple(_mistakes(source, table)):
        raise CompileError(found)
    return replace(with_options(options, table), given=options.given)


def resolve_options(given: Mapping[str, Any]) -> Options:
    """Options from names and values, under them those of the project's `[tool.dl2c]`.

    An option may have its name in `@episode` too: `gym.make` keeps `max_episode_steps` for a wrapper of its
    own. Raises `UnknownOption`, and `CompileError` for a mistake in the project's file.
    """
    defaults = configured(Options())
    named = {IN_EPISODE[n].name if n in IN_EPISODE else n: value for n, value in given.items()}
    options = with_options(defaults, named)
    constants = dict(defaults.constants) | dict(options.constants)
    return replace(options, constants=tuple(sorted(constants.items())))


def _mistakes(source: Source, table: Mapping[str, Any]) -> Iterator[Diagnostic]:
    for path, setting in _settings(table):
        try:
            if path[0] in NAMES:
                with_options(Options(), setting)
            else:
                yield _unknown(source, path[0])
        except UnknownOption as wrong:
            span = _place(source, path, of_value=True)
            yield error("configuration", str(wrong), span, help=f"correct `{path[-1]}`, or leave it out")


def _settings(table: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """The path of every value, and the value as an option by itself."""
    for name, value in table.items():
        match value:
            case dict() if name == "constants":
                for constant, number in cast("dict[str, Any]", value).items():
                    yield (name, constant), {name: {constant: number}}
            case _:
                yield (name,), {name: value}


def _nearest(folder: Path) -> Path | None:
    paths = (parent / FILE for parent in (folder, *folder.parents))
    return next((path for path in paths if path.is_file()), None)


def _table(source: Source) -> Mapping[str, Any]:
    """`[tool.dl2c]`, empty if there is none."""
    try:
        value: Any = tomllib.loads(source.text, parse_float=Decimal)
    except MALFORMED as wrong:
        raise CompileError(_no_toml(source, reason(wrong))) from None
    for name in TABLE:
        value = cast("dict[str, Any]", value).get(name, {})
        if not isinstance(value, dict):
            span = Span(source, 0, 0)
            raise CompileError(
                error("configuration", f"`{name}` is not a table", span, help="write [tool.dl2c]")
            )
    return cast("dict[str, Any]", value)


def _no_toml(source: Source, message: str) -> Diagnostic:
    """Python says in words where a file goes wrong."""
    start = len(source.text)
    if place := _POSITION.search(message):
        line, column = map(int, place.groups())
        start = source.line_starts[line - 1] + column - 1
    title = f"this is not TOML: {message.partition(' (at')[0]}"
    return error("configuration", title, Span(source, start, start + 1), help=f"correct {FILE}")


def _unknown(source: Source, name: str) -> Diagnostic:
    near = difflib.get_close_matches(name.replace("-", "_"), NAMES, n=1)
    advice = f"did you mean `{near[0]}`?" if near else f"the options are {', '.join(sorted(NAMES))}"
    return error("configuration", f"no option `{name}`", _place(source, (name,)), help=advice)


def _place(source: Source, path: tuple[str, ...], *, of_value: bool = False) -> Span:
    """Where a name of the table, or its value, stands; its nearest table if it is written unusually."""
    wanted = (*TABLE, *path)
    places = {found: value if of_value else key for found, key, value in _entries(source)}
    while wanted and wanted not in places:
        wanted = wanted[:-1]
    return places.get(wanted, Span(source, 0, 1))


def _entries(source: Source) -> Iterator[tuple[tuple[str, ...], Span, Span]]:
    """Every header and every assignment of a TOML file: its path, the span of its name, of its value."""
    within: tuple[str, ...] = ()
    marks = sorted((*_HEADER.finditer(source.text), *_KEY.finditer(source.text)), key=lambda m: m.start())
    for mark in marks:
        name = Span(source, *mark.span(1))
        parts = tuple(part.strip(" \t\"'") for part in mark[1].split("."))
        if mark.re is _HEADER:
            within = parts
            yield within, name, name
        else:
            yield (*within, *parts), name, Span(source, mark.start(2), mark.start(2) + len(mark[2].rstrip()))
