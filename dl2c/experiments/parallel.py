"""Work in processes of its own, such as trainings of many minutes. Ctrl-C and failures end all of it."""

import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from types import FrameType
from typing import Any, TypeVar

from dl2c.interruption import later

GRACE = 5.0
"""Seconds in which a process that is to end may clean up."""

Name = TypeVar("Name")
Found = TypeVar("Found")


def in_parallel(
    jobs: Mapping[Name, Callable[[], Found]], note: Callable[[int, int], None]
) -> dict[Name, Found]:
    """What all jobs give; those that come first begin first. `note` is told how many of how many are done.

    A job has to be one that a new process can import. Raises what a job raises, and `RuntimeError` where its
    process is lost.
    """
    waiting, found = list(jobs.items()), dict[Name, Found]()
    running: dict[Connection, tuple[Name, SpawnProcess]] = {}
    ensure_running()  # else the first process would start it, and that lets Ctrl-C through
    note(0, len(jobs))
    try:
        while waiting or running:
            while waiting and len(running) < (os.cpu_count() or 1):
                name, job = waiting.pop(0)
                with later():
                    pipe, process = _begun(job)
                    running[pipe] = name, process
            for pipe in [p for p in wait(list(running)) if isinstance(p, Connection)]:
                name, process = running[pipe]
                found[name] = _answer(pipe, process)
                del running[pipe]
                note(len(found), len(jobs))
    finally:
        _end([process for _, process in running.values()])
    return found


def _begun(job: Callable[[], Any]) -> tuple[Connection, SpawnProcess]:
    context = get_context("spawn")
    reading, writing = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(job, writing), daemon=True)
    process.start()
    writing.close()
    return reading, process


def _answer(pipe: Connection, process: SpawnProcess) -> Any:
    try:
        failed, answer = pipe.recv()
    except EOFError:
        process.join()
        raise RuntimeError(f"a process ended with exit code {process.exitcode}") from None
    process.join()
    if failed:
        raise answer
    return answer


def _end(processes: Iterable[SpawnProcess]) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(GRACE)
        process.kill()
        process.join()


def _work(job: Callable[[], Any], writing: Connection) -> None:
    """In the process of a job."""
    signal.signal(signal.SIGTERM, _leave)
    try:
        answer = False, job()
    except Exception as failure:
        failure.add_note(traceback.format_exc())
        answer = True, failure
    writing.send(answer)


def _leave(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(1)
