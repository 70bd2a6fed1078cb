"""Ctrl-C at a moment when the command has nothing to clean up: one line, and the process ends.

That is so while the command imports its modules, some of which would tell a `KeyboardInterrupt` in their own
words, and when its work is done. A program that imports dl2c keeps its own way to be interrupted.
"""

import os
import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from types import FrameType

INTERRUPTED = 130
"""Exit code, what a shell says of Ctrl-C."""


_asked = False


def end_at_once() -> None:
    """From here on Ctrl-C ends the process, unless it is ignored or handled in some other way."""
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _raise):
        signal.signal(signal.SIGINT, _end)


def raise_again() -> None:
    """From here on Ctrl-C is a `KeyboardInterrupt` again, also where Python would drop it."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, _raise)
        sys.unraisablehook = _again


@contextmanager
def later() -> Generator[None]:
    """Ctrl-C waits for the end of the block, and never comes to the processes that begin in it."""
    asked = False

    def note(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True

    before = signal.getsignal(signal.SIGINT)
    heeded = callable(before) and threading.current_thread() is threading.main_thread()
    if heeded:
        signal.signal(signal.SIGINT, note)
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if heeded:
            signal.signal(signal.SIGINT, before)
        if asked:
            signal.raise_signal(signal.SIGINT)


def was_asked() -> bool:
    """Whether Ctrl-C was a `KeyboardInterrupt` of this process, whatever a library made of that."""
    return _asked


@cache
def is_command() -> bool:
    """Whether this process was started as `dl2c` or as `python -m dl2c`, and is not a child of one. That is
    found when dl2c is imported, and kept: later `sys.argv` no longer says `-m`.
    """
    words = sys.orig_argv[1:]
    if sys.argv[:1] == ["-m"]:
        return ("-m", "dl2c") in pairwise(words) or "-mdl2c" in words
    return bool(sys.argv) and os.path.basename(sys.argv[0]) == "dl2c" and sys.argv[0] in words


def _raise(number: int, frame: FrameType | None) -> None:
    global _asked  # noqa: PLW0603 # a signal is the state of a process
    _asked = True
    raise KeyboardInterrupt


def _again(dropped: "sys.UnraisableHookArgs") -> None:
    """A `KeyboardInterrupt` in a `__del__`, which can raise nothing, comes again a moment later. Objects that
    it left half made may fail then: that is not worth a word.
    """
    if issubclass(dropped.exc_type, KeyboardInterrupt):
        import _thread

        threading.Timer(0.01, _thread.interrupt_main).start()
    elif not _asked:
        sys.__unraisablehook__(dropped)


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
