"""The options of `@episode` as text: see `dl2c.options` for what each may be.

In: an option's name and value text. Out: the option's name in `Options` and a typed value, or a diagnostic.
`allow` is not an option of an environment: its codes say which lints are silent.
"""

import re
import sys
from fractions import Fraction
from typing import TypeAlias

from dl2c.diagnostics import Diagnostic
from dl2c.options import IN_EPISODE, OPTIONS
from dl2c.parse import errors
from dl2c.parse.build import MAX_DIGITS
from dl2c.source import Span

Value: TypeAlias = int | Fraction | bool | str

ALLOW = "allow"

_RANGE = re.compile(r"\[?\s*-?[0-9.]+\s*:\s*-?[0-9.]+\s*\]?")
_DECIMAL = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE]-?[0-9]{1,3})?")


def read_option(name: str, text: str, at: Span, span: Span) -> tuple[str, Value] | Diagnostic:
    """The option's name in `Options` and its value, or what is wrong with it.

    `at` is where the name stands, `span` where the value does.
    """
    option = IN_EPISODE.get(name) or OPTIONS.get(name)
    if name != ALLOW and (option is None or not option.episode):
        return errors.unknown_attribute(at, "episode", name, (ALLOW, *IN_EPISODE))
    if not text:
        return errors.no_value(at, name)
    plain = text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text
    if option is None:
        return ALLOW, plain
    value: Value | None = None
    match option.kind:
        case "word" | "boolean":
            words = (*option.words, *option.deprecated) or ("true", "false")
            if plain not in words:
                return errors.unknown_value(span, plain, words)
            return option.name, plain == "true" if option.kind == "boolean" else plain
        case "range":
            return (option.name, plain) if _RANGE.fullmatch(plain) else errors.malformed_bound(span)
        case "integer":
            value = int(plain) if re.fullmatch(r"-?[0-9]{1,18}", plain) else None
        case _:
            if len(plain) > MAX_DIGITS:
                return errors.too_many_digits(span, MAX_DIGITS)
            value = Fraction(plain) if _DECIMAL.fullmatch(plain) else None
            if value is not None and abs(value) > sys.float_info.max:
                return errors.beyond_doubles(span)
    least = option.least if option.least_in_episode is None else option.least_in_episode
    if value is None or (least is not None and (value < least or (option.open and value == least))):
        return errors.wrong_number(span, option.episode, option.kind, least, option.open)
    return option.name, value
