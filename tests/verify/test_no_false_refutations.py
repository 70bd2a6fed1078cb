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
    Trap(
        "an equation whose domain, which cannot be expressed, is left at once",
        "x = 0 -> [{x' = 1 & \\forall y x * (y^3 + y + 1) <= 0}] x <= 0",
        "the domain is false wherever x is not 0",
    ),
    Trap(
        "an equation whose domain is over a quotient",
        "x = 1 & z = 1 -> [y := 1 / z; {x' = 1 & \\exists w w^2 = y - x}] x <= 1",
        "the domain says x <= y, and y is 1",
    ),
    Trap(
        "a loop with a domain that cannot be expressed",
        "x = 0 -> [{?x <= 0; {x' = 1 & \\forall w x * (w^3 + w + 1) <= 0} ++ x := 0;}*] x <= 0",
        "the domain is false wherever x is not 0",
    ),
    Trap(
        "the rate of what an equation does not change",
        "[{y' = 1}][{x' = 1}] y' = 1",
        "the second equation leaves y' alone",
    ),
    Trap(
        "the rate of what an equation does not change, in one program",
        "[{y' = 1}; {x' = 1}] y' = 1",
        "the second equation leaves y' alone",
    ),
    Trap(
        "an assignment to a rate in an assumption",
        "[x' := 5;] x = 5 -> [y := 1;] x = 5",
        "the assumption says x = 5",
    ),
    Trap(
        "any rate in an assumption",
        "x = 1 & <x' := *;> x = 5 -> [y := 1;] x = 5",
        "the assumption is never true",
    ),
    Trap(
        "an assignment to a rate in a domain",
        "x = 1 & y = 0 -> [{y' = 1 & [x' := 7;] x = 7}] y = 5",
        "the domain is never true",
    ),
    Trap(
        "an assignment to a rate in a test",
        "x = 1 -> [?[x' := 5;] x = 5; y := x;] y = 5",
        "the test never passes",
    ),
    Trap("any rate", "[x' := *;] x = x", "x is x"),
    Trap(
        "the earlier value of a bound name",
        "x = 0 -> [{x := x + 1;}*@invariant(\\exists w (old(w) = x | x >= 0))] x >= 0",
        "x only grows",
    ),
)


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


@pytest.mark.parametrize("theorem", TRUE, ids=lambda theorem: theorem.name)
def test_what_is_true_is_not_refuted(theorem: Trap, solvers: Portfolio) -> None:
    archive, _ = parse_archive(Source("model.kyx", theorem.text))
    said = prove_theorem(theorem_of(archive.entries[0], {}), Limits(each=2.0, total=3.0), solvers=solvers)
    assert said.answer != "refuted", theorem.why
