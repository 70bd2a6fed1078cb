"""Which C compiler to run, and with which flags, on which machine.

Assumes a command line like that of gcc; clang and zig have it. Floating-point results
are part of a model's meaning, so no flag that lets a compiler reorder arithmetic is
ever passed on.
"""

import importlib.util
import os
import platform
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

from dl2c.native.errors import CompilerFailed, CompilerMissing, PlatformUnsupported
from dl2c.progress import LOG
from dl2c.version import install, version_of

CODE_FLAGS = ("-std=c11", "-O3", "-fno-trapping-math", "-fno-math-errno", "-fvisibility=hidden", "-fPIC")
GCC_FLAGS = (
    *("-fno-tree-pre", "-fno-code-hoisting", "-fno-gcse", "-fno-rerun-cse-after-loop", "-fno-thread-jumps"),
    *("-fno-gcse-after-reload", "-fno-predictive-commoning", "-fno-tree-vrp"),
    *("-fno-unswitch-loops", "-fno-split-loops", "-fno-peel-loops", "-fno-loop-unroll-and-jam"),
    *("-fno-tree-loop-distribution", "-fno-ipa-cp-clone", "-fno-schedule-insns2", "-fno-tree-slp-vectorize"),
    *("--param=max-completely-peeled-insns=80", "-falign-functions=64"),
)
"""Without passes of GCC that make this code no faster: they take a quarter of the time, and the first (which
runs unless both of its flags are there) most of it in large models. The last pass makes vectors of values of
a single environment, with which its steps are slower; loops over lanes are vectorised by another pass. Loops
are unrolled whole up to 80 instructions: with GCC's own 200 compiling takes a tenth longer, and no step is
faster; with 60 some are slower. Functions begin at lines of the cache, or a step takes up to 8 % longer
where other functions before its own have changed.
"""

LONG_CODE, LONG_FLAGS = 200_000, ("-O1",)
"""Characters beyond which generated code is optimised less; the largest example has a third of that."""

STRICT_FLAGS = (
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Wvla"),
    "-Werror",
)
"""For generated code and runtime, where DL2C_STRICT=1 is set; what is new in a compiler stops no user."""

EXACT_FLAGS = ("-ffp-contract=off",)
"""Last on the command line, so that CFLAGS cannot undo them."""

ZIG_LACKS = ("-DDL2C_NO_TARGET_CLONES",)
"""zig tunes for the machine it runs on unless told otherwise, and cannot link `target_clones`."""

NATIVE = ("-march=native", "-DDL2C_NO_TARGET_CLONES")
"""For this CPU alone. What is compiled for it cannot be inlined into code for another one, as clones are."""

DEBUG = ("-O0", "-g", "-DDL2C_NO_TARGET_CLONES")
"""For a debugger, in a quarter of the time: no optimisation, one clone. Results are the same."""

UNSAFE_FLAGS = frozenset(
    {
        "-Ofast",
        "-ffast-math",
        "-funsafe-math-optimizations",
        "-fassociative-math",
        "-freciprocal-math",
        "-ffinite-math-only",
        "-fno-signed-zeros",
    }
)

NO_WINDOWS = (
    "dl2c does not build models on Windows itself: install WSL (`wsl --install`), and dl2c inside it "
    "as on Linux; see https://learn.microsoft.com/windows/wsl"
)

WIDER = ("avx", "fma", "fma4", "avx2", "avx512f", "asimd", "sve")
"""Features of a CPU by which mathematical libraries choose among variants that round differently."""

MAX_ERROR_LINES = 12

COMPILER_SECONDS = 900
"""Of processor time: what takes longer has far too many variables, predicates or paths."""

PATIENCE = 2
"""How many times as long a compiler may take that waits for something."""

GRACE = 2.0
"""Seconds in which a compiler that is to end may clean up."""

