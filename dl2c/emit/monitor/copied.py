"""The C of cgen that exported files hold copies of: definitions by name, with names of their own."""

import re
from collections.abc import Mapping
from functools import cache

from dl2c.code import cgen_dir

DEFINED = re.compile(
    r"^(?:static (?:inline )?[\w ]+?[ *](\w+)\(|\} (\w+);|enum \{ (\w+)|(?!static|enum|typedef)\w+ (\w+)\()",
    re.MULTILINE,
)
"""The name of a function, a type, or the first constant of an enumeration."""


def copied(file: str, names: tuple[str, ...], words: Mapping[str, str] | None = None) -> str:
    """Definitions of a file of cgen/monitor, by name, with other words for some of its."""
    parts = _definitions(file)
    text = "\n".join(parts[name] for name in names)
    return re.sub("|".join(words), lambda found: words[found[0]], text) if words else text


def copied_body(file: str, name: str, words: Mapping[str, str]) -> list[str]:
    """The statements of a function of cgen/monitor."""
    lines = copied(file, (name,), words).splitlines()
    return [line.removeprefix("  ") for line in lines[lines.index("{") + 1 : lines.index("}")]]


def preprocessed(file: str) -> str:
    """The lines between the includes of a file of cgen/monitor and its end."""
    text = (cgen_dir() / "monitor" / file).read_text(encoding="utf-8")
    return text.split("#include", 1)[1].split("\n\n", 1)[1].rsplit("\n#endif", 1)[0]


def one_line(name: str) -> str:
    """A function of the runtime's numbers.h that is one line."""
    text = (cgen_dir() / "runtime" / "numbers.h").read_text(encoding="utf-8")
    found = re.search(rf"^static inline real {name}\(.*\n", text, re.MULTILINE)
    assert found is not None, name
    return found[0]


@cache
def _definitions(file: str) -> dict[str, str]:
    """What blank lines part, by the name that it defines."""
    text = (cgen_dir() / "monitor" / file).read_text(encoding="utf-8")
    found: dict[str, str] = {}
    for block in text.split("\n\n"):
        if match := DEFINED.search(block):
            name = next(group for group in match.groups() if group)
            found.setdefault(name, block.strip("\n") + "\n")
    return found
