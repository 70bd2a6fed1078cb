"""Where the solver of flows without a closed form comes from.

`casadi`: the CVODES inside the casadi wheel, loaded when a model is; needs no system package.
`system`: an installed SUNDIALS, found by the compiler and linked into the model.
"""

import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dl2c.native.errors import CompilerFailed, NativeError
from dl2c.native.toolchain import VERSION_SECONDS, Compiler, user_flags
from dl2c.options import Provider
from dl2c.version import version_of

INSTALL_HINT = "install it with `apt install libsundials-dev`, or build without `--sundials system`"
OLDEST = 6
"""The first major version of SUNDIALS whose interface the runtime knows."""

LIBRARIES = ("cvodes", "nvecserial", "sunlinsolspgmr", "sunnonlinsolfixedpoint")
PROBE = "#include <sundials/sundials_version.h>\n=SUNDIALS_VERSION_MAJOR=SUNDIALS_VERSION=\n"
CAPACITY = 1024
"""Bytes for what the C library says of a problem."""


@dataclass(frozen=True, slots=True)
class Sundials:
    """What to compile and link a model with; `version` belongs to the key and the manifest of a build."""

    provider: Provider
    version: str
    flags: tuple[str, ...] = ()
    link_flags: tuple[str, ...] = ()


def find_sundials(provider: Provider, compiler: Compiler) -> Sundials:
    """The provider as it is installed here.

    Raises `NativeError` if casadi has no CVODES, `CompilerFailed` if the compiler finds no SUNDIALS
    or one that is too old.
    """
    if provider == "system":
        major, version = _system_version(compiler)
        libraries = (*LIBRARIES, "core") if major >= 7 else LIBRARIES
        link = tuple(f"-lsundials_{name}" for name in libraries)
        return Sundials("system", version, ("-DDL2C_SUNDIALS_SYSTEM",), link)
    casadi_library()
    return Sundials("casadi", f"casadi {version_of('casadi')}")


def casadi_library() -> Path:
    """The library in the casadi package that contains CVODES.

    Raises `NativeError` if it is not there. Does not import casadi.
    """
    spec = importlib.util.find_spec("casadi")
    suffix = "dylib" if sys.platform == "darwin" else "so"
    if spec is not None and spec.origin is not None:
        library = Path(spec.origin).with_name(f"libcasadi_integrator_cvodes.{suffix}")
        if library.is_file():
            return library
    raise NativeError(
        "the casadi package has no CVODES, which this model's flows are solved with: install casadi from "
        "PyPI, or build with `--sundials system`"
    )


def load_solver(ffi: Any, lib: Any, provider: str) -> None:
    """Give a loaded model its solver. Harmless where it has one or needs none.

    Raises `NativeError` if the library cannot be loaded or lacks a function.
    """
    path = casadi_library() if provider == "casadi" else Path()
    problem = ffi.new("char[]", CAPACITY)
    if lib.dl2c_solver_library(os.fsencode(path), problem, CAPACITY):
        said = ffi.string(problem).decode(errors="replace")
        raise NativeError(f"cannot load the solver of casadi: {said}; try another version of casadi")


def _system_version(compiler: Compiler) -> tuple[int, str]:
    """Major version and version of the SUNDIALS whose headers the compiler finds."""
    command = (*compiler.command, *user_flags(), "-E", "-P", "-x", "c", "-")
    try:
        result = subprocess.run(
            command, input=PROBE, capture_output=True, text=True, check=False, timeout=VERSION_SECONDS
        )
    except subprocess.TimeoutExpired:
        raise CompilerFailed(f"{command[0]} -E did not end within {VERSION_SECONDS} seconds") from None
    except OSError as problem:
        raise CompilerFailed(f"cannot run {command[0]}: {problem.strerror}") from None
    found = result.stdout.replace(" ", "").partition("=")[2].split("=")
    if result.returncode != 0 or not found[0].isdigit():
        raise CompilerFailed(f"SUNDIALS is not installed: {INSTALL_HINT}")
    version = found[1].strip('"')
    if int(found[0]) < OLDEST:
        raise CompilerFailed(f"SUNDIALS {version} is too old, {OLDEST} is needed: {INSTALL_HINT}")
    return int(found[0]), version
