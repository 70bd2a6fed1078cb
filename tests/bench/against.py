"""This tree's speed as a multiple of another revision's: both do the same in turn, again and again.

    python tests/bench/against.py REV [--start] [--examples waypoint,acc] [--require ROW=RATIO] ...

Without --start, all rows of `dl2c bench` on every example; with it, whole commands, of which processor time
counts, also those of all examples together. A ratio above 1 means that this tree is faster; its interval
holds 95 % of Student's t. Exit 1 if the upper end of an interval is below what is required of its row, or the
geometric mean of all other rows is less than `OVERALL`. A row is `batch1024`, or `waypoint/batch1024` of one
example. Where nothing is said, what limits.py has of the revision is required. Needs git.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tarfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory

from bench import limits
from bench.intervals import ratio_interval
from bench.limits import is_start
from bench.processes import in_turn, kept, seconds_of_commands

ROOT = Path(__file__).resolve().parents[2]
WORKER = Path(__file__).with_name("worker.py")

ROUNDS = 9
OVERALL = 0.98
"""The least geometric mean of the rows of which nothing else is required."""

OVERHEADS = {"vector1024-batch1024": "vector1024", "shared1024-batch1024": "shared1024"}
"""What a vector environment adds to a call of its batch, by the row from which that is taken."""

Rates = dict[str, list[float]]


@dataclass(frozen=True, slots=True)
class Ratio:
    """How many times faster a row is here, with the ends of its interval, and what is required."""

    row: str
    mean: float
    low: float
    high: float
    required: float | None

    @property
    def met(self) -> bool:
        return self.required is None or self.high >= self.required


def ratio_of(row: str, here: Sequence[float], there: Sequence[float], required: float | None) -> Ratio:
    """Of rates in rounds that belong together: the geometric mean and its interval."""
    found = ratio_interval(here, there)
    return Ratio(row, found.mean, found.low, found.high, required)


def required_of(row: str, required: Mapping[str, float]) -> float | None:
    """What is required of a row, by its whole name or by that without the example."""
    return required.get(row, required.get(row.partition("/")[2]))


@contextmanager
def checked_out(revision: str) -> Generator[Path]:
    """A revision's files in a folder of their own. Raises `CalledProcessError` for one that git lacks."""
    packed = subprocess.run(["git", "archive", revision], cwd=ROOT, capture_output=True, check=True).stdout
    with TemporaryDirectory(prefix="dl2c-against-") as folder:
        with tarfile.open(fileobj=BytesIO(packed)) as archive:
            archive.extractall(folder, filter="data")
        yield Path(folder)


