"""The prover never calls a trap proved: theorems that are false, though a wrong rule would prove them."""

from collections.abc import Generator

import pytest
from selection import quick_among
from verify.trap import Trap
from verify.traps import POLYNOMIAL, TRAPS

from dl2c.diagnostics import CompileError
from dl2c.parse.parser import parse_archive
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.theorem import theorem_of

SECONDS = 20.0
"""For each theorem."""

BRIEF = 3.0
"""For a trap of which no refutation is expected; in slow tests these get SECONDS."""

QUICK = TRAPS[1::3]
"""Traps of one kind stand side by side, so these are of all kinds."""

PROVED = {"proved", "proved-if-defined"}


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


def answer(text: str, solvers: Portfolio, seconds: float = SECONDS) -> str:
    """The answer about the first entry; `refused` where the model is an error."""
    try:
        archive, _ = parse_archive(Source("model.kyx", text))
        limits = Limits(each=2.0, total=seconds)
        return str(prove_theorem(theorem_of(archive.entries[0], {}), limits, solvers=solvers).answer)
    except CompileError:
        return "refused"


@pytest.mark.parametrize("trap", quick_among(TRAPS, QUICK), ids=lambda trap: trap.name)
def test_no_trap_is_proved(trap: Trap, solvers: Portfolio) -> None:
    """The polynomial ones are refuted."""
    said = answer(trap.text, solvers, SECONDS if trap in POLYNOMIAL else BRIEF)
    assert said not in ({"proved"} if trap.undefined else PROVED), trap.why
    assert said == "refuted" or trap not in POLYNOMIAL, trap.why


@pytest.mark.slow
@pytest.mark.parametrize("trap", [t for t in TRAPS if t not in POLYNOMIAL], ids=lambda trap: trap.name)
def test_no_trap_is_proved_in_more_time(trap: Trap, solvers: Portfolio) -> None:
    said = answer(trap.text, solvers)
    assert said not in ({"proved"} if trap.undefined else PROVED), trap.why
