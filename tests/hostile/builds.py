"""Runs `dl2c build` on hostile models, each in a process of its own with limits, and judges how it ended."""

import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from hostile.enlarged import WAYS, enlarged
from hostile.monstrous import monstrous, way_of
from slowness import slowness

ROOT = Path(__file__).resolve().parent.parent.parent
EXAMPLES = ROOT / "examples"

VALID = 260
"""The first so many models are valid."""

TOTAL = 500

SECONDS = 20.0
"""Of processor time of dl2c itself; what the C compiler takes comes on top."""

MARGIN = 1.0
"""Seconds for starting Python and for giving memory back; more on a slow machine."""

MEGABYTES = 2048
ADDRESSES = MEGABYTES + 1024
"""Megabytes of address space: libraries and their threads reserve more than they use."""

PATIENCE = 120.0
"""Seconds after which a process is stopped, however little processor time it had."""

COMPILED = "compiled"

STARTED = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_AS, (%d * 2**20,) * 2)
resource.setrlimit(resource.RLIMIT_CPU, (%d,) * 2)
runpy.run_module("dl2c", run_name="__main__", alter_sys=True)
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a build ended: `outcome` is `compiled`, or the titles of what refuses it, or what went wrong."""

    code: int
    said: str
    seconds: float
    compiling: float
    megabytes: float
    litter: tuple[str, ...]

    @property
    def outcome(self) -> str:
        if self.code == 0:
            return COMPILED
        titles = dict.fromkeys(re.findall(r"(?m)^error: (.*?)(?:\s+\S+:\d+:\d+)?$", self.said))
        return "; ".join(re.sub(r"`[^`]*`|\d+", "_", title) for title in list(titles)[:3])[:150]

    @property
    def faults(self) -> list[str]:
        """What no model may bring about."""
        found: list[str] = []
        if self.code not in (0, 1):
            found.append(f"exit code {self.code}")
        if "Traceback" in self.said or "internal error" in self.said:
            found.append("a bug is told")
        if self.code == 1 and not re.search(r"(?m)^error: .*:\d+:\d+$", self.said):
            found.append("no place is told")
        if self.seconds > SECONDS + MARGIN and self.seconds > SECONDS + MARGIN * slowness():
            found.append(f"{self.seconds:.1f} s")
        if self.megabytes > MEGABYTES:
            found.append(f"{self.megabytes:.0f} MB")
        if self.litter:
            found.append(f"left {', '.join(self.litter)}")
        return found


def hostile_model(number: int, corpus: Path) -> bytes:
    """The text of a model: valid if its number is less than `VALID`."""
    if number < VALID:
        return enlarged(number, EXAMPLES, corpus).encode()
    return monstrous(number - VALID, EXAMPLES)


def kind(number: int) -> str:
    """What is done to model `number`, foremost."""
    return list(WAYS)[number % len(WAYS)] if number < VALID else way_of(number - VALID)


def built(path: Path, folder: Path, flags: str = "", tree: Path = ROOT) -> Ended:
    """Build a model into an empty folder, as the command of a source tree does, with a cache of its own."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "DL2C_CACHE_DIR": str(folder / "cache")}
    environment |= {"CFLAGS": flags} if flags else {}
    environment.pop("DL2C_STRICT", None)
    words = ["build", str(path), "-o", str(folder / "out"), "--default-bound", "-10:10"]
    command = [sys.executable, "-c", STARTED % (ADDRESSES, 3 * SECONDS), *words]
    pipe, null = subprocess.PIPE, subprocess.DEVNULL
    process = subprocess.Popen(
        command, stdout=null, stderr=pipe, env=environment, cwd=tree, start_new_session=True
    )
    watch = threading.Timer(PATIENCE, os.killpg, (process.pid, signal.SIGKILL))
    watch.start()
    assert process.stderr is not None
    with process.stderr as stream:
        said = stream.read().decode("utf-8", "replace")
    own = _own_seconds(process.pid)
    _, status, used = os.wait4(process.pid, 0)
    watch.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return Ended(
        process.returncode,
        said,
        own if own is not None else used.ru_utime + used.ru_stime,
        0.0 if own is None else used.ru_utime + used.ru_stime - own,
        used.ru_maxrss / 1024,
        _litter(folder, process.returncode == 0),
    )


def _own_seconds(pid: int) -> float | None:
    """Processor time of an ended process without its children, where the system tells."""
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except FileNotFoundError:
        return None
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _litter(folder: Path, compiled: bool) -> tuple[str, ...]:
    """What is half-written, or written by a build that failed."""
    left = [p for p in folder.rglob("*") if p.name.startswith(".dl2c-") or p.name.endswith(".tmp")]
    if not compiled:
        left += list((folder / "out").rglob("*")) + list((folder / "cache" / "builds").glob("?" * 32))
    return tuple(sorted(str(path.relative_to(folder)) for path in left))[:5]
