"""Everything that is read from files: regular files, of a limited size, whose faults are the reader's error.

A reader of a format opens its file here and decodes it inside of `checked_input`, which turns
whatever malformed content raises into the one error that the reader documents.
"""

import json
import os
import stat
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

MALFORMED = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    MemoryError,
    NotImplementedError,
    EOFError,
)
"""What decoding malformed data may raise."""

LONGEST_REASON = 200


def open_input(path: str | Path) -> BinaryIO:
    """A regular file to read bytes from; a pipe or a device might never end. Raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(21, "Is a directory", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(22, "Not a regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_input(path: str | Path, most: int) -> bytes:
    """The content of a regular file of at most so many bytes. Raises `OSError`."""
    with open_input(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(27, f"Larger than {most} bytes", str(path))
    return content


def read_text(path: str | Path, most: int) -> str:
    """The same as UTF-8 text, without a byte order mark. Raises `OSError`, `ValueError`."""
    return read_input(path, most).decode("utf-8-sig")


def read_json(path: str | Path, most: int) -> Any:
    """The value in a file of JSON. Raises `OSError` and what is `MALFORMED`."""
    return json.loads(read_text(path, most))


@contextmanager
def checked_input(error: Callable[[str], Exception], fault: str) -> Generator[None]:
    """What is wrong with the content of a file, as the error of its reader, which begins with `fault`."""
    try:
        yield
    except MALFORMED as problem:
        raise error(f"{fault}: {reason(problem)}") from None


def reason(problem: Exception) -> str:
    """Why data is malformed, in a line."""
    match problem:
        case UnicodeDecodeError():
            text = f"no UTF-8 text: {problem.reason} at byte {problem.start}"
        case KeyError():
            text = f"it lacks {problem}"
        case RecursionError():
            text = "nested too deeply"
        case MemoryError():
            text = "more than fits into memory"
        case _:
            text = str(problem).strip().partition("\n")[0] or type(problem).__name__
    return text if len(text) <= LONGEST_REASON else f"{text[:LONGEST_REASON]} ..."
