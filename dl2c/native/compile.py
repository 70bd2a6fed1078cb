"""From generated C to a library that `binding` can load.

In go the texts `<module>.h` and `<module>.c`; the latter includes the whole runtime and
defines the functions of dl2c.h. Out comes an extension module with the cffi glue linked
in, or, where Python.h is missing, a plain shared library. Same input, same commands.
"""

import os
import sysconfig
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cffi  # pyright: ignore[reportMissingTypeStubs]  # cffi publishes no types

from dl2c.native.code import cgen_dir
from dl2c.native.errors import CompilerFailed
from dl2c.native.toolchain import (
    STRICT_FLAGS,
    Compiler,
    find_compiler,
    link_flags,
    python_include,
    run,
    user_flags,
)

CDEF = Path(__file__).with_name("dl2c.cdef")


def compile_library(
    sources: Mapping[str, str], module: str, directory: Path, *, native: bool = False
) -> Path:
    """Write `sources` into `directory`, compile `<module>.c` there and return the library.

    `native` tunes for this machine's CPU. Raises `CompilerMissing`, `CompilerFailed`.
    """
    assert module.isidentifier() and f"{module}.c" in sources
    compiler = find_compiler()
    directory.mkdir(parents=True, exist_ok=True)
    for name, text in sources.items():
        (directory / name).write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="objects-", dir=directory) as scratch:
        if include := python_include():
            return _extension(compiler, module, directory, Path(scratch), include, native)
        return _shared(compiler, module, directory, Path(scratch), native)


def declarations() -> Any:
    """A cffi FFI that knows dl2c.h."""
    ffi: Any = cffi.FFI()
    ffi.cdef(CDEF.read_text(encoding="utf-8"))
    return ffi


def library_names(module: str) -> tuple[str, str]:
    """File names of the extension module and of the plain library of a model."""
    return f"_{module}{sysconfig.get_config_var('EXT_SUFFIX')}", f"lib{module}.so"


def _extension(
    compiler: Compiler, module: str, directory: Path, scratch: Path, include: tuple[str, ...], native: bool
) -> Path:
    glue = scratch / f"_{module}.c"
    ffi = declarations()
    ffi.set_source(f"_{module}", '#include "dl2c.h"\n', compiler_verbose=False)
    ffi.emit_c_code(str(glue))
    headers = (*_includes(), *include)
    lenient = ("-std=c11", "-O1", "-w", "-fPIC", "-fvisibility=hidden", *user_flags())
    model_o, glue_o = str(scratch / "model.o"), str(scratch / "glue.o")
    commands = (
        _strict(compiler, module, native, model_o),
        (*compiler.command, *lenient, *headers, "-c", str(glue), "-o", glue_o),
    )
    with ThreadPoolExecutor(len(commands)) as pool:
        for done in [pool.submit(run, command, directory) for command in commands]:
            done.result()
    return _link(compiler, (model_o, glue_o), directory / library_names(module)[0], scratch)


def _shared(compiler: Compiler, module: str, directory: Path, scratch: Path, native: bool) -> Path:
    model_o = str(scratch / "model.o")
    run((*_strict(compiler, module, native, model_o), "-DDL2C_SHARED"), directory)
    return _link(compiler, (model_o,), directory / library_names(module)[1], scratch)


def _strict(compiler: Compiler, module: str, native: bool, output: str) -> tuple[str, ...]:
    """The command for generated code: every warning is an error, as for the runtime it includes."""
    flags = (*compiler.flags(native), *STRICT_FLAGS, *_includes())
    return (*compiler.command, *flags, "-c", f"{module}.c", "-o", output)


def _includes() -> tuple[str, ...]:
    return (f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}")


def _link(compiler: Compiler, objects: tuple[str, ...], library: Path, scratch: Path) -> Path:
    """Link beside and rename, so that a process which has the old library loaded keeps it whole."""
    linked = scratch / library.name
    run((*compiler.command, *objects, *user_flags(), *link_flags(), "-o", str(linked)), library.parent)
    try:
        os.replace(linked, library)
    except OSError as problem:
        raise CompilerFailed(f"cannot write {library.name}: {problem.strerror}") from None
    return library
