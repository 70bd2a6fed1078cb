"""A table of the public models: `make corpus-table`, which writes build/corpus.tsv.

One row for every entry of every file of the shared corpus: what became of it, in how many
seconds of processor time. An entry is `built` once its C is written; none is compiled here. Else
its outcome is the codes of the diagnostics that refuse it. Names without a bound get -10:10. No
entry that is built may need more than a third of the budget of work. Seconds above one are divided
by how much slower this processor is, just then, at a fixed piece of work; an entry that seems to need
too many is compiled again, twice, and the least of its times counts.
"""

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from slowness import slowness

from dl2c.diagnostics import CompileError
from dl2c.emit.simulator.model_c import model_sources
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.parse.tree import Entry
from dl2c.pipeline import Compilation
from dl2c.source import Source
from dl2c.work import SECONDS

REPOSITORY = Path(__file__).resolve().parent.parent
CORPUS = REPOSITORY.parent / "shared" / "corpus"
EXPECTED = REPOSITORY / "tests" / "golden" / "corpus.json"
SUFFIXES = (".kyx", ".key", ".kya")

OPTIONS = Options(default_bound=(Fraction(-10), Fraction(10)))
BUILT = "built"

MOST_SECONDS = SECONDS / 3
"""For an entry that is built: others have room to grow."""


@dataclass(frozen=True, slots=True)
class Row:
    """What became of an entry; of a whole file, `number` 0, where it cannot be read."""

    file: str
    number: int
    name: str
    outcome: str
    seconds: float

    def __str__(self) -> str:
        return f"{self.file}\t{self.number}\t{self.name}\t{self.outcome}\t{self.seconds:.2f}"


def files(corpus: Path = CORPUS) -> list[Path]:
    """All model files of the corpus, in the order of their names."""
    return sorted(path for path in corpus.rglob("*") if path.suffix in SUFFIXES)


def table(corpus: Path = CORPUS) -> Iterator[Row]:
    """All rows, in order, by as many processes as there are processors."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for rows in pool.map(rows_of, files(corpus)):
            yield from rows


def rows_of(path: Path) -> list[Row]:
    """The rows of one file."""
    name = str(path.relative_to(CORPUS))
    begun = time.thread_time()
    try:
        archive, _ = parse_archive(Source.read(path))
    except CompileError as problem:
        return [Row(name, 0, "", codes(problem), time.thread_time() - begun)]
    return [_row(name, number, entry) for number, entry in enumerate(archive.entries, 1)]


def _row(file: str, number: int, entry: Entry) -> Row:
    begun = time.thread_time()
    try:
        model_sources(Compilation(entry, OPTIONS).planned.build)
        outcome = BUILT
    except CompileError as problem:
        outcome = codes(problem)
    seconds = time.thread_time() - begun
    return Row(file, number, entry.name, outcome, seconds / slowness() if seconds > 1 else seconds)


def codes(problem: CompileError) -> str:
    """Why an entry is refused."""
    return "+".join(sorted({d.code for d in problem.diagnostics}))


def outcomes(rows: Iterable[Row]) -> dict[str, int]:
    """How many entries came to each outcome, the most frequent first."""
    counts = Counter(row.outcome for row in rows)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def expected() -> dict[str, int]:
    """The outcomes that the tests ask for."""
    return json.loads(EXPECTED.read_text(encoding="utf-8"))


def least(row: Row, more: int = 2) -> Row:
    """The row with the least time of its entry, compiled `more` times again by a process of its own."""
    for _ in range(more):
        with ProcessPoolExecutor(1) as pool:
            again = pool.submit(rows_of, CORPUS / row.file).result()[row.number - 1]
        row = min(row, again, key=lambda row: row.seconds)
    return row


def main(target: Path) -> int:
    """Write and print the table; 1 where the outcomes are not the expected ones, or take too long."""
    begun = time.perf_counter()
    rows: list[Row] = []
    with target.open("w", encoding="utf-8") as out:
        for row in table():
            rows.append(row)
            print(row, file=out, flush=True)
    counts = outcomes(rows)
    for outcome, count in counts.items():
        print(f"{count:5}  {outcome}")
    print(f"{len(rows):5}  entries in {time.perf_counter() - begun:.0f} s; all of them: {target}")
    built = [row for row in rows if row.outcome == BUILT]
    built = [least(row) if row.seconds > MOST_SECONDS else row for row in built]
    slowest = max(built, key=lambda row: row.seconds)
    print(f"most time: {slowest}")
    faults = []
    if counts != expected():
        faults.append(f"not what {EXPECTED.relative_to(REPOSITORY)} says")
    if slowest.seconds > MOST_SECONDS:
        faults.append(f"an entry needs more than {MOST_SECONDS:g} seconds of processor time")
    print(*faults, sep="\n", end="\n" if faults else "", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    if not CORPUS.exists():
        sys.exit(f"no public models at {CORPUS}")
    sys.exit(main(REPOSITORY / "build" / "corpus.tsv"))
