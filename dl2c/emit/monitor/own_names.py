"""Names of a C file that no other file of a program shares, for whoever compiles many as one."""

import re

DEFINED = re.compile(
    r"^static (?:inline )?(?:const )?[\w ]+?[ *](?P<function>\w+)\("
    r"|^static const \w+ (?P<table>\w+)\["
    r"|^typedef [^;{]*?(?P<alias>\w+);"
    r"|^\} (?P<type>\w+);"
    r"|^#define (?P<macro>\w+)"
    r"|^enum \{(?P<constants>[^}]*)\}",
    re.MULTILINE,
)
"""What a file defines at its top level for itself."""

WORDS = re.compile(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"|(?:\.|->)\s*\w+|\b[A-Za-z_]\w*", re.DOTALL)
"""Comments, texts, members and names."""


def with_own_names(text: str, stem: str) -> str:
    """The file with `stem` before every name that it defines for itself. Names that have it stay."""
    own: set[str] = set()
    for found in DEFINED.finditer(text):
        listed = found["constants"] or ""
        names = [part.split("=")[0].strip() for part in listed.split(",")]
        whole = found.groupdict() | {"constants": None}
        own |= {*filter(None, (*names, *whole.values()))}
    renamed = {name: f"{stem}_{name}" for name in own if not name.startswith(f"{stem}_")}
    there = set(re.findall(r"\b[A-Za-z_]\w*", text))
    assert not there & set(renamed.values()), "a name of the model's begins like one of its monitor"
    return WORDS.sub(lambda word: renamed.get(word[0], word[0]), text)
