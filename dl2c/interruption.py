"""Ctrl-C at a moment when the command has nothing to clean up: one line, and the process ends.

That is so while the command imports its modules, some of which would tell a `KeyboardInterrupt` in their own
words, and when its work is done. A program that imports dl2c keeps its own way to be interrupted.
"""

import os
import signal
import sys
from itertools import pairwise
from types import FrameType

INTERRUPTED = 130
"""Exit code, what a shell says of Ctrl-C."""


def end_at_once() -> None:
    """From here on Ctrl-C ends the process, unless it is ignored or handled in some other way."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_again() -> None:
    """From here on Ctrl-C is a `KeyboardInterrupt` again."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def is_command() -> bool:
    """Whether this process was started as `dl2c` or as `python -m dl2c`, and is no child of one."""
    words = sys.orig_argv[1:]
    if sys.argv[:1] == ["-m"]:
        return ("-m", "dl2c") in pairwise(words) or "-mdl2c" in words
    return bool(sys.argv) and os.path.basename(sys.argv[0]) == "dl2c" and sys.argv[0] in words


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
