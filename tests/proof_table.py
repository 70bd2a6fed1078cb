"""A table of what is proved of the public models: `make prove`, which writes build/proofs.tsv.

One row for every problem of the shared corpus, of equal ones the first, without the corpus' history: the
answer of `dl2c verify`, its seconds, and the group to which it belongs. Compared with the answers that
tests/golden/proofs.json expects: nothing that is expected to be proved or refuted may come out otherwise.
Each problem has one processor, beside others; those that fall short are asked once more, alone, with all of
them, and the table says which.
DL2C_PROVE_SECONDS is the limit for each, DL2C_PROVE a part of file names to look at alone. DL2C_PROVE_BARE=1
takes invariants and tactics away; what is then not proved counts as nothing unexpected. With
DL2C_PROVE_AGREE=1 cvc5 is asked every question that Z3 calls impossible, once the answer is there; the table
then says how often it confirms that, gives up, or contradicts.
"""

import hashlib
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, is_dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, TypeAlias

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_entry, print_formula
from dl2c.resolve.problem import expansion
from dl2c.resolve.symbols import nodes
from dl2c.smt.portfolio import Outcome, Portfolio, Solver
from dl2c.source import Source, Span
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.theorem import theorem_of

REPOSITORY = Path(__file__).resolve().parent.parent
CORPUS = REPOSITORY.parent / "shared" / "corpus"
EXPECTED = REPOSITORY / "tests" / "golden" / "proofs.json"
SUFFIXES = (".kyx", ".key", ".kya")
SECONDS = float(os.environ.get("DL2C_PROVE_SECONDS", "60"))
CHOSEN = os.environ.get("DL2C_PROVE", "")
BARE = bool(os.environ.get("DL2C_PROVE_BARE"))
AGREE = bool(os.environ.get("DL2C_PROVE_AGREE"))
AGREE_SECONDS = 5.0
"""For cvc5, each question."""

WORDS = {"unsat": "confirmed", "unknown": "silent", "sat": "contradicted"}
"""What cvc5 says of what Z3 calls impossible."""

CONTRARY = {"proved": "refuted", "refuted": "proved"}

Group: TypeAlias = Literal[
    "loops, solvable", "loops, polynomial", "nonlinear", "basic", "advanced", "false", "other"
]


@dataclass(frozen=True, slots=True)
class Claim:
    """One problem; `digest` is of its formula with definitions expanded."""

    file: str
    number: int
    name: str
    digest: str

    @property
    def entry(self) -> tree.Entry:
        """Read again, so that problems are cheap to send to other processes."""
        archive, _ = parse_archive(Source.read(CORPUS / self.file))
        return archive.entries[self.number - 1]

    @property
    def bare(self) -> tree.Entry:
        """Without invariants and tactics."""
        text = print_entry(without_invariants(replace(self.entry, program_annotations=())))
        return parse_archive(Source(self.file, text))[0].entries[0]


@dataclass(frozen=True, slots=True)
class Row:
    """The answer about one problem; `heard` counts what cvc5 says of Z3's answers."""

    problem: Claim
    group: str
    answer: str
    seconds: float
    heard: Mapping[str, int] = field(default_factory=dict[str, int])

    def __str__(self) -> str:
        p = self.problem
        return f"{p.file}\t{p.number}\t{p.name}\t{p.digest}\t{self.group}\t{self.answer}\t{self.seconds:.1f}"


class Noting(Portfolio):
    """Notes the questions that Z3 calls impossible."""

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs)
        self.impossible: dict[str, None] = {}

    def ask(
        self, text: str, seconds: float, names: Sequence[str] = (), only: Solver | None = None
    ) -> Outcome:
        """The same answer."""
        found = super().ask(text, seconds, names, only)
        if found.verdict == "unsat" and found.solver.startswith("z3"):
            self.impossible[text] = None
        return found

    def asked_again(self) -> Counter[str]:
        """What cvc5 says of them, by `WORDS`."""
        said = (super(Noting, self).ask(text, AGREE_SECONDS, only="cvc5") for text in self.impossible)
        return Counter(WORDS[outcome.verdict] for outcome in said)


def problems(chosen: Sequence[str] = (CHOSEN,)) -> Iterator[Claim]:
    """All problems that can be read, each once, in files whose names have one of the parts."""
    seen: set[str] = set()
    for path in sorted(p for p in CORPUS.rglob("*") if p.suffix in SUFFIXES):
        name = str(path.relative_to(CORPUS))
        if "@history" in name or not any(part in name for part in chosen):
            continue
        try:
            archive, _ = parse_archive(Source.read(path))
        except CompileError:
            continue
        for number, entry in enumerate(archive.entries, 1):
            try:
                text = print_formula(expansion(entry))
            except CompileError:
                continue
            digest = hashlib.sha256(text.encode()).hexdigest()[:16]
            if digest not in seen:
                seen.add(digest)
                yield Claim(name, number, entry.name, digest)


def without_invariants(node: Any) -> Any:
    """A part of a syntax tree, its loops and differential equations without what is said to stay true."""
    if isinstance(node, tuple):
        return tuple(without_invariants(part) for part in node)  # pyright: ignore[reportUnknownVariableType]
    if not is_dataclass(node) or isinstance(node, Span | type):
        return node
    changes = {f.name: without_invariants(getattr(node, f.name)) for f in fields(node) if f.init}
    if isinstance(node, tree.Loop | tree.ODESystem):
        changes["invariants"] = ()
    return replace(node, **changes)


