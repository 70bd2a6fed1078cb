"""From generated C to a WebAssembly module that needs nothing of the page that it runs in.

Compiled by zig, which brings a C library along: it compiles that once for a folder of this user.
"""

import importlib.util
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from dl2c.code import cgen_dir, code_digest
from dl2c.native.cache import ZIG, cached, key_of
from dl2c.native.errors import CompilerMissing, NativeError
from dl2c.native.toolchain import EXACT_FLAGS, run, warning_flags
from dl2c.progress import Progress
from dl2c.storage import StorageError, private_folder
from dl2c.version import install

FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-rdynamic", "-std=c11", "-O2", "-s"),
    *("-fno-trapping-math", "-fno-math-errno"),
    *("-DDL2C_SHARED", "-DDL2C_NO_TARGET_CLONES", "-DDL2C_NO_THREADS", "-DDL2C_INSPECT=1"),
)
"""One thread, no clones, nothing imported; every call of dl2c.h is exported."""

COMMAND = (sys.executable, "-m", "ziglang", "cc")

MODULE = "page.wasm"

FIRST = "compiling C to WebAssembly, the first time with zig's C library: about half a minute"
LATER = "compiling C to WebAssembly"


def require_zig() -> None:
    """Raises `CompilerMissing` where there is none."""
    if importlib.util.find_spec("ziglang") is None:
        raise CompilerMissing(f"WebAssembly is compiled by zig: `{install('zig')}`")


def compile_wasm(sources: Mapping[str, str], main: str, progress: Progress) -> bytes:
    """The module of the files in `sources`: `main` and what it includes, and the monitor of every step where
    there is one. Kept like a build. Raises `CompilerMissing`, `CompilerFailed`, `NativeError`.
    """
    require_zig()
    units = (main, *sorted(name for name in sources if name.endswith("_monitor.c")))

    def build(folder: Path) -> None:
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        includes = (f"-I{cgen_dir() / 'include'}", f"-I{cgen_dir() / 'runtime'}")
        command = (*COMMAND, *FLAGS, *warning_flags(), *EXACT_FLAGS, *includes, *units, "-o", MODULE)
        run(command, folder, _zig_folders(progress))

    return cached(_key(sources, main), build, lambda folder: (folder / MODULE).read_bytes())


def _key(sources: Mapping[str, str], main: str) -> str:
    """Names everything that the module depends on."""
    zig = version("ziglang")
    facts = {"sources": dict(sources), "main": main, "flags": FLAGS, "zig": zig, "code": code_digest()}
    return key_of(facts)


def _zig_folders(progress: Progress) -> dict[str, str]:
    """Variables that make zig keep what it compiles in a folder of dl2c, not in the user's home."""
    try:
        folder = private_folder(ZIG)
    except StorageError as problem:
        raise NativeError(str(problem)) from None
    progress(LATER if (folder / "o").is_dir() else FIRST)
    return {"ZIG_GLOBAL_CACHE_DIR": str(folder), "ZIG_LOCAL_CACHE_DIR": str(folder)}
