"""The frozen table of what is proved of the public models (`make prove` makes it anew)."""

import random
from collections import Counter

import pytest
from oracles.exact_runs import expanded, refutes
from proof_table import CORPUS, Claim, expected, problems
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

QUICK = ("basic", "false")
"""Groups of which some are proved again in CI."""


@pytest.fixture(scope="module")
def claims() -> dict[str, Claim]:
    return {claim.digest: claim for claim in problems()}


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
def test_every_row_is_a_problem_of_the_corpus(claims: dict[str, Claim]) -> None:
    assert expected().keys() <= claims.keys()


@needs_corpus
def test_some_are_answered_alike(claims: dict[str, Claim]) -> None:
    chosen = [d for d, (_, group, _, _) in expected().items() if group in QUICK]
    for digest in random.Random(1).sample(chosen, 6):
        answer = prove_theorem(theorem_of(claims[digest].entry, {}), Limits(total=60.0)).answer
        assert answer == expected()[digest][0], claims[digest].name


@pytest.mark.slow  # refutes public models; report/test_refuted_runs.py follows such runs too
@needs_corpus
def test_refutations_are_confirmed_by_another_evaluator(claims: dict[str, Claim]) -> None:
    """Runs are followed again by an oracle that shares no code with the prover."""
    chosen = [d for d, (answer, _, _, _) in expected().items() if answer == "refuted"]
    for digest in random.Random(2).sample(chosen, min(5, len(chosen))):
        entry = claims[digest].entry
        run = prove_theorem(theorem_of(entry, {}), Limits(total=60.0)).counterexample
        assert run is not None, claims[digest].name
        if "as soon as" in run.violated:
            continue
        assert refutes(expanded(entry), dict(run.state), decided(run)), claims[digest].name
