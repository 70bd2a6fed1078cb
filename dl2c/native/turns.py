"""Calls of native code one at a time, and memory that is freed when the last of them is over."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from dl2c.native.errors import BatchBusy, BatchClosed


class Turns:
    """Turns to work on what `free` frees. `token` and `closing` are what cgen/python/stepping.c uses."""

    __slots__ = ("_free", "closing", "token")

    def __init__(self, free: Callable[[], None]) -> None:
        self._free = free
        self.token: list[Any] = [None, True]
        """Whoever has the turn takes the second entry, which Python does at once, and puts it back."""
        self.closing: list[bool] = []
        """Not empty where there is to be no other turn."""

    def take(self) -> None:
        """Begin. Raises `BatchBusy`, `BatchClosed`."""
        try:
            self.token.pop(1)
        except IndexError:
            self.refuse()

    def end(self) -> None:
        """Let others begin; the last turn before closing frees."""
        self.token.append(True)
        if self.closing:
            self.settle()

    def close(self) -> None:
        """Free now, or at the end of the turn that somebody has."""
        self.closing.append(True)
        self.settle()

    def settle(self) -> None:
        """Free unless somebody has the turn, or has done so. No turn comes after this."""
        with suppress(IndexError):
            self.token.pop(1)
            self._free()

    def refuse(self) -> NoReturn:
        """Raises why there is no turn."""
        self.check_open()
        raise BatchBusy("another call of the same environments is under way")

    def check_open(self) -> None:
        """Raises `BatchClosed`."""
        if self.closing:
            raise BatchClosed("the environments were closed")
