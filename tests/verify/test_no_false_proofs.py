"""The prover never calls a false theorem proved: traps, mutants of proved models, and random exact runs.

DL2C_MUTANTS says how many mutants there are in all, DL2C_SEED which.
"""

import json
import os
from collections import Counter
from collections.abc import Generator
from importlib.util import find_spec
from pathlib import Path
from random import Random
from typing import Any

import pytest
from generators.mutants import mutants
from oracles.exact_random import refutation
from oracles.exact_runs import Finding, theorem
from verify.trap import Trap
from verify.traps import POLYNOMIAL, TRAPS

from dl2c.diagnostics import CompileError
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_entry, print_formula
from dl2c.source import Source

if find_spec("dl2c.verify") is None:  # a package that is there and cannot be imported is a failure
    pytest.skip("there is no prover yet", allow_module_level=True)

REPOSITORY = Path(__file__).resolve().parents[2]
CORPUS = REPOSITORY.parent / "shared" / "corpus"
ENTRIES = Path(__file__).with_name("proved_entries.json")
"""Names of entries that are proved, by file of the corpus."""

MUTANTS = int(os.environ.get("DL2C_MUTANTS", "1000"))
SEED = int(os.environ.get("DL2C_SEED", "1"))
SECONDS = 20.0
"""For each theorem."""

BRIEF = 5.0
"""For a trap of which no refutation is expected; in slow tests these get SECONDS."""

RUNS = 40
MORE_RUNS = 400
"""Random runs of a mutant, and of one that is said to be proved."""

PROVED = {"proved", "proved-if-defined"}


@pytest.fixture(scope="module")
def solvers() -> Generator[Any]:
    from dl2c.smt.portfolio import Portfolio

    with Portfolio() as portfolio:
        yield portfolio


def answer(text: str, solvers: Any, seconds: float = SECONDS) -> str:
    """The answer about the first entry; `refused` where the model is an error."""
    from dl2c.verify.prove import Limits, prove_entry

    try:
        archive, _ = parse_archive(Source("model.kyx", text))
        limits = Limits(each=2.0, total=seconds)
        return str(prove_entry(archive.entries[0], {}, limits, solvers=solvers).answer)
    except CompileError:
        return "refused"


@pytest.mark.parametrize("trap", TRAPS, ids=lambda trap: trap.name)
def test_no_trap_is_proved(trap: Trap, solvers: Any) -> None:
    """The polynomial ones are refuted."""
    said = answer(trap.text, solvers, SECONDS if trap in POLYNOMIAL else BRIEF)
    assert said not in ({"proved"} if trap.undefined else PROVED), trap.why
    assert said == "refuted" or trap not in POLYNOMIAL, trap.why


@pytest.mark.slow
@pytest.mark.parametrize("trap", [t for t in TRAPS if t not in POLYNOMIAL], ids=lambda trap: trap.name)
def test_no_trap_is_proved_in_more_time(trap: Trap, solvers: Any) -> None:
    said = answer(trap.text, solvers)
    assert said not in ({"proved"} if trap.undefined else PROVED), trap.why


def proved_texts() -> list[tuple[str, str]]:
    """Models by name: the examples, and entries of the corpus where that is present."""
    found = [(path.stem, path) for path in sorted((REPOSITORY / "examples").rglob("*.kyx"))]
    texts = [(name, path.read_text(encoding="utf-8")) for name, path in found]
    for file, names in json.loads(ENTRIES.read_text(encoding="utf-8")).items():
        if (CORPUS / file).exists():
            archive, _ = parse_archive(Source.read(CORPUS / file))
            texts += [(f"{file}: {e.name}", print_entry(e)) for e in archive.entries if e.name in names]
    return texts


MODELS = proved_texts()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text"), MODELS, ids=[name for name, _ in MODELS])
def test_exact_runs_of_proved_models(name: str, text: str, solvers: Any) -> None:
    if answer(text, solvers) not in PROVED:
        pytest.skip("not proved")
    assert shown(refutation(theorem(text), Random(SEED), MORE_RUNS)) == ""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text"), MODELS, ids=[name for name, _ in MODELS])
def test_no_false_mutant_is_proved(name: str, text: str, solvers: Any) -> None:
    archive, _ = parse_archive(Source(name, text))
    counts: Counter[str] = Counter()
    for number, mutant in enumerate(mutants(archive.entries[0], SEED, -(-MUTANTS // len(MODELS)))):
        try:
            formula = theorem(mutant.text)
        except CompileError:
            counts["refused"] += 1
            continue
        random = Random(f"{SEED} {number}")
        false = refutation(formula, random, RUNS)
        said = answer(mutant.text, solvers)
        if said in PROVED and false is None:
            false = refutation(formula, random, MORE_RUNS)
        counts[f"{mutant.kind}: {said}{' and false' if false else ''}"] += 1
        assert said not in PROVED or false is None, f"{mutant.kind}\n{mutant.text}\n{shown(false)}"
    print(name, dict(counts))


def shown(finding: Finding | None) -> str:
    """A run that violates Q, as text."""
    if finding is None:
        return ""
    start = ", ".join(f"{name} = {value}" for name, value in finding.start.items())
    return f"from {start} by {finding.decisions}: not {print_formula(finding.formula)}"
