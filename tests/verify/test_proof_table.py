"""The frozen table of what is proved of the public models (`make prove` makes it anew)."""

import random
from collections import Counter
from collections.abc import Collection, Sequence
from functools import cache

import pytest
from oracles.exact_runs import expanded, refutes
from proof_table import CORPUS, Claim, expected, problems
from selection import few_and_many
from verify.trap import decided

from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.theorem import theorem_of

needs_corpus = pytest.mark.skipif(not CORPUS.exists(), reason="no public models beside the checkout")

FALSE = (
    *("01_robo1-falsespeedsb", "02_robo2-cex", "01_robo1-falsedistancesb", "02_robo2-cexstopped"),
    *("ETCS-essentials-bare", "LICS: Example 3b event-triggered car is unsafe"),
)
"""Problems that are false, by name."""

LOOPS = 148
"""Loops whose motion is polynomial, without those that are solvable and have invariants."""

QUICK = {"basic": "benchmarks/basic.kyx", "false": "benchmarks/counterexample.kyx"}
"""Groups of which some are proved again in CI, and where they stand."""

GROUPS = frozenset(group for _, group, _, _ in expected().values())


@cache
def claims(files: Sequence[str]) -> dict[str, Claim]:
    return {claim.digest: claim for claim in problems(files)}


def test_what_is_false_is_never_expected_to_be_proved() -> None:
    answers = {name: answer for answer, _, _, name in expected().values()}
    assert [answers.get(name) for name in FALSE if answers.get(name) not in (None, "refuted")] == []


def test_goals_that_are_met() -> None:
    counts = Counter((group, answer) for answer, group, _, _ in expected().values())
    assert counts["basic", "proved"] >= 50
    assert counts["advanced", "proved"] >= 5
    assert counts["nonlinear", "proved"] >= 100
    assert counts["loops, polynomial", "proved"] + counts["loops, polynomial", "refuted"] >= 0.7 * LOOPS
    assert counts["false", "refuted"] >= 12


@needs_corpus
@pytest.mark.parametrize(
    ("groups", "files"),
    [(QUICK.keys(), (*QUICK.values(),)), pytest.param(GROUPS, ("",), marks=pytest.mark.slow)],
    ids=["some", "all"],
)
def test_every_row_is_a_problem_of_the_corpus(groups: Collection[str], files: Sequence[str]) -> None:
    rows = {digest for digest, (_, group, _, _) in expected().items() if group in groups}
    assert rows <= claims(files).keys()


@needs_corpus
@pytest.mark.parametrize("count", few_and_many(3, 6))
def test_some_are_answered_alike(count: int) -> None:
    known = claims((*QUICK.values(),))
    chosen = [d for d, (_, group, _, _) in expected().items() if group in QUICK]
    for digest in random.Random(1).sample(chosen, count):
        answer = prove_theorem(theorem_of(known[digest].entry, {}), Limits(total=60.0)).answer
        assert answer == expected()[digest][0], known[digest].name


@pytest.mark.slow  # refutes public models; report/test_refuted_runs.py follows such runs too
@needs_corpus
def test_refutations_are_confirmed_by_another_evaluator() -> None:
    """Runs are followed again by an oracle that shares no code with the prover."""
    known = claims(("",))
    chosen = [d for d, (answer, _, _, _) in expected().items() if answer == "refuted"]
    for digest in random.Random(2).sample(chosen, min(5, len(chosen))):
        entry = known[digest].entry
        run = prove_theorem(theorem_of(entry, {}), Limits(total=60.0)).counterexample
        assert run is not None, known[digest].name
        if "as soon as" in run.violated:
            continue
        assert refutes(expanded(entry), dict(run.state), decided(run)), known[digest].name
