"""How many of the public models run: the last part of `make corpus`, written to build/corpus-runs.tsv.

Of the problems of the shared corpus that have a program and no holes, each once, however often it is
published: which begin and take 200 random masked steps from each of 5 seeds, with `mask_depth=step`
and -10:10 where the file bounds nothing; how many of the steps block, and how episodes end. Where the
file has a proof, the postcondition and invariants are evaluated exactly after the first of these steps.
"""

import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from random import Random

import numpy as np
from corpus_table import CORPUS, OPTIONS, REPOSITORY, codes, files
from generators.flow_library import REASONS, library_of
from proved_states import Promise, promise_of, told

from dl2c.diagnostics import CompileError
from dl2c.native.binding import Batch
from dl2c.native.errors import ResetFailed
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_formula
from dl2c.pipeline import Compilation
from dl2c.resolve.problem import expansion
from dl2c.resolve.symbols import Node, is_hole, nodes
from dl2c.source import Source

STEPS, SEEDS = 200, 5
MOST_BLOCKED = 0.2
LEAST_RUN = 0.85
PROMISED = 50
"""Steps after which what is proved is evaluated."""

PROOF, UNFINISHED = "Tactic", "partial"
BEYOND = ("numerical", "solver")
"""Episodes that end so end in no state of the model."""

SECONDS = 300.0
"""For one model, compiling included."""
RUNS = "runs"
ACTIONS: Options = replace(OPTIONS, mask_depth="step")


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a problem: `runs` or why not; the part of its steps that blocked, how episodes ended,
    and by how much states missed what is proved of them."""

    file: str
    number: int
    name: str
    outcome: str
    blocked: float = 0.0
    ends: str = ""
    promise: str = ""

    def __str__(self) -> str:
        told = (self.outcome, f"{self.blocked:.3f}", self.ends, self.promise)
        return "\t".join((self.file, str(self.number), self.name, *told))


def problems() -> Iterator[tuple[str, int, tree.Entry]]:
    """Every problem once: with a program, without holes, with its file and number."""
    seen: set[str] = set()
    for path in files():
        try:
            archive, _ = parse_archive(Source.read(path))
        except CompileError:
            continue
        for number, entry in enumerate(archive.entries, 1):
            try:
                text = print_formula(expansion(entry))
            except CompileError:
                text = print_formula(entry.problem)
            if text not in seen and _is_program(entry):
                seen.add(text)
                yield str(path.relative_to(CORPUS)), number, entry


def _nodes(entry: tree.Entry) -> list[Node]:
    """Of the problem and its definitions."""
    bodies = [entry.problem, *(d.body for d in entry.definitions if d.body is not None)]
    return [node for body in bodies for node in nodes(body)]


def _is_program(entry: tree.Entry) -> bool:
    """Whether there is something to run, and nothing to be filled in."""
    found = _nodes(entry)
    modal = any(isinstance(n, (tree.Box, tree.Diamond)) for n in found)
    return modal and not any(is_hole(n) for n in found)


def _is_proved(entry: tree.Entry) -> bool:
    """Whether the file has a proof, and no other player who might not let the invariant hold."""
    if PROOF not in entry.span.text or UNFINISHED in entry.span.text:
        return False
    return not any(isinstance(n, tree.Dual) for n in _nodes(entry))


def row_of(file: str, number: int, entry: tree.Entry) -> Row:
    """What becomes of a problem, in a process of its own: none may take the others with it."""
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=lambda: there.send(_row(file, number, entry)), daemon=True
    )
    process.start()
    there.close()
    try:
        return here.recv() if here.poll(SECONDS) else Row(file, number, entry.name, "timeout")
    except EOFError:
        return Row(file, number, entry.name, "crash")
    finally:
        process.kill()
        process.join()


def _row(file: str, number: int, entry: tree.Entry) -> Row:
    try:
        found = Compilation(entry, ACTIONS)
        environment = found.planned.build
    except CompileError as problem:
        return Row(file, number, entry.name, codes(problem))
    with tempfile.TemporaryDirectory() as folder:
        batch = library_of(environment, Path(folder)).batch(SEEDS)
        predicates = [p.name for p in environment.model.predicates]
        promise = promise_of(found) if _is_proved(entry) else None
        try:
            batch.reset(seeds=np.arange(SEEDS, dtype=np.uint64))
            played = _played(batch, Random(number), predicates, promise)
        except ResetFailed:
            return Row(file, number, entry.name, "no-reset")
    ends = " ".join(f"{reason}:{count}" for reason, count in played.ends.most_common())
    return Row(file, number, entry.name, RUNS, played.blocked, ends, told(played.misses))


@dataclass(slots=True)
class Played:
    """The part of random masked steps that block, how often episodes end for which reason, and by how much
    the first states miss what is proved of them."""

    blocked: float
    ends: Counter[str]
    misses: list[Fraction]


def _played(batch: Batch, rng: Random, predicates: list[str], promise: Promise | None) -> Played:
    blocked, ends, misses = 0, Counter[str](), list[Fraction]()
    for step in range(STEPS):
        for i in range(SEEDS):
            start = 0
            for column, choice in enumerate(batch.library.manifest.choices):
                end = start + len(choice.alternatives)
                batch.choices[i, column] = rng.choice(np.flatnonzero(batch.mask[i, start:end]).tolist())
                start = end
            given = [rng.uniform(s.low, s.high) for s in batch.library.manifest.inputs]
            batch.inputs[i, :] = given
        batch.step()
        over = batch.terminated | batch.truncated
        blocked += int(batch.blocked.sum())
        for i, reason in enumerate(batch.reason.tolist()):
            name = predicates[reason - 16] if reason >= 16 else REASONS[reason]
            if over[i]:
                ends[name] += 1
            if promise is not None and step < PROMISED and name not in BEYOND and not batch.blocked[i]:
                misses.append(promise.missed(*(part.tolist() for part in batch.get_state(i))))
        if over.any():
            batch.reset(mask=over.astype(bool))
    return Played(blocked / (STEPS * SEEDS), ends, misses)


def report(rows: list[Row]) -> bool:
    """Print what became of all; whether it is enough."""
    running = [r for r in rows if r.outcome == RUNS]
    for outcome, count in Counter(r.outcome for r in rows).most_common():
        print(f"{count:5}  {outcome}")
    for row in running:
        if any(f"{reason}:" in row.ends for reason in BEYOND):
            print(f"ends: {row}")
        if row.promise not in ("", "exact"):
            print(f"misses: {row}")
    print(Counter(row.promise for row in running))
    often = [r for r in running if r.blocked > MOST_BLOCKED]
    print(f"{len(running)} of {len(rows)} problems run, {len(running) / len(rows):.1%}")
    print(f"{len(often)} of them block in more than {MOST_BLOCKED:.0%} of their steps")
    return len(running) >= LEAST_RUN * len(rows)


def main(target: Path) -> int:
    begun = time.perf_counter()
    rows: list[Row] = []
    with target.open("w", encoding="utf-8") as out, ThreadPoolExecutor(os.cpu_count()) as pool:
        for row in pool.map(lambda item: row_of(*item), problems()):
            rows.append(row)
            print(row, file=out, flush=True)
    enough = report(rows)
    print(f"{time.perf_counter() - begun:.0f} s; all of them: {target}")
    return 0 if enough else 1


if __name__ == "__main__":
    if not CORPUS.exists():
        sys.exit(f"no public models at {CORPUS}")
    sys.exit(main(REPOSITORY / "build" / "corpus-runs.tsv"))
