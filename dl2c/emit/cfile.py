"""The shapes of C that generated files are made of: comments, functions, tables.

Every function here returns text or lines of text; what they say is decided elsewhere.
"""

import re
import textwrap
from collections.abc import Iterable, Sequence

from dl2c.emit.claim import Claim
from dl2c.source import NOWHERE, Span

WIDTH = 100

LICENCE = "/* SPDX-License-Identifier: MIT-0 */"
"""Of generated files, as of the runtime they include: whoever has a model owes nothing for its C."""


def comment(text: str) -> str:
    """A block comment, wrapped; nothing in the text can end it early."""
    safe = "".join(c if c.isprintable() and c.isascii() else "?" for c in text.replace("\n", " "))
    safe = re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", safe)
    lines = textwrap.wrap(safe, WIDTH - 6, break_long_words=False, break_on_hyphens=False) or [""]
    if len(lines) == 1:
        return f"/* {lines[0]} */"
    return "\n".join(["/*", *(f" * {line}" for line in lines), " */"])


def heading(title: str, claim: Claim) -> str:
    """The first lines of a generated file: its licence, what it is, and what the model claims."""
    said = [comment(claim.sentence)] if claim.theorem else []
    return "\n".join([LICENCE, comment(title), *said])


def place(span: Span) -> str:
    """`file:line`, the file without its directory."""
    if span == NOWHERE:
        return ""
    return f"{span.source.file_name}:{span.line}"


def function(head: str, body: Iterable[str], about: str = "") -> str:
    """A function definition with its comment above; `body` lines are indented.

    Parameters that the body has no use for are marked so.
    """
    listed = list(body)
    parameters = re.findall(r"(\w+)(?=[,)])", head.split("(", 1)[1])
    code = re.sub(r"/\*.*?\*/", " ", " ".join(listed))
    used = set(re.findall(r"\w+", code))
    idle = [f"(void){p};" for p in parameters if p not in used and p != "void"]
    lines = [comment(about)] if about else []
    lines += [
        _signature(head),
        "{",
        *textwrap.wrap(
            " ".join(idle), WIDTH, initial_indent="  ", subsequent_indent="  ", break_long_words=False
        ),
    ]
    lines += [f"  {line}" if line else "" for line in listed]
    return "\n".join([*lines, "}"]) + "\n"


def _signature(head: str) -> str:
    """The head of a function, broken after commas where it is too long."""
    if len(head) <= WIDTH:
        return head
    opening, rest = head.split("(", 1)
    far = len(opening) > WIDTH // 2
    indent = "    " if far else " " * (len(opening) + 1)
    lines = [opening + "(", indent] if far else [opening + "("]
    for parameter in re.split(r"(?<=,) ", rest):
        if len(lines[-1]) + len(parameter) > WIDTH:
            lines[-1] = lines[-1].rstrip()
            lines.append(indent)
        lines[-1] += parameter + " "
    return "\n".join(lines).rstrip()


LANES = "const real *restrict x, const real *restrict p, int64_t stride, int64_t count"
"""Parameters of a function over lanes: `count` environments, x and p at the first."""


def each_lane(target: str, value: str) -> list[str]:
    """A loop that computes one value for every lane."""
    return in_each_lane(f"{target} = {value};")


def in_each_lane(statement: str) -> list[str]:
    """A loop of one statement for every lane i."""
    loop = "for (int64_t i = 0; i < count; i++)"
    if len(loop) + 1 + len(statement) <= WIDTH - 2:
        return [f"{loop} {statement}"]
    return [loop, *(f"  {line}" for line in wrapped(statement))]


BYTE = 8
"""Conditions that one loop computes: those that one byte holds."""


def each_flag(conditions: Sequence[tuple[str, str]]) -> list[str]:
    """Loops that compute conditions, each with its target, for every lane of a block.

    Several in one loop share what they are made of. First as bits of a word as wide as the numbers that
    they depend on: a compiler that fits bytes to doubles would work on so many lanes at once that
    registers run out.
    """
    lines = ["int64_t words[DL2C_BLOCK];", "uint8_t bits[DL2C_BLOCK];"] if conditions else []
    for first in range(0, len(conditions), BYTE):
        group = conditions[first : first + BYTE]
        lines += ["for (int64_t i = 0; i < count; i++) {", "  int64_t word = 0;"]
        for k, (_, condition) in enumerate(group):
            lines += [f"  {line}" for line in wrapped(f"word |= (int64_t)({condition}) << {k};")]
        lines += ["  words[i] = word;", "}", *each_lane("bits[i]", "(uint8_t)words[i]")]
        for k, (target, _) in enumerate(group):
            lines += each_lane(target, f"bits[i] >> {k} & 1")
    return lines


def wrapped(statement: str) -> list[str]:
    """A long statement over several lines, broken before operators."""
    if len(statement) <= WIDTH - 2:
        return [statement]
    parts = re.sub(r" (?=(&&?|\|\|?) )", "\n", statement).replace(", ", ",\n").split("\n")
    lines: list[str] = []
    for part in parts:
        if lines and len(lines[-1]) + len(part) + 1 <= WIDTH - 2:
            lines[-1] += " " + part
        else:
            lines.append(part if not lines else "    " + part)
    return lines


def enumeration(entries: Sequence[str], size: str, about: str) -> str:
    """`enum { A, B, SIZE };`"""
    return filled(f"enum {{ {', '.join([*entries, size])} }};", WIDTH, " " * 7) + f" {comment(about)}\n"


def filled(code: str, width: int, indent: str = "") -> str:
    """C in lines no longer than that, but no name is ever broken: names may be longer."""
    return textwrap.fill(code, width, subsequent_indent=indent, break_long_words=False)


def row(values: Iterable[object]) -> str:
    """A row of a table; one zero where it would be empty."""
    listed = [str(v) for v in values]
    return "{" + ", ".join(listed or ["0"]) + "}"


def table(kind: str, name: str, shape: str, rows: Sequence[str], about: str = "") -> str:
    """`static const kind name shape = {rows};` with one row a line."""
    head = f"static const {kind} {name}{shape} = {{"
    lines = [comment(about)] if about else []
    flat = f"{head}{', '.join(rows)}}};"
    lines += [flat] if len(flat) <= WIDTH else [head, *(f"  {r}," for r in rows), "};"]
    return "\n".join(lines) + "\n"
