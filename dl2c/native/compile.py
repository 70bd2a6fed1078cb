"""From generated C to a library that `binding` can load.

In go the texts `<module>.h` and `<module>.c`; the latter includes the whole runtime and
defines the functions of dl2c.h. Out comes an extension module with the cffi glue linked
in, or, where Python.h is missing, a plain shared library. Same input, same commands.
"""

import os
import sysconfig
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cffi  # pyright: ignore[reportMissingTypeStubs]  # cffi publishes no types

from dl2c.code import cgen_dir
from dl2c.native.errors import CompilerFailed
from dl2c.native.sundials import Sundials
from dl2c.native.toolchain import (
    Compiler,
    find_compiler,
    link_flags,
    python_include,
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
    native: bool = False,
    sundials: Sundials | None = None,
    inspect: bool = False,
) -> Path:
    """Write `sources` into `directory`, compile those that are C there and return the library.

    `native` tunes for this machine's CPU; `sundials` is what flows are solved with; `inspect` adds the calls
    of dl2c_inspect.h. Raises `CompilerMissing`, `CompilerFailed`.
    """
    assert module.isidentifier() and f"{module}.c" in sources
    compiler = find_compiler()
    directory.mkdir(parents=True, exist_ok=True)
    for name, text in sources.items():
        (directory / name).write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="objects-", dir=directory) as scratch:
        others = tuple(sorted(n for n in sources if n.endswith(".c") and n != f"{module}.c"))
        job = _Job(compiler, module, directory, Path(scratch), native, sundials, inspect, others)
        if include := python_include():
            return _extension(job, include)
        return _shared(job)


def declarations(inspect: bool = False) -> Any:
    """A cffi FFI that knows dl2c.h, and dl2c_inspect.h where that is asked for."""
    ffi: Any = cffi.FFI()
    ffi.cdef(CDEF.read_text(encoding="utf-8"))
    if inspect:
        ffi.cdef(INSPECT_CDEF.read_text(encoding="utf-8"))
    return ffi


def library_names(module: str) -> tuple[str, str]:
    """File names of the extension module and of the plain library of a model."""
    return f"_{module}{sysconfig.get_config_var('EXT_SUFFIX')}", f"lib{module}.so"


@dataclass(frozen=True, slots=True)
class _Job:
    """One call of `compile_library`; objects go to `scratch`. `others` are sources beside the model's."""

    compiler: Compiler
    module: str
    directory: Path
    scratch: Path
    native: bool
    sundials: Sundials | None
    inspect: bool
    others: tuple[str, ...] = ()


def _extension(job: _Job, include: tuple[str, ...]) -> Path:
    glue = job.scratch / f"_{job.module}.c"
    ffi = declarations(job.inspect)
    header = "dl2c_inspect.h" if job.inspect else "dl2c.h"
    ffi.set_source(f"_{job.module}", f'#include "{header}"\n', compiler_verbose=False)
    ffi.emit_c_code(str(glue))
    headers = (*_includes(), *include)
    lenient = ("-std=c11", "-O1", "-w", "-fPIC", "-fvisibility=hidden", *user_flags())
    model_o, glue_o = str(job.scratch / "model.o"), str(job.scratch / "glue.o")
    commands = (
        *_commands(job, model_o),
        (*job.compiler.command, *lenient, *headers, "-c", str(glue), "-o", glue_o),
    )
    run_all(commands, job.directory)
    return _link(job, (*_objects(job, model_o), glue_o), library_names(job.module)[0])


def _shared(job: _Job) -> Path:
    model_o = str(job.scratch / "model.o")
    for command in _commands(job, model_o):
        run((*command, "-DDL2C_SHARED"), job.directory)
    return _link(job, _objects(job, model_o), library_names(job.module)[1])


def _objects(job: _Job, model: str) -> tuple[str, ...]:
    return (model, *(str(job.scratch / f"{Path(name).stem}.o") for name in job.others))


def _commands(job: _Job, model: str) -> tuple[tuple[str, ...], ...]:
    """The commands for generated code and the runtime that it includes."""
    sources = (f"{job.module}.c", *job.others)
    return tuple(_command(job, s, o) for s, o in zip(sources, _objects(job, model), strict=True))


def _command(job: _Job, source: str, output: str) -> tuple[str, ...]:
    chosen = job.sundials.flags if job.sundials else ()
    size = (job.directory / source).stat().st_size
    inspect = ("-DDL2C_INSPECT=1",) if job.inspect else ()
    flags = (*job.compiler.flags(job.native, size), *warning_flags(), *chosen, *inspect, *_includes())
    return (*job.compiler.command, *flags, "-c", source, "-o", output)


def _includes() -> tuple[str, ...]:
    return (f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}")


def _link(job: _Job, objects: tuple[str, ...], name: str) -> Path:
    """Link beside and rename, so that a process which has the old library loaded keeps it whole."""
    library, linked = job.directory / name, job.scratch / name
    solver = job.sundials.link_flags if job.sundials else ()
    flags = (*user_flags(), *link_flags(), *solver)
    run((*job.compiler.command, *objects, *flags, "-o", str(linked)), job.directory)
    try:
        os.replace(linked, library)
    except OSError as problem:
        raise CompilerFailed(f"cannot write {name}: {problem.strerror}") from None
    return library
