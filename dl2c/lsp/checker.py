"""Checks that take longer, by `worker` in a process of its own."""

import asyncio
import json
import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from dl2c.diagnostics import Diagnostic
from dl2c.progress import LOG
from dl2c.source import Source, Span

Report = Mapping[str, Any]

LONGEST_LINE = 1 << 26
MOST_STARTS = 5
"""A process that ends so often is not started again."""


@dataclass(frozen=True, slots=True)
class _Task:
    """What is to be checked for someone, and who is told what is found."""

    asker: object
    content: Mapping[str, Any]
    told: Callable[[Report], None]


class Checker:
    """Gives tasks to the worker, one at a time, the last one first, and one of each asker."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._reader: asyncio.Task[None] | None = None
        self._starts = 0
        self._starting = asyncio.Lock()
        self._number = 0
        self._present: _Task | None = None
        self._waiting: list[_Task] = []

    async def start(self) -> None:
        """Start the process, unless it runs: importing solvers takes a second. Raises `OSError`."""
        async with self._starting:
            if (
                self._process is not None and self._process.returncode is None
            ) or self._starts >= MOST_STARTS:
                return
            self._starts += 1
            path = os.pathsep.join(p for p in sys.path if p)
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "dl2c.lsp.worker"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env={**os.environ, "PYTHONPATH": path},
                limit=LONGEST_LINE,
            )
            self._reader = asyncio.ensure_future(self._read(self._process))

    async def check(self, asker: object, content: Mapping[str, Any], told: Callable[[Report], None]) -> None:
        """Begin a task, before all others. Raises `OSError`."""
        self._drop(asker)
        if self._present is not None:
            self._waiting.append(self._present)
        self._present = _Task(asker, content, told)
        await self.start()
        if self._process is None or self._process.returncode is not None:
            told({"failure": "no checks that need more time: their process ends again and again"})
        self._send()

    def forget(self, asker: object) -> None:
        """Nobody wants the reports for this asker any more: the worker turns to something else."""
        if self._drop(asker):
            self._send()

    def _drop(self, asker: object) -> bool:
        """Whether the present task was one of the asker."""
        self._waiting = [task for task in self._waiting if task.asker is not asker]
        if self._present is None or self._present.asker is not asker:
            return False
        self._present = self._waiting.pop() if self._waiting else None
        return True

    def _send(self) -> None:
        """Have the worker do the present task, or nothing if there is none, instead of the last one."""
        self._number += 1
        if self._process is not None and self._process.stdin is not None:
            task = self._present
            line = b"" if task is None else json.dumps({**task.content, "task": self._number}).encode()
            with suppress(ConnectionError):
                self._process.stdin.write(line + b"\n")

    async def stop(self) -> None:
        """End the process."""
        self._present, self._waiting = None, []
        if self._process is not None and self._process.returncode is None:
            with suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            report = json.loads(line)
            if report.get("details"):
                LOG.error("%s", report["details"])
            if report["task"] == self._number and self._present is not None:
                self._present.told(report)
                if "done" in report or "failure" in report:
                    self._present = self._waiting.pop() if self._waiting else None
                    self._send()
        if self._present is not None:
            self._present.told({"failure": "the process that checks has ended"})
            self._present = None


def found_in(report: Report, source: Source) -> tuple[Diagnostic, ...]:
    """The diagnostics of a report on an entry of this source."""
    return tuple(
        Diagnostic(
            d["severity"],
            d["code"],
            d["title"],
            Span(source, *d["place"]),
            d["label"],
            d["help"],
            tuple(d["notes"]),
        )
        for d in report["found"]
    )
