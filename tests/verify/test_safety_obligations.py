"""`@safety` predicates: where steps begin, and at all instants of flows with which a step ends."""

from collections.abc import Generator

import pytest

from dl2c.parse.parser import parse_archive
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove_theorem
from dl2c.verify.report import Obligation, Report
from dl2c.verify.theorem import theorem_of

MODEL = """ArchiveEntry "model"
Definitions
  /* @safety: penalty=-1 */
  Bool safe(Real x) <-> {safe};
End.
ProgramVariables
  /* @var: bound=[-9:9] */
  Real x;
  /* @var: bound=[-9:9] */
  Real v;
  Real t;
End.
Problem
  {problem}
End.
End.
"""


@pytest.fixture(scope="module")
def solvers() -> Generator[Portfolio]:
    with Portfolio() as portfolio:
        yield portfolio


def report(safe: str, problem: str, solvers: Portfolio) -> Report:
    text = MODEL.replace("{safe}", safe).replace("{problem}", problem)
    archive, _ = parse_archive(Source("model.kyx", text))
    return prove_theorem(theorem_of(archive.entries[0], {}), Limits(each=2.0, total=20.0), solvers=solvers)


def safety(said: Report) -> Obligation:
    (one,) = [o for o in said.obligations if o.kind == "safety"]
    assert one.predicate == "safe"
    return one


RISES = "x = 0 & v = 0 -> [t := 0; {x' = 1, t' = 1 & t <= 2}] x >= 0"
FALLS = "x > 0 -> [{x' = -x}] x >= -1"
TESTED = "x = 0 -> [{x' = 1 & x <= 9} ?x <= 2;] x >= 0"
THEN = "x = 0 -> [{x' = 1 & x <= 2} x := 0;] x >= 0"
"""Without a loop the whole program is one step."""


@pytest.mark.parametrize(
    ("safe", "problem"),
    [("x <= 2", RISES), ("x > 0", FALLS), ("x <= 2", TESTED), ("x <= 0", THEN)],
    ids=["solved", "by a rule", "tested", "not at its end"],
)
def test_it_holds_along_the_flow_with_which_a_program_ends(
    safe: str, problem: str, solvers: Portfolio
) -> None:
    said = report(safe, problem, solvers)
    assert (said.answer, safety(said).answer, safety(said).loop) == ("proved", "proved", 0)


@pytest.mark.parametrize(
    ("safe", "problem", "value"), [("x < 2", RISES, 2), ("x <= 1", TESTED, 2)], ids=["solved", "tested"]
)
def test_it_fails_at_an_instant_of_a_flow(safe: str, problem: str, value: int, solvers: Portfolio) -> None:
    """The theorem is proved all the same."""
    said = report(safe, problem, solvers)
    one = safety(said)
    assert (said.answer, said.counterexample, one.answer) == ("proved", None, "refuted")
    assert one.counterexample is not None
    ((name, duration),) = one.counterexample.decisions
    assert name == "duration" and value - 1 < duration <= value


LOOP = "x = 0 & v >= 0 -> [{{v := 1; ++ v := 0;} t := 0; {x' = v, t' = 1 & t <= 1}}*@invariant({J})] x >= 0"


def test_an_invariant_that_is_kept_keeps_it_along_flows(solvers: Portfolio) -> None:
    one = safety(report("x >= 0", LOOP.replace("{J}", "x >= 0"), solvers))
    assert (one.answer, one.loop, one.title) == ("proved", 1, "safety safe (loop 1)")


def test_an_invariant_that_does_not_imply_it_is_too_weak(solvers: Portfolio) -> None:
    one = safety(report("x >= 1", LOOP.replace("{J}", "x >= 0"), solvers))
    assert (one.answer, one.reason) == ("refuted", "J is too weak there")
    assert one.counterexample is not None and 0 <= one.counterexample.state["x"] < 1


def test_an_invariant_that_is_not_kept_says_nothing_of_the_ends_of_steps(solvers: Portfolio) -> None:
    """x <= 3 implies x <= 3, and a step leads out of it."""
    leads_out = "x = 0 & v = 1 -> [{x := x + v; v := v + x;}*@invariant(x <= 3)] x >= 0"
    said = report("x <= 3", leads_out, solvers)
    answers = {o.kind: o.answer for o in said.obligations}
    assert answers == {"initially": "proved", "safety": "refuted", "step": "refuted", "finally": "refuted"}


def test_runs_that_are_not_followed_to_their_end_leave_it_open(solvers: Portfolio) -> None:
    game = "x = 0 -> [{x' = 1 & x <= 1}^@] x >= 0"
    said = report("x <= 1", game, solvers)
    assert safety(said).answer != "proved"


def test_a_step_that_leaves_the_invariant_under_universal_assumptions(
    solvers: Portfolio,
) -> None:
    """What these say of known values is added to a state each time that it is asked about."""
    assumed = "x = 0 & (\\forall t (t^5 + t > 2 -> t + v > 1)) & t^5 + t > 2"
    said = report("x <= 1", f"{assumed} -> [{{x := x + 2;}}*@invariant(x <= 1)] t + v > 1", solvers)
    assert safety(said).answer != "proved"
