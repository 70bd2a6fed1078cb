"""The options of `@episode`: their names, and the values that each may take.

In: an option's name and value text. Out: the name and a typed value, or a diagnostic. What the
options mean is decided where they are used; options given in code win over these.
"""

import re
import sys
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.diagnostics import Diagnostic
from dl2c.parse import errors
from dl2c.parse.build import MAX_DIGITS
from dl2c.source import Span

Value: TypeAlias = int | Fraction | bool | str


@dataclass(frozen=True, slots=True)
class Option:
    """Values are one of `words`, or a number of the given kind with the given least value."""

    words: tuple[str, ...] = ()
    kind: Literal["word", "integer", "decimal", "boolean", "range", "codes"] = "word"
    least: int | None = None
    open: bool = False


OPTIONS = {
    "allow": Option(kind="codes"),
    "max_steps": Option(kind="integer", least=1),
    "default_bound": Option(kind="range"),
    "dt": Option(kind="decimal", least=0, open=True),
    "max_flow": Option(kind="decimal", least=0, open=True),
    "duration": Option(("max", "sample", "agent")),
    "on_blocked": Option(("fallback", "truncate", "terminate")),
    "mask_depth": Option(("flow", "step")),
    "blocked_penalty": Option(kind="decimal"),
    "stall_limit": Option(kind="integer", least=1),
    "action_format": Option(("auto", "dict", "box", "discrete", "multidiscrete")),
    "action_map": Option(("project", "squash")),
    "observe_constants": Option(("true", "false"), "boolean"),
    "obs_dtype": Option(("float32", "float64")),
    "observation_bounds": Option(("declared", "unbounded")),
    "tolerance": Option(kind="decimal", least=0),
    "safety_check": Option(("continuous", "step", "flows", "auto")),
    "integrator": Option(("auto", "exact", "cvodes", "dopri5")),
    "stiff": Option(("auto", "true", "false")),
    "rtol": Option(kind="decimal", least=0, open=True),
    "atol": Option(kind="decimal", least=0, open=True),
    "progress_failure": Option(("due", "literal")),
    "initial_distribution": Option(("uniform", "target", "z3")),
    "monitor_every_step": Option(("true", "false"), "boolean"),
    "max_repeat": Option(kind="integer", least=0),
    "max_loop": Option(kind="integer", least=1),
    "loop": Option(kind="integer", least=1),
}
ALIASES = {"max_episode_steps": "max_steps"}

_RANGE = re.compile(r"\[?\s*-?[0-9.]+\s*:\s*-?[0-9.]+\s*\]?")
_DECIMAL = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE]-?[0-9]{1,3})?")


def read_option(name: str, text: str, at: Span, span: Span) -> tuple[str, Value] | Diagnostic:
    """The option's own name (not its alias) and its value, or what is wrong with it.

    `at` is where the name stands, `span` where the value does.
    """
    name = ALIASES.get(name, name)
    if name not in OPTIONS:
        return errors.unknown_attribute(at, "episode", name, tuple(OPTIONS))
    if not text:
        return errors.no_value(at, name)
    option = OPTIONS[name]
    plain = text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text
    match option.kind:
        case "word" | "boolean":
            if plain not in option.words:
                return errors.unknown_value(span, plain, option.words)
            return name, plain == "true" if option.kind == "boolean" else plain
        case "codes":
            return name, plain
        case "range":
            return (name, plain) if _RANGE.fullmatch(plain) else errors.malformed_bound(span)
        case "integer":
            value = int(plain) if re.fullmatch(r"-?[0-9]{1,18}", plain) else None
        case "decimal":
            if len(plain) > MAX_DIGITS:
                return errors.too_many_digits(span, MAX_DIGITS)
            value = Fraction(plain) if _DECIMAL.fullmatch(plain) else None
            if value is not None and abs(value) > sys.float_info.max:
                return errors.beyond_doubles(span)
    if value is None or _too_small(value, option):
        return errors.wrong_number(span, name, option.kind, option.least, option.open)
    return name, value


def _too_small(value: Fraction | int, option: Option) -> bool:
    if option.least is None:
        return False
    return value < option.least or (option.open and value == option.least)
