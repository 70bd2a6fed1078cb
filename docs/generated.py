"""The parts of the reference that are made from the code: a directive ```` ```{dl2c} lints ````.

What can be asked for: `lints`, `options`, `commands`. Each is Markdown made of the tables that the
program itself uses, so it cannot differ from them.
"""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import typer.main
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from dl2c.commands.check import table_of_codes
from dl2c.experiments.commands import app as command_line
from dl2c.options import OPTIONS, Options


def options() -> str:
    """Every option of an environment, its values and its default."""
    rows = []
    for field in fields(Options):
        if field.name == "given":
            continue
        values = getattr(field.type, "__args__", ())
        listed = ", ".join(f"`{v}`" for v in values if isinstance(v, str))
        help_text = OPTIONS[field.name].help
        rows.append(f"| `{field.name}` | {listed} | {_default(field.name)} | {_plain(help_text)} |")
    return "\n".join(["| option | values | default | meaning |", "| --- | --- | --- | --- |", *rows])


def _default(name: str) -> str:
    value = getattr(Options(), name)
    if value is None or value == ():
        return ""
    return (
        f"`{float(value):g}`"
        if hasattr(value, "denominator") and not isinstance(value, int)
        else f"`{value}`"
    )


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
    return parameter.name not in (*common, *(f.name for f in fields(Options)))


def _written(parameter: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    return names if names.startswith("`-") else f"`{parameter.name}`"


PARTS: dict[str, Callable[[], str]] = {"lints": table_of_codes, "options": options, "commands": commands}


class Generated(SphinxDirective):
    """```{dl2c} NAME``` becomes one of `PARTS`."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        text = PARTS[self.arguments[0]]()
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_directive("dl2c", Generated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