@contextmanager
def worker(tree: Path, example: str) -> Generator["Worker"]:
    """A process that measures an example as it is in a tree."""
    process = subprocess.Popen(
        [sys.executable, str(WORKER), str(tree / "examples" / f"{example}.kyx")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment(tree),
        cwd=tree,
        text=True,
    )
    try:
        yield Worker(process)
    finally:
        process.terminate()
        process.wait()


def environment(tree: Path) -> dict[str, str]:
    """Variables under which a tree's code runs, with a cache of its own. Its bytecode is kept, as that of
    installed packages is.
    """
    given = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    places = {"DL2C_CACHE_DIR": kept(tree) / "cache", "PYTHONPYCACHEPREFIX": kept(tree) / "bytecode"}
    return {**given, "PYTHONPATH": str(tree), **{name: str(place) for name, place in places.items()}}


class Worker:
    """Rates of the rows of one example in one tree."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self.rows: list[str] = json.loads(self._line())

    def rate(self, row: str) -> float:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{row}\n")
        self._process.stdin.flush()
        return float(self._line())

    def _line(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise SystemExit("a process that measures has ended; its message is above")
        return line


def rates_of(example: str, trees: Sequence[Path]) -> list[Rates]:
    """Of every row that all trees have, in rounds in which they take turns to be first."""
    with ExitStack() as running:
        workers = [running.enter_context(worker(tree, example)) for tree in trees]
        shared = [row for row in workers[0].rows if all(row in w.rows for w in workers)]
        rates: list[Rates] = [{row: [] for row in shared} for _ in trees]
        for turn in range(ROUNDS):
            for row in shared:
                for k in in_turn(len(trees), turn):
                    rates[k][row].append(workers[k].rate(row))
    return [found | _overheads(found) for found in rates]


def _overheads(rates: Rates) -> Rates:
    """By row: calls per second of what is left when the batch is taken away."""
    found: Rates = {}
    for row, whole in OVERHEADS.items():
        if whole in rates:
            seconds = [1024 / a - 1024 / b for a, b in zip(rates[whole], rates["batch1024"], strict=True)]
            if min(seconds) > 0.0:
                found[row] = [1.0 / s for s in seconds]
    return found


def environments(trees: Sequence[Path], examples: Sequence[str]) -> Iterator[tuple[str, Rates, Rates]]:
    """By example: rates of this tree, and of the other."""
    for example in examples:
        here, there = rates_of(example, trees)
        yield example, here, {row: there[row] for row in here if row in there}


def with_all(
    measured: Iterator[tuple[str, Rates, Rates]],
) -> Generator[tuple[str, Rates, Rates], None, None]:
    """The rates of every example, then those of doing the same with all of them, one after another."""
    seconds: tuple[Rates, Rates] = ({}, {})
    examples = 0
    for name, *found in measured:
        yield name, found[0], found[1]
        examples += 1
        for sums, rates in zip(seconds, found, strict=True):
            for row, values in rates.items():
                before = sums.get(row, [0.0] * len(values))
                sums[row] = [s + 1.0 / v for s, v in zip(before, values, strict=True)]
    if examples > 1:
        here, there = ({row: [1.0 / s for s in sums[row]] for row in sums} for sums in seconds)
        yield "all", here, there


def ratios(
    measured: Iterator[tuple[str, Rates, Rates]], required: Mapping[str, float]
) -> Generator[Ratio, None, None]:
    """The ratio of every row that both have."""
    for name, here, there in measured:
        for row in there:
            whole = f"{name}/{row}"
            yield ratio_of(whole, here[row], there[row], required_of(whole, required))


def missing(required: Mapping[str, float], found: Sequence[Ratio], examples: Sequence[str]) -> list[str]:
    """What is required of these examples and was not measured, as where noise hides an overhead."""
    rows = {ratio.row for ratio in found}
    named = {name: name.partition("/") for name in required}
    asked = [name for name, (example, _, row) in named.items() if example in examples and row]
    return [name for name in asked if name not in rows]


def told(ratio: Ratio) -> str:
    """One line of the table."""
    verdict = "" if ratio.required is None else f"  {'pass' if ratio.met else 'FAIL'}: {ratio.required:g}"
    return f"{ratio.row:42}{ratio.mean:8.3f}  [{ratio.low:.3f}, {ratio.high:.3f}]{verdict}"


def requirement(text: str) -> tuple[str, float]:
    row, _, least = text.rpartition("=")
    return row, float(least)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("revision")
    parser.add_argument("--start", action="store_true", help="Measure commands instead of environments.")
    parser.add_argument("--examples", default=",".join(sorted(p.stem for p in ROOT.glob("examples/*.kyx"))))
    parser.add_argument("--require", type=requirement, action="append", default=[], metavar="ROW=RATIO")
    asked = parser.parse_args()
    examples: list[str] = asked.examples.split(",")
    required = dict(asked.require)
    if not required and is_start(asked.revision):
        required = dict(limits.COMMANDS if asked.start else limits.ENVIRONMENTS)
    found: list[Ratio] = []
    with checked_out(asked.revision) as other:
        trees = [ROOT, other]
        known = [name for name in examples if (other / "examples" / f"{name}.kyx").exists()]
        if asked.start:
            measured = with_all(seconds_of_commands(trees, known, environment, ROUNDS))
        else:
            measured = environments(trees, known)
        print(f"{'row':42}{'times':>8}  95 % interval")
        for ratio in ratios(measured, required):
            found.append(ratio)
            print(told(ratio), flush=True)
    absent = missing(required, found, known)
    for name in absent:
        print(f"{name:42}  FAIL: not measured")
    others = [math.log(r.mean) for r in found if r.required is None]
    overall = math.exp(fmean(others)) if others else 1.0
    print(f"geometric mean of the {len(others)} rows without a requirement: {overall:.3f}")
    return 0 if all(r.met for r in found) and not absent and overall >= OVERALL else 1


if __name__ == "__main__":
    sys.exit(main())
