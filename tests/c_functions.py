"""Functions of C for tests: a library of those that are declared, over the runtime's headers."""

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cffi

from dl2c.code import cgen_dir
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS, find_compiler


def functions(folder: Path, text: str, expressions: Mapping[str, str]) -> Any:
    """A loaded library: by declaration the expression that a function returns, after `text`. Raises
    `CalledProcessError` for what does not compile without a warning.
    """
    shown = '__attribute__((visibility("default")))'
    bodies = [f"{shown} {declared} {{ return {value}; }}" for declared, value in expressions.items()]
    source, library = folder / "functions.c", folder / "libfunctions.so"
    source.write_text("\n".join([text, *bodies]) + "\n")
    command = [*find_compiler().command, *CODE_FLAGS, *STRICT_FLAGS, "-Wno-missing-prototypes", "-shared"]
    command += [f"-I{cgen_dir() / 'runtime'}", str(source), "-o", str(library), "-lm", *EXACT_FLAGS]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef("\n".join(f"{declared};" for declared in expressions))
    return ffi.dlopen(str(library))