def group_of(problem: Claim, entry: tree.Entry) -> Group:
    """The row of the table of goals to which a problem belongs."""
    for name, group in (("nonlinear.kyx", "nonlinear"), ("basic.kyx", "basic"), ("advanced.kyx", "advanced")):
        if problem.file.endswith(f"benchmarks/{name}"):
            return group  # pyright: ignore[reportReturnType]
    if problem.file.endswith("counterexample.kyx"):
        return "false"
    formula = theorem_of(entry, {}).formula
    loops = [n for n in nodes(formula) if isinstance(n, tree.Loop)]
    rates = [e for n in nodes(formula) if isinstance(n, tree.ODESystem) for e in n.equations]
    if not loops or any(isinstance(e, tree.DifferentialProgramConst) for e in rates):
        return "other"
    if any(isinstance(n, tree.FuncOf) for e in rates for n in nodes(e)):
        return "other"
    moving = {e.name for e in rates if isinstance(e, tree.AtomicODE)}
    solvable = not _circular(rates, moving)
    return "loops, solvable" if solvable and all(loop.invariants for loop in loops) else "loops, polynomial"


def _circular(rates: list[tree.AtomicODE | tree.DifferentialProgramConst], moving: set[str]) -> bool:
    """Whether some rate depends on itself, directly or through others."""
    needs = {
        e.name: {n.name for n in nodes(e.term) if isinstance(n, tree.Variable)} & moving
        for e in rates
        if isinstance(e, tree.AtomicODE)
    }
    left = dict(needs)
    while ready := [x for x, others in left.items() if not others & left.keys()]:
        for x in ready:
            del left[x]
    return bool(left)


def row_of(problem: Claim, jobs: int = 1) -> Row:
    """The answer, within the limit of time, on so many processors."""
    begun = time.perf_counter()
    group: str = "other"
    heard: Counter[str] = Counter()
    with Noting(jobs) as solvers:
        try:
            group = group_of(problem, problem.entry)
            entry = problem.bare if BARE else problem.entry
            answer = prove_theorem(
                theorem_of(entry, {}), Limits(total=SECONDS, jobs=jobs), solvers=solvers
            ).answer
        except CompileError:
            answer = "refused"
        except Exception as failure:  # a row must not hide the others
            answer = f"failed: {type(failure).__name__}: {failure}"[:80]
        seconds = time.perf_counter() - begun
        if AGREE:
            heard = solvers.asked_again()
    return Row(problem, group, str(answer), seconds, heard)


def expected() -> dict[str, tuple[str, str, str, str]]:
    """What is asked for, by digest: the answer; the group, file and name of the problem."""
    found = json.loads(EXPECTED.read_text(encoding="utf-8"))
    return {digest: tuple(row) for digest, row in found.items()}


def main(target: Path) -> int:
    """Write and print the table; 1 where an expected answer did not come, or cvc5 contradicts Z3."""
    begun = time.perf_counter()
    wanted = expected()
    rows: list[Row] = []
    with target.open("w", encoding="utf-8") as out, ProcessPoolExecutor(os.cpu_count()) as pool:
        for row in pool.map(row_of, list(problems())):
            rows.append(row)
            print(row, file=out, flush=True)
    for place, row in enumerate(rows):
        if not BARE and _falls_short(row, wanted):
            again = row_of(row.problem, os.cpu_count() or 1)
            rows[place] = replace(again, heard=Counter(row.heard) + Counter(again.heard))
            print(f"asked again, alone: {row.answer} in {row.seconds:.1f} s before, now {again}")
    target.write_text("".join(f"{row}\n" for row in rows), encoding="utf-8")
    counts = Counter((r.group, r.answer.split(":")[0]) for r in rows)
    for (group, answer), count in sorted(counts.items()):
        print(f"{count:5}  {group:20} {answer}")
    print(f"{len(rows):5}  problems in {time.perf_counter() - begun:.0f} s; all of them: {target}")
    heard = sum((Counter(r.heard) for r in rows), Counter[str]())
    if AGREE:
        print(", ".join(f"{heard[word]} {word}" for word in WORDS.values()), "by cvc5")
    wrong = [r for r in rows if not _as_wanted(r, wanted)]
    for row in wrong:
        print(f"expected {wanted[row.problem.digest][0]}: {row}", file=sys.stderr)
    for row in (r for r in rows if r.heard.get("contradicted")):
        print(f"cvc5 contradicts Z3: {row}", file=sys.stderr)
    return 1 if wrong or heard["contradicted"] else 0


def _falls_short(row: Row, wanted: Mapping[str, tuple[str, str, str, str]]) -> bool:
    """Whether an expected answer did not come, which another one does not contradict."""
    answer = wanted.get(row.problem.digest, (row.answer,))[0]
    return row.answer not in (answer, CONTRARY.get(answer))


def _as_wanted(row: Row, wanted: Mapping[str, tuple[str, str, str, str]]) -> bool:
    answer = wanted.get(row.problem.digest, (row.answer,))[0]
    return row.answer != CONTRARY.get(answer) if BARE else row.answer == answer


if __name__ == "__main__":
    if not CORPUS.exists():
        sys.exit(f"no public models at {CORPUS}")
    if AGREE and find_spec("cvc5") is None:
        sys.exit("DL2C_PROVE_AGREE needs cvc5: pip install 'dl2c[verify]'")
    sys.exit(main(REPOSITORY / "build" / "proofs.tsv"))
