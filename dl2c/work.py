"""One budget of work for compiling a model: processor time and memory, from reading to writing C; and
whether there is memory for PyTorch.

Whatever may take long calls `spend` as it goes on. When the budget is used up, that raises `OutOfWork`,
which the way into the compiler turns into a diagnostic that names the stage and the place. Without a
budget, as in tests of a single stage, nothing is counted.
"""

import resource
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.source import NOWHERE, Span

SECONDS = 18.0
"""Of processor time of the thread that compiles."""

BYTES = 2 * 1024**3
"""By which the memory of the process may grow."""

TORCH = 512 * 1024**2
"""Bytes of address space that PyTorch takes while it is loaded, and its threads then."""

CALLS = 256
"""Of `spend` between two looks at the clock."""


class OutOfWork(Exception):
    """The budget is used up; says what of."""


@dataclass(slots=True)
class _Budget:
    seconds: float
    until: float
    most: int
    stage: str = "reading the model"
    span: Span = NOWHERE
    calls: int = 0
    stopped: Callable[[], bool] | None = None

    def look(self) -> None:
        self.calls = CALLS
        if self.stopped is not None and self.stopped():
            raise OutOfWork("it was no longer wanted")
        if time.thread_time() > self.until:
            raise OutOfWork(f"{self.seconds:g} seconds of processor time")
        if _memory() > self.most:
            raise OutOfWork(f"{BYTES // 1024**2} MB of memory")


_RUNNING: ContextVar[_Budget | None] = ContextVar("budget", default=None)


def spend() -> None:
    """Note that a piece of work is done. Raises `OutOfWork`."""
    budget = _RUNNING.get()
    if budget is None:
        return
    budget.calls -= 1
    if budget.calls < 0:
        budget.look()


def at_stage(stage: str) -> None:
    """Name what is done from here on."""
    if (budget := _RUNNING.get()) is not None:
        budget.stage = stage


def at_place(span: Span) -> None:
    """Where the model is that is compiled from here on."""
    if (budget := _RUNNING.get()) is not None:
        budget.span = span


@contextmanager
def budgeted(seconds: float | None = None, stopped: Callable[[], bool] | None = None) -> Generator[None]:
    """Work within the budget that is running, or a new one: `SECONDS` unless said.

    Raises `CompileError` where it is used up, where `stopped` says that nobody waits for the result, and
    where terms are so deep that Python gives up.
    """
    if _RUNNING.get() is not None:
        yield
        return
    seconds = SECONDS if seconds is None else seconds
    budget = _Budget(seconds, time.thread_time() + seconds, _memory() + BYTES, stopped=stopped)
    token = _RUNNING.set(budget)
    try:
        yield
    except OutOfWork as used:
        raise CompileError(_too_much(budget, str(used))) from None
    except RecursionError:
        raise CompileError(_too_deep(budget)) from None
    finally:
        _RUNNING.reset(token)


def _too_much(budget: _Budget, used: str) -> Diagnostic:
    label = f"given up while {budget.stage}, after {used}"
    advice = "leave out or divide what is largest: choices in a row, assumptions on many names, long terms"
    return error("too-much-work", "this model takes too much work to compile", budget.span, label, advice)


def _too_deep(budget: _Budget) -> Diagnostic:
    label = f"given up while {budget.stage}"
    advice = "every assignment that uses the one before nests its value: let a flow or the loop come between"
    return error(
        "too-deep", "terms of this model are nested too deeply to compile", budget.span, label, advice
    )


def require_memory_for_torch(size: int = TORCH) -> None:
    """Call it before PyTorch is imported, which ends the process itself where it finds too little memory.

    Raises `MemoryError` unless the process may have `size` more bytes of address space.
    """
    if "torch" in sys.modules:
        return
    import mmap

    try:
        mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=0).close()
    except OSError:
        raise MemoryError(f"PyTorch takes {size // 1024**2} MB") from None


def _memory() -> int:
    """The most that the process has held so far, in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
