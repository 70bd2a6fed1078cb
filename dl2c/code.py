"""Where the hand-written C is, and one digest of everything that decides what code is generated."""

import hashlib
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
        for path in sorted(root.rglob("*")):
            if path.suffix in {".py", ".lark", ".cdef", ".c", ".h"}:
                content = path.read_bytes()
                digest.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode())
                digest.update(content)
    return digest.hexdigest()
