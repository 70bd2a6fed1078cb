"""Hostile models, proved: each is answered or refused within its time, and no bug is told.

The models are those of `hostile_models`: enlarged examples and public models, and monstrous ones.
`make test-hostile` asks about all of them, DL2C_HOSTILE=100:120 about some.
"""

import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import shared
from hostile.builds import ADDRESSES, ROOT, STARTED, TOTAL, hostile_model, kind
from slowness import slowness

TOTAL_SECONDS = 4.0
"""For each theorem."""

GRACE = 20.0
"""Seconds for starting Python, for reading the model, and for what is worked on when the time is over."""

PATIENCE = 120.0
"""Seconds after which a process is stopped."""

PROCESSOR = 60
"""Seconds of processor time."""

SHORT = (7, 103, 278, 340)
"""Of many ways, none that takes long."""

ANSWERS = {0: "proved", 1: "refuted", 3: "unknown"}


@dataclass(frozen=True, slots=True)
class Said:
    """How `dl2c verify` ended. `seconds` are of the clock, or of processor time where that is less, since
    other work delays it.
    """

    code: int
    out: str
    err: str
    seconds: float

    @property
    def answer(self) -> str:
        return "refused" if self.code == 1 and not self.out else ANSWERS.get(self.code, str(self.code))

    def faults(self, total: float) -> list[str]:
        """What no model may bring about."""
        found: list[str] = []
        if self.code not in ANSWERS:
            found.append(f"exit code {self.code}")
        if "Traceback" in self.err or "internal error" in self.err:
            found.append("a bug is told")
        if self.answer == "refused" and not re.search(r"(?m)^error: .*:\d+:\d+$", self.err):
            found.append("no place is told")
        if self.answer != "refused" and not re.search(r"(?m)^theorem: ", self.out):
            found.append("no answer is told")
        if self.seconds > total + GRACE and self.seconds > total + GRACE * slowness():
            found.append(f"{self.seconds:.1f} s")
        return found


def verified(path: Path, folder: Path, total: float) -> Said:
    """Prove a model in a process of its own, with limits of memory and time."""
    words = ["verify", str(path), "--total", str(total), "--timeout", str(total / 2)]
    own = {"PYTHONPATH": str(ROOT), "DL2C_CACHE_DIR": str(folder / "cache")}
    begun, used = time.monotonic(), processor_time()
    process = subprocess.Popen(
        [sys.executable, "-c", STARTED % (ADDRESSES, PROCESSOR), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | own,
        start_new_session=True,
        text=True,
    )
    watch = threading.Timer(PATIENCE, os.killpg, (process.pid, signal.SIGKILL))
    watch.start()
    out, err = process.communicate()
    watch.cancel()
    seconds = min(time.monotonic() - begun, processor_time() - used)
    return Said(process.returncode, out, err, seconds)


def processor_time() -> float:
    """Seconds of all processes that have ended and that were waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def check(chosen: Iterable[int], folder: Path, total: float = TOTAL_SECONDS) -> None:
    """No faults."""
    wrong, seen = list[str](), Counter[str]()
    for number in chosen:
        path = folder / f"m{number}.kyx"
        path.write_bytes(hostile_model(number, shared("corpus")))
        said = verified(path, folder, total)
        where = f"model {number} ({kind(number)})"
        wrong += [f"{where}: {fault}\n{said.err[-500:]}" for fault in said.faults(total)]
        seen[said.answer] += 1
    print(dict(seen), file=sys.stderr)
    assert not wrong, "\n\n".join(wrong)


def test_some_hostile_models_are_answered_in_time(tmp_path: Path) -> None:
    check(SHORT, tmp_path, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_all_hostile_models_are_answered_in_time(part: int, tmp_path: Path) -> None:
    first, _, last = os.environ.get("DL2C_HOSTILE", f"0:{TOTAL}").partition(":")
    check(range(int(first), int(last))[part::10], tmp_path)