VERSION_SECONDS = 60
MOST_SAID = 10**6
"""Bytes of a compiler's messages that are read."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """A command that compiles C. `version` is what it says of itself."""

    command: tuple[str, ...]
    version: str
    zig: bool = False

    @property
    def gcc(self) -> bool:
        """Whether it is GCC, by whatever name."""
        return "Free Software Foundation" in self.version

    def flags(self, native: bool | None, size: int = 0, debug: bool = False) -> tuple[str, ...]:
        """The flags for generated code of so many characters, without the warnings. `native` tunes for this
        CPU, None where that replaces clones for several. Long code is optimised less, which takes a tenth of
        the time and changes no result; with `debug` not at all, for no CPU in particular.

        Raises `CompilerFailed` if CFLAGS asks for arithmetic that is not exact.
        """
        if native is None:
            native = not self.zig and (sys.platform, platform.machine()) == ("linux", "x86_64")
        tuning = NATIVE if native and not debug else ("-mcpu=baseline",) if self.zig else ()
        lacking = ZIG_LACKS if self.zig else ()
        own = GCC_FLAGS if self.gcc else ()
        less = DEBUG if debug else LONG_FLAGS if size > LONG_CODE else ()
        return (*CODE_FLAGS, *own, *less, *tuning, *lacking, *user_flags(), *EXACT_FLAGS)


def find_compiler(environment: Mapping[str, str] | None = None) -> Compiler:
    """`$CC`, else cc, gcc or clang on the path, else the ziglang package.

    Raises `CompilerMissing` if there is none, or if `$CC` names none; `PlatformUnsupported` on Windows.
    """
    if platform.system() == "Windows":
        raise PlatformUnsupported(NO_WINDOWS)
    env = os.environ if environment is None else environment
    path = env.get("PATH", os.defpath)
    if chosen := _words("CC", env.get("CC", "")):
        if (found := shutil.which(chosen[0], path=path)) is None:
            raise CompilerMissing(f"CC={chosen[0]} is not a program on the path; unset CC, or {_advice()}")
        return _compiler(chosen, found)
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name, path=path):
            return _compiler([found], found)
    if importlib.util.find_spec("ziglang") is not None:
        return _compiler([sys.executable, "-m", "ziglang", "cc"], sys.executable)
    raise CompilerMissing(f"no C compiler was found: {_advice()}")


def _advice() -> str:
    return f"install one with `apt install gcc`, or use the compiler of `{install('zig')}`"


def warning_flags() -> tuple[str, ...]:
    """`STRICT_FLAGS` where the environment asks for them, as the tests do, else none."""
    return STRICT_FLAGS if os.environ.get("DL2C_STRICT") == "1" else ("-w",)


def _words(name: str, text: str) -> tuple[str, ...]:
    """An environment variable, split as a shell would; no shell ever sees it."""
    try:
        return tuple(shlex.split(text))
    except ValueError as problem:
        raise CompilerFailed(f"{name} cannot be split into words: {problem}") from None


def user_flags() -> tuple[str, ...]:
    """CFLAGS, split as a shell would; raises `CompilerFailed` for flags that break exactness."""
    flags = _words("CFLAGS", os.environ.get("CFLAGS", ""))
    if unsafe := UNSAFE_FLAGS.intersection(flags):
        raise CompilerFailed(
            f"CFLAGS contains {', '.join(sorted(unsafe))}, which changes what a model means: remove it"
        )
    return flags


def python_include() -> tuple[str, ...]:
    """Flags to find Python.h, empty where it is not installed."""
    folders = dict.fromkeys(sysconfig.get_path(name) for name in ("include", "platinclude"))
    if not any((Path(folder) / "Python.h").is_file() for folder in folders):
        return ()
    return tuple(f"-I{folder}" for folder in folders)


def link_flags() -> tuple[str, ...]:
    """Flags that make a loadable module of objects whose Python symbols the interpreter provides."""
    if sys.platform == "darwin":
        return ("-bundle", "-undefined", "dynamic_lookup")
    return ("-shared", "-pthread", "-ldl", "-lm")


def cpu_features() -> str:
    """What `-march=native` depends on: the CPU's model and features, as the system names them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    wanted = ("model name", "flags", "Features", "CPU implementer", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


def host() -> dict[str, str]:
    """Names of the machine, the system, the C library, features of the CPU, and casadi, whose CVODES solves
    flows. Where these are equal, so are all results, to the last bit.
    """
    features = set(cpu_features().lower().split())
    return {
        "machine": platform.machine(),
        "system": platform.system(),
        "libc": " ".join(platform.libc_ver()).strip() or platform.release(),
        "cpu": " ".join(name for name in WIDER if name in features),
        "casadi": version_of("casadi"),
    }


