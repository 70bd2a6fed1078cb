"""The process that checks what takes longer: `python -m dl2c.lsp.worker`, started by `checker`.

Each line on stdin is a task in JSON: a text, its name, the numbers of the entries to check, a folder for
`[tool.dl2c]`, and how long to wait before solvers are asked. A child of its own works on it, so that a crash
or a solver that does not listen ends nothing else. What it finds comes as lines of JSON on stdout, and then
`{"done": true}`. A line that comes while a child works stops it, also an empty one.
"""

import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dl2c.configuration import configured
from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.interval.bounded import initial_box
from dl2c.lint.check import examined
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.parse.tree import Entry
from dl2c.pipeline import Compilation
from dl2c.source import Source

BYTES = 3 * 1024**3
"""Memory of a child."""

NICENESS = 5
"""A check must not slow down the answers to questions."""

Report = Mapping[str, Any]


def main() -> None:
    """Do tasks until stdin is closed, or nobody reads what is found."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = os.dup(1)
    os.dup2(2, 1)  # what libraries print is not a report
    with suppress(BrokenPipeError):
        _serve(out)
    os._exit(0)


def _serve(out: int) -> None:
    waiting = b""
    while data := os.read(0, 1 << 20):
        waiting = _done(waiting + data, out)


def _done(waiting: bytes, out: int) -> bytes:
    """Do the last of the tasks that are there, until no whole line is left; the rest is returned."""
    while b"\n" in waiting:
        lines, _, rest = waiting.rpartition(b"\n")
        line = lines.rpartition(b"\n")[2]
        waiting = _do(line, rest, out) if line.strip() else rest
    return waiting


def _do(line: bytes, waiting: bytes, out: int) -> bytes:
    """Have a child do a task until it has ended, or something else comes, which is returned."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _work(json.loads(line), writing)
    os.close(writing)
    found = b""
    while not waiting:
        ready, _, _ = select.select([0, reading], [], [])
        if 0 in ready:
            waiting = os.read(0, 1 << 20)
            if not waiting:
                break
        elif data := os.read(reading, 1 << 16):
            *lines, found = (found + data).split(b"\n")
            for report in lines:
                _write(out, report + b"\n")
        else:
            break
    os.close(reading)
    with suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if not waiting and not (os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0):
        task = json.loads(line)["task"]
        _write(out, json.dumps({"task": task, "failure": "the check ended unexpectedly"}).encode() + b"\n")
    return waiting


def _write(out: int, data: bytes) -> None:
    while data:
        data = data[os.write(out, data) :]


def _work(task: Mapping[str, Any], writing: int) -> None:
    """In the child, which ends here."""
    try:
        os.nice(NICENESS)
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        most = BYTES if most == resource.RLIM_INFINITY else min(BYTES, most)
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
        for report in reports(task):
            _write(writing, json.dumps({"task": task["task"], **report}).encode() + b"\n")
    except BaseException as failure:  # the child has nobody else to tell
        text = f"{type(failure).__name__}: {failure}"[:500]
        details = traceback.format_exc()
        _write(
            writing, json.dumps({"task": task["task"], "failure": text, "details": details}).encode() + b"\n"
        )
    os._exit(0)


def reports(task: Mapping[str, Any]) -> Iterator[Report]:
    """Of each entry what can be said without solvers, then of each everything."""
    source = Source(task["name"], task["text"])
    try:
        options = configured(Options(), Path(task["folder"]))
    except CompileError:  # which the analysis has told
        options = Options()
    entries = parse_archive(source)[0].entries
    numbers: list[int] = task["entries"]
    models = {number: Compilation(entries[number], options) for number in numbers}
    for number, model in models.items():
        found = _own(examined(source, model, solving=False), entries, number)
        yield _report(number, found, all=False) | {"limits": _limits(model)}
    yield {"quick": True}
    time.sleep(task["pause"])
    for number, model in models.items():
        yield _report(number, _own(examined(source, model), entries, number), all=True)
    yield {"done": True}


def _own(found: Sequence[Diagnostic], entries: Sequence[Entry], number: int) -> list[Diagnostic]:
    """What concerns an entry, or the text before all entries."""
    span, first = entries[number].span, entries[0].span.start
    return [d for d in found if d.span.start < first or span.start <= d.span.start <= span.end]


def _report(number: int, found: Sequence[Diagnostic], *, all: bool) -> dict[str, Any]:
    return {"entry": number, "all": all, "found": [_as_data(d) for d in found]}


def _as_data(d: Diagnostic) -> Mapping[str, Any]:
    place = [d.span.start, d.span.end]
    return {
        "severity": d.severity,
        "code": d.code,
        "title": d.title,
        "place": place,
        "label": d.label,
        "help": d.help,
        "notes": list(d.notes),
    }


def _limits(model: Compilation) -> Mapping[str, tuple[float, float]]:
    """Between which finite numbers, or infinities as large ones, names are at first."""
    try:
        box = initial_box(model.lowered.model)
    except CompileError:
        return {}
    return {symbol.name: (i.low, i.high) for symbol, i in (box or {}).items() if not i.empty}


if __name__ == "__main__":
    sys.exit(main())
