"""From generated C to a library that `binding` can load.

In go the texts `<module>.h` and `<module>.c`; the latter includes the whole runtime and
defines the functions of dl2c.h. Out comes a shared library. Same input, same commands.

What goes into the cache is compiled in two units: rewards, and all else, whose object is kept. So a model
of which only rewards were changed is soon compiled.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dl2c.code import cgen_dir, code_digest
from dl2c.native.cache import cached, key_of, name_entry
from dl2c.native.errors import CompilerFailed
from dl2c.native.sundials import Sundials
from dl2c.native.toolchain import (
    Compiler,
    cpu_features,
    find_compiler,
    link_flags,
    run,
    run_all,
    user_flags,
    warning_flags,
)

CDEF = Path(__file__).with_name("dl2c.cdef")
INSPECT_CDEF = Path(__file__).with_name("dl2c_inspect.cdef")

APART = ("-DDL2C_REWARDS_APART=1",)
"""For the unit of rewards, and for the one without them."""

COMMENT = re.compile(r'(?P<string>"(?:\\.|[^"\\\n])*")|/\*.*?\*/', re.DOTALL)
"""A comment in C, or a string, in which there is none."""


def compile_library(
    sources: Mapping[str, str],
    module: str,
    directory: Path,
    *,
    native: bool | None = None,
    sundials: Sundials | None = None,
    inspect: bool = False,
    debug: bool = False,
    keep: bool = False,
) -> Path:
    """Write `sources` into `directory`, compile those that are C there and return the library.

    `native` and `debug` are those of `Compiler.flags`; `sundials` is what flows are solved with; `inspect`
    adds the calls of dl2c_inspect.h; `keep` takes from the cache, or puts there, what rewards do not decide.
    Raises `CompilerMissing`, `CompilerFailed`, and with `keep` what `cached` raises.
    """
    assert module.isidentifier() and f"{module}.c" in sources
    compiler = find_compiler()
    directory.mkdir(parents=True, exist_ok=True)
    for name, text in sources.items():
        (directory / name).write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="objects-", dir=directory) as scratch:
        job = _Job(compiler, module, directory, Path(scratch), native, sundials, inspect, debug)
        apart = keep and not debug  # a debugger shows lines, comments among them
        units = _units(job, sources, apart)
        if apart:
            _take(job, units, sources)
        run_all([unit.command for unit in units if not unit.output.exists()], directory)
        return _link(job, units)


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
    """One call of `compile_library`; objects go to `scratch`."""

    compiler: Compiler
    module: str
    directory: Path
    scratch: Path
    native: bool | None
    sundials: Sundials | None
    inspect: bool
    debug: bool


@dataclass(frozen=True, slots=True)
class _Unit:
    """An object, and the command that makes it."""

    output: Path
    command: tuple[str, ...]


def _units(job: _Job, sources: Mapping[str, str], apart: bool) -> list[_Unit]:
    """The generated code with the runtime that it includes, other sources, and rewards if `apart`."""
    main = f"{job.module}.c"
    others = sorted(name for name in sources if name.endswith(".c") and name != main)
    if not apart:
        return [_unit(job, name) for name in (main, *others)]
    rewards = _unit(job, f"{job.module}_rewards.h", *APART, "-x", "c")
    return [_unit(job, main, *APART), rewards, *(_unit(job, name) for name in others)]


def _unit(job: _Job, source: str, *more: str) -> _Unit:
    chosen = job.sundials.flags if job.sundials else ()
    size = (job.directory / source).stat().st_size
    inspect = ("-DDL2C_INSPECT=1",) if job.inspect else ()
    defined = ("-DDL2C_SHARED", *chosen, *inspect, *more)
    flags = (*job.compiler.flags(job.native, size, job.debug), *warning_flags(), *defined, *_includes())
    output = job.scratch / f"{Path(source).stem}.o"
    return _Unit(output, (*job.compiler.command, *flags, "-c", source, "-o", str(output)))


def _take(job: _Job, units: Sequence[_Unit], sources: Mapping[str, str]) -> None:
    """The object of the first unit from the cache; where it is not there, all of them are compiled."""
    output = units[0].output

    def build(folder: Path) -> None:
        run_all([unit.command for unit in units], job.directory)
        os.replace(output, folder / output.name)
        name_entry(folder, output.name)

    cached(_key(job, units[0], sources), build, lambda folder: shutil.copyfile(folder / output.name, output))


def _key(job: _Job, unit: _Unit, sources: Mapping[str, str]) -> str:
    """Names everything that the object depends on: of the sources all but rewards and comments."""
    included = (name for name in sources if name == f"{job.module}.c" or name.endswith(".h"))
    facts = {
        "sources": {name: _code(sources[name]) for name in included if not name.endswith("_rewards.h")},
        "command": unit.command[:-1],
        "compiler": job.compiler.version,
        "sundials": job.sundials.version if job.sundials else "",
        "code": code_digest(),
        "cpu": cpu_features(),
    }
    return key_of(facts)


def _code(text: str) -> str:
    """C without comments and empty lines."""
    return re.sub(r"\s*\n\s*", "\n", COMMENT.sub(lambda found: found["string"] or "", text))


def _includes() -> tuple[str, ...]:
    return (f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}")


def _link(job: _Job, units: Sequence[_Unit]) -> Path:
    """Link beside and rename, so that a process which has the old library loaded keeps it whole."""
    name = f"lib{job.module}.so"
    library, linked = job.directory / name, job.scratch / name
    solver = job.sundials.link_flags if job.sundials else ()
    flags = (*user_flags(), *link_flags(), *solver)
    objects = (str(unit.output) for unit in units)
    run((*job.compiler.command, *objects, *flags, "-o", str(linked)), job.directory)
    try:
        os.replace(linked, library)
    except OSError as problem:
        raise CompilerFailed(f"cannot write {name}: {problem.strerror}") from None
    return library