def run(command: tuple[str, ...], directory: Path, variables: Mapping[str, str] | None = None) -> None:
    """Run a compiler there, without a shell, for `COMPILER_SECONDS` of its time at most where the system
    can limit that, and for `PATIENCE` times as long in any case. Its environment has these `variables` too.

    Raises `CompilerFailed` with the first useful lines of what it said.
    """
    run_all([command], directory, variables)


def run_all(
    commands: Iterable[tuple[str, ...]], directory: Path, variables: Mapping[str, str] | None = None
) -> None:
    """Run compilers like that at the same time; a failure, or Ctrl-C, ends all of them."""
    environment = {**os.environ, **(variables or {})}
    with ExitStack() as stack:
        begun = [stack.enter_context(_begun(command, directory, environment)) for command in commands]
        for end in begun:
            end()


@contextmanager
def _begun(
    command: tuple[str, ...], directory: Path, environment: Mapping[str, str]
) -> Generator[Callable[[], None]]:
    """Yields what waits for the end of it."""
    LOG.debug("%s", shlex.join(command))
    with (
        tempfile.TemporaryFile() as messages,
        _process(command, directory, environment, messages) as process,
    ):
        yield lambda: _end(command, process, messages)


@contextmanager
def _process(
    command: tuple[str, ...], directory: Path, environment: Mapping[str, str], messages: IO[bytes]
) -> Generator[subprocess.Popen[bytes]]:
    """What it starts itself may outlive it: no pipe is waited for."""
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            command, cwd=directory, env=environment, stdin=nothing, stdout=nothing, stderr=messages
        )
    except OSError as problem:
        raise CompilerFailed(f"cannot run {command[0]}: {problem.strerror}") from None
    try:
        if sys.platform == "linux":
            with suppress(OSError, ValueError):
                resource.prlimit(process.pid, resource.RLIMIT_CPU, (COMPILER_SECONDS, COMPILER_SECONDS))
        yield process
    finally:
        process.terminate()  # then a compiler removes its temporary files
        with suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)
        process.kill()
        process.wait()


def _end(command: tuple[str, ...], process: subprocess.Popen[bytes], messages: IO[bytes]) -> None:
    try:
        code = process.wait(PATIENCE * COMPILER_SECONDS)
    except subprocess.TimeoutExpired:
        raise CompilerFailed(
            f"{command[0]} did not end within {PATIENCE * COMPILER_SECONDS} seconds"
        ) from None
    if code != 0:
        messages.seek(0)
        said = first_errors(messages.read(MOST_SAID).decode(errors="replace"))
        said = said or f"exit code {code} without a message"
        if "CPU time limit" in said or code in (-signal.SIGKILL, -signal.SIGXCPU):
            said += f"\nit may take {COMPILER_SECONDS} seconds; the model is too large"
        raise CompilerFailed(f"{Path(command[0]).name} could not compile the generated code:\n{said}")


def first_errors(stderr: str) -> str:
    """The lines from the first error on, without what leads to it; all of them if none is marked."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    first = next((i for i, line in enumerate(lines) if "error" in line.lower()), 0)
    return "\n".join(lines[first : first + MAX_ERROR_LINES])


def _compiler(command: Sequence[str], program: str) -> Compiler:
    """A compiler, whose program is that file."""
    try:
        status = os.stat(program)
    except OSError as problem:
        raise CompilerMissing(f"cannot run {command[0]}: {problem.strerror}") from None
    version = _version(tuple(command), (status.st_ino, status.st_size, status.st_mtime_ns))
    zig = "ziglang" in command or Path(command[0]).name == "zig"
    return Compiler(tuple(command), version, zig)


@cache
def _version(command: tuple[str, ...], _: tuple[int, ...]) -> str:
    """What a command says of itself, asked once for a file as it is now."""
    try:
        result = subprocess.run(
            [*command, "--version"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
            timeout=VERSION_SECONDS,
        )
    except OSError as problem:
        raise CompilerMissing(f"cannot run {command[0]}: {problem.strerror}") from None
    except subprocess.TimeoutExpired:
        said = f"{command[0]} --version did not end within {VERSION_SECONDS} seconds"
        raise CompilerMissing(said) from None
    return result.stdout.strip()
