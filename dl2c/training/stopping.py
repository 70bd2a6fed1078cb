"""Ctrl-C as a wish to stop soon, which leaves time to save."""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def stoppable() -> Generator[threading.Event]:
    """Yields what the first Ctrl-C sets; the second one is a KeyboardInterrupt as ever.

    Outside of the main thread, where Python handles no signals, nothing sets it, nor where Ctrl-C is ignored.
    """
    stopped = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (signal.SIG_IGN, None):
        yield stopped
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        stopped.set()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, stop)
    try:
        yield stopped
    finally:
        signal.signal(signal.SIGINT, before)
