"""Where the hand-written C is, and one digest of everything that decides what code is generated."""

import hashlib
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
"""The folder of the dl2c package."""


def cgen_dir() -> Path:
    """The hand-written C: inside an installed package, or else beside it in a checkout."""
    packaged = PACKAGE / "cgen"
    return packaged if packaged.is_dir() else PACKAGE.parent / "cgen"


@cache
def code_digest() -> str:
    """SHA-256 over names and bytes of every file of the package and of `cgen`.

    Two installations with the same digest generate the same C for the same model. A process goes on with the
    code that it has imported, so it has one digest, whatever happens to the files.
    """
    digest = hashlib.sha256()
    for root in (PACKAGE, cgen_dir()):
        for name, path in sorted(_files(str(root), "")):
            with open(path, "rb", buffering=0) as file:
                content = file.read()
            digest.update(f"{name}\0{len(content)}\0".encode())
            digest.update(content)
    return digest.hexdigest()


def _files(folder: str, name: str) -> Iterator[tuple[str, str]]:
    """The files that count, by name and path. Every command needs them: pathlib takes three times as long."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if entry.name != "__pycache__":
                    yield from _files(entry.path, f"{name}{entry.name}/")
            elif entry.name.endswith((".py", ".lark", ".cdef", ".c", ".h")):
                yield name + entry.name, entry.path
