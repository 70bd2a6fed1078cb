"""A Gymnasium module over the compiled library: facts alone; what happens is in `dl2c.env`.

Comes in: everything known of an environment, and the model's text, which the module holds, so that
docstring and environment cannot differ. Goes out: Python text.
"""

import json
from dataclasses import fields
from fractions import Fraction

from dl2c.emit.plan import BuildPlan
from dl2c.emit.python.text import class_name, file_name, headline, sections
from dl2c.ir.printer import print_number
from dl2c.options import Options
from dl2c.source import Source

ARGUMENTS = (
    ("model", "another text, file or `example:NAME` to take in place of `MODEL`."),
    ("render_mode", 'None, or `"ansi"` for a line of text.'),
    ("options", "any option of dl2c, such as `max_episode_steps=200` or `constants={...}`."),
)


def gym_module(build: BuildPlan, source: Source) -> str:
    """The module of a model with this text."""
    model = build.model
    name = class_name(model)
    return f'''"""{headline(model)}

Written by dl2c {build.version} from {file_name(source)}. Importing this module compiles nothing;
the first environment does, or takes what an earlier one compiled.
"""

from typing import Any

import gymnasium as gym
from dl2c.env.single import Dl2cEnv

ID = "{name.removesuffix("Env")}-v0"


class {name}(Dl2cEnv):
    """{headline(model)}

{_sections(build)}
    """

    def __init__(
        self, model: Any = None, *, render_mode: str | None = None, **options: Any
    ) -> None:
        options = {{**OPTIONS, **options}}
        super().__init__(model or MODEL, render_mode=render_mode, **options)


def register(identifier: str = ID, **arguments: Any) -> None:
    """Make `gymnasium.make(identifier)` return this environment."""
    gym.register(identifier, entry_point={name}, kwargs=arguments)


OPTIONS: dict[str, Any] = {_options(build.options)}

MODEL = {_literal(source.text)}
'''


def _sections(build: BuildPlan) -> str:
    return "\n".join(f"    {line}" if line else "" for line in sections(build, ARGUMENTS))


def _options(options: Options) -> str:
    entries = [f'    "{option}": {_quoted(value)},\n' for option, value in _chosen(options)]
    return "{\n" + "".join(entries) + "}" if entries else "{}"


def _chosen(options: Options) -> list[tuple[str, object]]:
    """The options that are not the default, as a caller would write them."""
    plain = Options()
    found: list[tuple[str, object]] = []
    for field in fields(Options):
        value = getattr(options, field.name)
        if field.name == "given" or value == getattr(plain, field.name):
            continue
        match value:
            case Fraction():
                found.append((field.name, print_number(value)))
            case (Fraction() as low, Fraction() as high):
                found.append((field.name, f"{print_number(low)}:{print_number(high)}"))
            case tuple():
                found.append((field.name, {n: print_number(v) for n, v in options.constants}))
            case _:
                found.append((field.name, value))
    return found


def _quoted(value: object) -> str:
    """A value as formatters write it."""
    return json.dumps(value) if isinstance(value, str | dict) else repr(value)


def _literal(text: str) -> str:
    """The text as Python reads it back, over several lines where an editor would show it all."""
    shown = all(c.isprintable() or c in "\n\t" for c in text)
    if not shown or '"""' in text or "\\\n" in text or text.endswith(('"', "\\")):
        return json.dumps(text)
    raw = "r" if "\\" in text else ""
    return f'{raw}"""{text}"""'
