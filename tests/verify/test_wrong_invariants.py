"""Obligations one by one: wrong invariants are refuted by exact runs, which refute nothing of the theorem."""

from collections.abc import Generator
from dataclasses import dataclass
from fractions import Fraction

import pytest
from oracles.exact_runs import refutes, theorem
from selection import quick_among
from verify.trap import MODEL, decided

from dl2c.parse.parser import parse_archive
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.report import Obligation, Report
from dl2c.verify.theorem import theorem_of


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


def report(problem: str, solvers: Portfolio, seconds: float = 10.0) -> Report:
    archive, _ = parse_archive(Source("model.kyx", MODEL.replace("{problem}", problem)))
    return prove_theorem(theorem_of(archive.entries[0], {}), Limits(each=2.0, total=seconds), solvers=solvers)


def found(said: Report, kind: str, loop: int) -> Obligation:
    (one,) = [o for o in said.obligations if (o.kind, o.loop) == (kind, loop)]
    return one


@dataclass(frozen=True)
class Wrong:
    """A problem that is true, with an invariant that is wrong for one obligation, which says `claim`."""

    name: str
    problem: str
    kind: str
    loop: int
    claim: str


GROWS = "x = 1 & y = 1 & c > 2 -> [{x := x + y; y := y + x + c;}*@invariant({J})] x >= 1"
DRIVES = (
    "x = 1 & v = 1 -> [{c := *; ?c >= 0; t := 0; {x' = v, v' = c, t' = 1 & t <= 1}}*@invariant({J})] x >= 1"
)
TURNS = "x = 1 & v = 1 -> [{c := *; ?c >= 0; {x' = v*x + c, v' = c*v + x}}*@invariant({J})] x >= 1/2"

WRONG = (
    Wrong(
        "initially",
        GROWS.replace("{J}", "x >= 2 & c > 2"),
        "initially",
        1,
        "x = 1 & y = 1 & c > 2 -> x >= 2 & c > 2",
    ),
    Wrong(
        "step", GROWS.replace("{J}", "x >= 1"), "step", 1, "x >= 1 -> [x := x + y; y := y + x + c;] x >= 1"
    ),
    Wrong("finally", GROWS.replace("{J}", "x >= 0 & c > 1"), "finally", 1, "x >= 0 & c > 1 -> x >= 1"),
    Wrong(
        "a motion",
        DRIVES.replace("{J}", "x >= 1"),
        "step",
        1,
        "x >= 1 -> [c := *; ?c >= 0; t := 0; {x' = v, v' = c, t' = 1 & t <= 1}] x >= 1",
    ),
    Wrong(
        "the second of two loops",
        "x = 1 & y = 1 -> [{x := x + 1;}*@invariant(x >= 1 & y = 1) "
        "{x := x + y; y := y + x;}*@invariant(x >= 1)] x >= 1",
        "step",
        2,
        "x >= 1 -> [x := x + y; y := y + x;] x >= 1",
    ),
    Wrong(
        "a loop in a loop",
        "x = 1 & y = 1 -> [{c := 2; {x := x + y; y := y + x;}*@invariant(x >= 1)}*"
        "@invariant(x >= 1 & y >= 1)] x >= 1",
        "step",
        2,
        "x >= 1 -> [x := x + y; y := y + x;] x >= 1",
    ),
    Wrong(
        "one alternative",
        "x = 1 & y = 1 -> [{x := 2; ++ {x := x + y; y := y + x;}*@invariant(x >= 1)}] x >= 1",
        "step",
        1,
        "x >= 1 -> [x := x + y; y := y + x;] x >= 1",
    ),
)


LATE = ("the second of two loops", "a loop in a loop")
"""Whose other obligations take all of the time."""

QUICK = [wrong for wrong in WRONG if wrong.name not in LATE]


@pytest.mark.parametrize("wrong", quick_among(WRONG, QUICK), ids=lambda w: w.name)
def test_a_wrong_invariant_is_refuted_by_a_run(wrong: Wrong, solvers: Portfolio) -> None:
    """Which an oracle follows that shares no code with the prover. The theorem is another matter."""
    said = report(wrong.problem, solvers)
    one = found(said, wrong.kind, wrong.loop)
    assert (one.answer, one.reason) == ("refuted", "J is wrong there")
    assert one.counterexample is not None
    claim = theorem(MODEL.replace("{problem}", wrong.claim))
    assert refutes(claim, one.counterexample.state, decided(one.counterexample))
    assert said.answer == "unknown" and said.counterexample is None


def test_a_motion_that_is_not_solved_may_leave_at_once(solvers: Portfolio) -> None:
    one = found(report(TURNS.replace("{J}", "x >= 1/4"), solvers), "step", 1)
    assert one.answer == "refuted" and one.counterexample is not None
    state = dict(one.counterexample.state)
    assert state["x"] == Fraction(1, 4) and state["v"] < 0
    assert "as soon as the equation is followed" in one.counterexample.violated


def test_what_the_loop_does_not_write_is_as_assumed(solvers: Portfolio) -> None:
    """No state with c <= 2 is one of the loop's, whatever J says."""
    one = found(report(GROWS.replace("{J}", "x >= 1"), solvers), "step", 1)
    assert one.counterexample is not None and one.counterexample.state["c"] > 2


@pytest.mark.parametrize(
    "problem",
    [
        "x = 0 -> [{x := x + 1;}*@invariant(exp(x) * exp(-x) >= 1/2)] exp(x) * exp(-x) >= 1/2",
        "x = 0 -> [{x := x + 1;}*@invariant(exp(x) >= x^2 - 1)] exp(2 * x) >= x",
    ],
)
def test_a_rule_that_fails_refutes_nothing(problem: str, solvers: Portfolio) -> None:
    said = report(problem, solvers, 3.0)
    assert "refuted" not in {o.answer for o in said.obligations} | {said.answer}


def test_another_invariant_may_prove_the_theorem(solvers: Portfolio) -> None:
    said = report("x = 1 -> [{x := x + 1;}*@invariant(x <= 5)] x >= 1", solvers)
    assert said.answer == "proved" and said.invented


def test_the_theorem_is_refuted_by_a_run_from_its_beginning_alone(solvers: Portfolio) -> None:
    said = report("x = 1 -> [{x := x - 1;}*@invariant(x >= 0)] x >= 0", solvers)
    assert said.answer == "refuted" and said.counterexample is not None
    assert said.counterexample.state["x"] == 1
