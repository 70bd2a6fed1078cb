"""Stand-alone C programs: compiled, and run on lines of text."""

import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path

from dl2c.native.errors import CompilerFailed
from dl2c.native.toolchain import EXACT_FLAGS, find_compiler, run, user_flags, warning_flags

PROGRAM_FLAGS = ("-std=c99", "-O2")


def compile_program(files: Mapping[str, str], directory: Path, flags: tuple[str, ...] = ()) -> Path:
    """Write `files` into a folder and make one program of those that are C. Raises `CompilerMissing`,
    `CompilerFailed`.
    """
    for name, text in files.items():
        (directory / name).write_text(text, encoding="utf-8")
    sources = sorted(name for name in files if name.endswith(".c"))
    command = (*find_compiler().command, *PROGRAM_FLAGS, *warning_flags(), *user_flags(), *flags)
    run((*command, *EXACT_FLAGS, *sources, "-o", "program", "-lm"), directory)
    return directory / "program"


def answers(program: Path, lines: Iterable[str]) -> list[str]:
    """What a program prints for the lines it is given. Raises `CompilerFailed` if it fails."""
    result = subprocess.run([program], input="\n".join(lines), capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise CompilerFailed(f"{program.name} ended with exit code {result.returncode}")
    return result.stdout.splitlines()
