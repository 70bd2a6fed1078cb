"""From generated C to a library that `binding` can load.

In go the texts `<module>.h` and `<module>.c`; the latter includes the whole runtime and
defines the functions of dl2c.h. Out comes a shared library. Same input, same commands.
"""

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dl2c.code import cgen_dir
from dl2c.native.errors import CompilerFailed
from dl2c.native.sundials import Sundials
from dl2c.native.toolchain import (
    Compiler,
    find_compiler,
    link_flags,
    run,
    run_all,
    user_flags,
    warning_flags,
)

CDEF = Path(__file__).with_name("dl2c.cdef")
INSPECT_CDEF = Path(__file__).with_name("dl2c_inspect.cdef")


def compile_library(
    sources: Mapping[str, str],
    module: str,
    directory: Path,
    *,
    native: bool | None = None,
    sundials: Sundials | None = None,
    inspect: bool = False,
    debug: bool = False,
) -> Path:
    """Write `sources` into `directory`, compile those that are C there and return the library.

    `native` and `debug` are those of `Compiler.flags`; `sundials` is what flows are solved with; `inspect`
    adds the calls of dl2c_inspect.h. Raises `CompilerMissing`, `CompilerFailed`.
    """
    assert module.isidentifier() and f"{module}.c" in sources
    compiler = find_compiler()
    directory.mkdir(parents=True, exist_ok=True)
    for name, text in sources.items():
        (directory / name).write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="objects-", dir=directory) as scratch:
        others = tuple(sorted(n for n in sources if n.endswith(".c") and n != f"{module}.c"))
        job = _Job(compiler, module, directory, Path(scratch), native, sundials, inspect, debug, others)
        run_all(_commands(job), directory)
        return _link(job)


def declarations(inspect: bool = False) -> Any:
    """A cffi FFI that knows dl2c.h, and dl2c_inspect.h where that is asked for. Reads them, which is slow:
    `declared.py` keeps the result.
    """
    import cffi  # pyright: ignore[reportMissingTypeStubs]  # cffi publishes no types

    ffi: Any = cffi.FFI()
    ffi.cdef(CDEF.read_text(encoding="utf-8"))
    if inspect:
        ffi.cdef(INSPECT_CDEF.read_text(encoding="utf-8"))
    return ffi


@dataclass(frozen=True, slots=True)
class _Job:
    """One call of `compile_library`; objects go to `scratch`. `others` are sources beside the model's."""

    compiler: Compiler
    module: str
    directory: Path
    scratch: Path
    native: bool | None
    sundials: Sundials | None
    inspect: bool
    debug: bool
    others: tuple[str, ...] = ()


def _sources(job: _Job) -> tuple[tuple[str, str], ...]:
    """Each source with its object."""
    names = (f"{job.module}.c", *job.others)
    return tuple((name, str(job.scratch / f"{Path(name).stem}.o")) for name in names)


def _commands(job: _Job) -> tuple[tuple[str, ...], ...]:
    """The commands for generated code and the runtime that it includes."""
    return tuple(_command(job, source, output) for source, output in _sources(job))


def _command(job: _Job, source: str, output: str) -> tuple[str, ...]:
    chosen = job.sundials.flags if job.sundials else ()
    size = (job.directory / source).stat().st_size
    inspect = ("-DDL2C_INSPECT=1",) if job.inspect else ()
    defined = ("-DDL2C_SHARED", *chosen, *inspect)
    flags = (*job.compiler.flags(job.native, size, job.debug), *warning_flags(), *defined, *_includes())
    return (*job.compiler.command, *flags, "-c", source, "-o", output)


def _includes() -> tuple[str, ...]:
    return (f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}")


def _link(job: _Job) -> Path:
    """Link beside and rename, so that a process which has the old library loaded keeps it whole."""
    name = f"lib{job.module}.so"
    library, linked = job.directory / name, job.scratch / name
    solver = job.sundials.link_flags if job.sundials else ()
    flags = (*user_flags(), *link_flags(), *solver)
    objects = (output for _, output in _sources(job))
    run((*job.compiler.command, *objects, *flags, "-o", str(linked)), job.directory)
    try:
        os.replace(linked, library)
    except OSError as problem:
        raise CompilerFailed(f"cannot write {name}: {problem.strerror}") from None
    return library
