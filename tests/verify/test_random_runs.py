"""Theorems that only long runs refute: an oracle follows each run that random decisions found."""

import random
import time
from collections.abc import Generator
from fractions import Fraction

import pytest
from conftest import REPOSITORY
from flint import fmpq, fmpq_poly
from hypothesis import given
from hypothesis import strategies as st
from oracles.exact_runs import refutes, theorem
from verify.trap import MODEL, decided

from dl2c.parse.parser import parse_archive
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.random_runs import LONGEST, RandomRun, claim_of, positive_roots
from dl2c.verify.refute import Refutation
from dl2c.verify.report import Counterexample
from dl2c.verify.theorem import Theorem, theorem_of

FALSE = {
    "steps up and down": "x = 0 -> [{x := x + 1; ++ x := x - 1;}*] x < 12",
    "a value that is chosen": "x = 0 & c > 1 -> [{y := *; ?(0 <= y & y <= c); x := x + y;}*] x < 20*c",
    "a motion until its domain ends": "x = 0 & v > 1 -> [{t := 0; {x' = v, t' = 1 & t <= 2}}*] x <= 40*v",
    "a domain that ends at a root": "x = 0 & y = 1 -> [{{x' = 1 & x^2 <= 2 * y}; y := y + 1;}*] x < 3",
    "a jump before": "[x := *; ?(x < 0); {?(x < 20); x := x + 3/2; ++ ?(x >= 20); x := -1;}*] x < 20",
    "a loop inside": "x = 0 -> [{{x := x + 1;}* y := 0; ?(x < 50);}*] x < 30",
    "one of two": "(x = 0 -> [{x := x + 1;}*] x >= 0) & (x = 0 -> [{x := x + 1;}*] x < 20)",
}

TRUE = {
    "only up": "x = 0 -> [{x := x + 1; ++ x := 2*x;}*] x >= 0",
    "within a domain": "x = 0 & v > 0 -> [{v := *; {x' = v & x <= 7}}*] x <= 7",
    "tested": "x = 0 -> [{y := *; ?(x + y <= 3); x := x + y;}*] x <= 3",
}


def theorem_about(problem: str) -> Theorem:
    archive, _ = parse_archive(Source("model.kyx", MODEL.replace("{problem}", problem)))
    return theorem_of(archive.entries[0], {})


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


def found(claim: Theorem, solvers: Portfolio) -> Counterexample | None:
    return Refutation(claim, Prover(solvers, 5.0, time.monotonic() + 20.0)).at_random()


@pytest.mark.parametrize("name", FALSE)
def test_a_long_run_is_found(name: str, solvers: Portfolio) -> None:
    run = found(theorem_about(FALSE[name]), solvers)
    assert run is not None and len(run.steps) > 2
    assert refutes(theorem(MODEL.replace("{problem}", FALSE[name])), run.state, decided(run))


@pytest.mark.parametrize("name", TRUE)
def test_none_refutes_what_is_true(name: str, solvers: Portfolio) -> None:
    assert found(theorem_about(TRUE[name]), solvers) is None


def test_the_robot_without_tests_meets_the_obstacle(solvers: Portfolio) -> None:
    """As the page for lectures says; each of its shortest runs accelerates for seven steps."""
    source = Source.read(REPOSITORY / "docs" / "lecture" / "unguarded.kyx")
    run = found(theorem_of(parse_archive(source)[0].entries[0], {}), solvers)
    assert run is not None and run.violated == "x < xo" and len(run.steps) >= 7
    assert refutes(theorem(source.text), run.state, decided(run))


def test_a_run_is_one_that_its_seed_gives() -> None:
    claim = claim_of(theorem_about(FALSE["steps up and down"]).formula)
    assert claim is not None
    runs = [RandomRun({"x": Fraction(0)}, (), claim=claim, chance=random.Random(k // 2)) for k in range(20)]
    assert {run.succeeds() for run in runs} == {True, False}
    assert all(a.drawn == b.drawn for a, b in zip(runs[::2], runs[1::2], strict=True))
    assert all(run.iterations <= LONGEST for run in runs)


def test_numbers_do_not_grow_for_ever(solvers: Portfolio) -> None:
    begun = time.process_time()
    squares = "x := x * x; " * 60
    assert found(theorem_about(f"x = 2 -> [{{{squares}}}*] x >= 2"), solvers) is None
    assert time.process_time() - begun < 10


def test_what_claims_nothing_after_a_loop_is_not_tried(solvers: Portfolio) -> None:
    assert found(theorem_about("x = 0 -> [x := 1;] x = 0"), solvers) is None


@given(roots=st.lists(st.fractions(-5, 5, max_denominator=9), min_size=1, max_size=3))
def test_times_are_roots_or_just_before(roots: list[Fraction]) -> None:
    margin = fmpq_poly([1])
    for root in roots:
        margin *= fmpq_poly([fmpq(-root.numerator, root.denominator), 1])
    times = positive_roots(margin)
    assert all(t > 0 and any(0 <= root - t <= Fraction(1, 500) for root in roots) for t in times)
    assert {r for r in roots if r > Fraction(1, 500)} <= {
        r for t in times for r in roots if 0 <= r - t <= 0.002
    }
