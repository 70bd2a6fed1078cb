"""The parts of the reference that are made from the code: a directive ```` ```{dl2c} lints ````.

What can be asked for: `lints`, `options`, `commands`, `cards`, `film NAME` and `environment NAME`. Each is
Markdown made of the tables that the program itself uses, or of a model, so it cannot differ from them.
"""

import inspect
import logging
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import environment_pages
import typer.main
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from dl2c.commands.check import table_of_codes
from dl2c.experiments.commands import app as command_line
from dl2c.options import OPTIONS, Option


def options() -> str:
    """Every option of an environment: its values, its default, and whether `@episode` may set it."""
    rows = [
        f"| `{o.name}` | {_values(o)} | {_default(o)} | {_plain(o.help)} | {_in_episode(o)} |"
        for o in OPTIONS.values()
    ]
    titles = "| option | values | default | meaning | in `@episode` |"
    return "\n".join([titles, "| --- | --- | --- | --- | --- |", *rows])


def _values(option: Option) -> str:
    """What an option takes; of a word each possible one."""
    match option.kind:
        case "word":
            return ", ".join(f"`{word}`" for word in option.words)
        case "integer" | "decimal":
            number = "whole number" if option.kind == "integer" else "number"
            return (
                number if option.least is None else f"{number}, {'>' if option.open else '>='} {option.least}"
            )
        case "boolean":
            return "`true`, `false`"
        case "range":
            return "`LO:HI`"
        case "text":
            return "text"
        case "constants":
            return "names with values"


def _in_episode(option: Option) -> str:
    return {option.name: "yes", "": "no"}.get(option.episode, f"as `{option.episode}`")


def _default(option: Option) -> str:
    match option.default:
        case None | ():
            return ""
        case bool(value):
            return f"`{str(value).lower()}`"
        case Fraction() as value:
            return f"`{float(value):g}`"
        case value:
            return f"`{value}`"


def commands() -> str:
    """Every command with its own arguments; the flags of the options are listed once."""
    group: Any = typer.main.get_command(command_line)
    return "\n\n".join(part for part in _commands(group, "dl2c"))


def _commands(group: Any, prefix: str) -> Iterator[str]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{prefix} {name}")
            continue
        about = inspect.cleandoc(command.help or "").replace("\n", " ")
        rows = [f"| {_written(p)} | {_plain(p.help or '')} |" for p in command.params if _own(p)]
        table = ["| argument | meaning |", "| --- | --- |", *rows] if rows else []
        yield "\n".join([f"## {prefix} {name}", "", about, "", *table])


def _plain(text: str) -> str:
    """Text in which nothing is taken for markup."""
    return text.replace("<", "&lt;").replace("|", "&#124;")


def _own(parameter: Any) -> bool:
    common = ("verbose", "quiet", "no_color", "help", "set_")
    return parameter.name not in (*common, *OPTIONS)


def _written(parameter: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    return names if names.startswith("`-") else f"`{parameter.name}`"


PARTS: dict[str, Callable[..., str]] = {
    "lints": table_of_codes,
    "options": options,
    "commands": commands,
    "cards": environment_pages.cards,
    "film": environment_pages.film,
    "environment": environment_pages.environment,
}


class Generated(SphinxDirective):
    """```{dl2c} NAME``` becomes one of `PARTS`, which may take more words."""

    required_arguments = 1
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        part, *words = self.arguments
        for path in (file for word in words for file in environment_pages.files(word)):
            self.env.note_dependency(str(path))
        return self.parse_text_to_nodes(PARTS[part](*words), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    logging.getLogger("dl2c").setLevel(logging.WARNING)  # a library of furo logs all that others are told
    app.add_directive("dl2c", Generated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
