"""The prover never calls a true theorem refuted, though a part of a run looks like a counterexample."""

from collections.abc import Generator

import pytest
from verify.trap import Trap

from dl2c.parse.parser import parse_archive
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.theorem import theorem_of

NEVER = "(\\forall z (z^5 + z > 2 -> z > 100))"
"""False, and no elimination of quantifiers says so."""

TRUE = (
    Trap(
        "an equation that another conjunct follows too",
        f"(x = 0 -> [{{x' = 1}}] x >= 0) & (x = 0 & {NEVER} -> [{{x' = 1}}] x <= 0)",
        "the second conjunct is about no state",
    ),
    Trap(
        "an equation that is followed under another assumption",
        f"(x = 0 -> [{{x' = 1 & x <= 2}}] x >= 0) & ({NEVER} -> [{{x' = 1 & x <= 2}}] x <= 0)",
        "the second conjunct is about no state",
    ),
    Trap(
        "an equation in both directions of an equivalence",
        f"x = 0 -> ({NEVER} <-> [{{x' = 1}}] x <= 0)",
        "neither side is true",
    ),
    Trap(
        "a bound value under a quantifier of the same name",
        "(\\forall x [y := x;] \\forall x (x = y)) -> [z := 1;] z = 2",
        "no number is equal to all others",
    ),
    Trap(
        "an equation that ends before its claim is false",
        "x = 0 -> [{x' = 1 & x <= 0}] x <= 0",
        "the domain is left as soon as x moves",
    ),
    Trap(
        "an equation whose domain is false where it begins",
        "x = 1 -> [{x' = x & x < 1}] x < 1",
        "there is no run at all",
    ),
    Trap(
        "an equation whose domain is left at once, as the second derivative says",
        "x = 0 & y = 0 -> [{x' = 1, y' = x & y <= 0}] x <= 0",
        "y is positive after any time",
    ),
)


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


@pytest.mark.parametrize("theorem", TRUE, ids=lambda theorem: theorem.name)
def test_what_is_true_is_not_refuted(theorem: Trap, solvers: Portfolio) -> None:
    archive, _ = parse_archive(Source("model.kyx", theorem.text))
    said = prove_theorem(theorem_of(archive.entries[0], {}), Limits(each=2.0, total=5.0), solvers=solvers)
    assert said.answer != "refuted", theorem.why
