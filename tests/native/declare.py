"""Writes dl2c/native/declared.py: `python tests/native/declare.py`, after a change of the declarations."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dl2c.native.compile import declarations

MODULE = Path(__file__).resolve().parents[2] / "dl2c" / "native" / "declared.py"

HEAD = '''"""The declarations of dl2c.cdef and dl2c_inspect.cdef as cffi keeps them; nothing is parsed later.

Written by tests/native/declare.py. A library that lacks the calls of dl2c_inspect.h says so when one is used.
"""

import _cffi_backend  # pyright: ignore[reportMissingTypeStubs]  # cffi publishes no types

'''


def arguments(text: str) -> tuple[str, dict[str, Any]]:
    """What a module of cffi gives to its backend."""
    found: list[tuple[str, dict[str, Any]]] = []

    def ffi(name: str, **rows: Any) -> None:
        found.append((name, rows))

    lines = [line for line in text.splitlines() if not line.startswith("import ")]
    exec("\n".join(lines), {"_cffi_backend": type("", (), {"FFI": staticmethod(ffi)})})
    return found[0]


def made() -> tuple[str, dict[str, Any]]:
    """The same, made of the declarations."""
    ffi = declarations(inspect=True)
    ffi.set_source("declared", None)
    with TemporaryDirectory() as folder:
        ffi.emit_python_code(str(Path(folder, "declared.py")))
        return arguments(Path(folder, "declared.py").read_text(encoding="utf-8"))


def written(value: Any) -> str:
    """Python text with short lines."""
    match value:
        case bytes():
            rows = [value[k : k + 20] for k in range(0, len(value), 20)]
            return "(" + " ".join(repr(row) for row in rows) + ")"
        case tuple():
            return "(" + "".join(f"{written(v)}, " for v in value) + ")"
        case _:
            return repr(value)


if __name__ == "__main__":
    name, rows = made()
    listed = "".join(f"    {key}={written(value)},\n" for key, value in rows.items())
    MODULE.write_text(f'{HEAD}ffi = _cffi_backend.FFI(\n    "{name}",\n{listed})\n', encoding="utf-8")
