"""Models that are proved, attacked: exact random runs, and mutants that a run refutes.

The models are the examples, and what tests/golden/proofs.json calls proved of the public ones. DL2C_RUNS and
DL2C_MUTANTS say how many runs and false mutants there are in all, DL2C_SEED which; build/ gets a row for each
model.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from time import monotonic

import pytest
from generators.mutants import KINDS, mutants
from oracles.exact_random import first_invariant, refutation, run
from oracles.exact_runs import Finding, expanded, theorem
from proof_table import Claim, expected, problems
from selection import quick_among

from dl2c.diagnostics import CompileError
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_formula
from dl2c.parse.tree import Entry
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.theorem import theorem_of

REPOSITORY = Path(__file__).resolve().parents[2]
RUNS = int(os.environ.get("DL2C_RUNS", "100000"))
MUTANTS = int(os.environ.get("DL2C_MUTANTS", "1000"))
SEED = int(os.environ.get("DL2C_SEED", "1"))

FALSE = "deadline"
"""The example whose theorem is false, as it says."""

SECONDS = 10.0
"""For the runs of a model, and for looking for its false mutants."""

SHARE = 3
"""How often its equal share of the runs a model may have, since from others less will come."""

TRIES = 6
"""Runs that look for what is false in a mutant, of which there are many."""

MOST_MUTANTS = 30
"""False ones of one model."""

PROOF_SECONDS = 10.0
"""For a mutant."""

PROVED = {"proved", "proved-if-defined"}


@dataclass(frozen=True)
class Example:
    """The first entry of a file of the project."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def entry(self) -> Entry:
        return parse_archive(Source.read(self.path))[0].entries[0]


@dataclass(frozen=True)
class Row:
    """What came out for a model: counts, and what must not be."""

    name: str
    counts: Mapping[str, int]
    wrong: str = ""


def models() -> list[Example | Claim]:
    """All that are proved."""
    answers = expected()
    public = [p for p in problems() if answers.get(p.digest, ("",))[0] in PROVED]
    examples = sorted((REPOSITORY / "examples").rglob("*.kyx"))
    return [*(Example(path) for path in examples if path.stem != FALSE), *public]


def gathered(
    name: str,
    judged: Callable[[Example | Claim], Row],
    some: Iterable[Example | Claim],
    enough: Callable[[Mapping[str, int]], bool] = lambda counts: False,
) -> Row:
    """The rows of all models, or of as many as are enough, summed up, after they are written to a file of the
    folder build.
    """
    target = REPOSITORY / "build" / name
    target.parent.mkdir(exist_ok=True)
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    with target.open("w", encoding="utf-8") as out, ProcessPoolExecutor(os.cpu_count()) as pool:
        for row in pool.map(judged, some):
            counts.update(row.counts)
            print(row.name, dict(row.counts), row.wrong, sep="\t", file=out, flush=True)
            if row.wrong:
                wrong.append(f"{row.name}: {row.wrong}")
            if enough(counts):
                pool.shutdown(cancel_futures=True)
                break
    print(dict(counts))
    return Row(name, counts, "\n".join(wrong))


def runs_of(share: int, model: Example | Claim, seconds: float = SECONDS) -> Row:
    """Random runs of a model, as many as its share or as time allows. Q is kept, and J if it is used."""
    formula = expanded(model.entry)
    random, inside = Random(f"{SEED} {model.name}"), first_invariant(formula)
    counts: Counter[str] = Counter()
    begun, wrong = monotonic(), ""
    while counts["ended"] < share and monotonic() - begun < seconds and not wrong:
        one = run(formula, random, inside)
        counts["begun"] += one.begun
        counts["ended"] += one.ended
        counts["in vain"] += not one.begun
        if one.finding is not None and (one.finding.kind == "postcondition" or _is_used(model)):
            wrong = shown(one.finding)
    return Row(model.name, counts, wrong)


def _is_used(model: Example | Claim) -> bool:
    """Whether the proof is one with the invariants that the text gives."""
    report = prove_theorem(theorem_of(model.entry, {}), Limits(total=60.0, jobs=1))
    return report.answer in PROVED and not report.invented


def mutants_of(share: int, seconds: float, model: Example | Claim, search: float = SECONDS) -> Row:
    """Mutants of a model that an exact run refutes, as many as its share or as time allows."""
    counts: Counter[str] = Counter()
    searched, found = 0.0, 0
    with Portfolio(1) as solvers:
        for number, mutant in enumerate(mutants(model.entry, SEED)):
            if found == share or searched > search:
                break
            begun = monotonic()
            try:
                false = refutation(theorem(mutant.text), Random(f"{SEED} {number}"), TRIES)
            except CompileError:
                false = None
            searched += monotonic() - begun
            if false is None:
                counts["not refuted by runs"] += 1
                continue
            found += 1
            limits = Limits(each=2.0, total=seconds)
            source = Source("mutant.kyx", mutant.text)
            said = prove_theorem(
                theorem_of(parse_archive(source)[0].entries[0], {}), limits, solvers=solvers
            ).answer
            counts[mutant.kind] += 1
            counts[f"said: {said}"] += 1
            if said in PROVED:
                return Row(model.name, counts, f"{mutant.kind}\n{mutant.text}\n{shown(false)}")
    return Row(model.name, counts)


def shown(finding: Finding) -> str:
    """A run that violates J or Q, as text."""
    start = ", ".join(f"{name} = {value}" for name, value in finding.start.items())
    return f"from {start} by {finding.decisions}: not {print_formula(finding.formula)}"


@pytest.mark.slow
def test_proved_models_keep_what_is_proved() -> None:
    """In rational numbers, from states of P of which half are on a boundary of J or P, for any duration."""
    proved = models()
    found = gathered("runs.tsv", partial(runs_of, 1 + SHARE * RUNS // len(proved)), proved)
    assert not found.wrong
    assert found.counts["ended"] >= RUNS


@pytest.mark.slow
def test_false_mutants_are_not_proved() -> None:
    """Of models in an order that the seed decides, until there are enough of each kind."""
    proved = models()
    Random(SEED).shuffle(proved)
    judged = partial(mutants_of, MOST_MUTANTS, PROOF_SECONDS)
    found = gathered("mutants.tsv", judged, proved, _enough_mutants)
    assert not found.wrong
    assert _enough_mutants(found.counts)


def _enough_mutants(counts: Mapping[str, int]) -> bool:
    some = [counts.get(kind, 0) for kind in KINDS]
    return sum(some) >= MUTANTS and min(some) >= 0.03 * MUTANTS


@pytest.mark.parametrize("name", quick_among(("bouncing_ball", "watertank"), ("watertank",)))
def test_few_of_each(name: str) -> None:
    """The campaigns above, in small."""
    model = Example(REPOSITORY / "examples" / f"{name}.kyx")
    runs, false = runs_of(20, model, 60.0), mutants_of(2, 3.0, model, 60.0)
    assert (runs.counts["ended"], runs.wrong) == (20, "")
    assert (sum(false.counts[kind] for kind in KINDS), false.wrong) == (2, "")
