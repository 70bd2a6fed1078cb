"""The portfolio of solvers: who is asked, and that they must not contradict each other."""

from collections import Counter
from collections.abc import Generator
from typing import Any

import pytest

from dl2c.smt import portfolio
from dl2c.smt.portfolio import Portfolio, SolverContradiction

pytest.importorskip("cvc5")

POSSIBLE = "(declare-fun x () Real) (assert (> x 1.0))"
IMPOSSIBLE = "(declare-fun x () Real) (assert (> x 1.0)) (assert (< x 0.0))"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Generator[Counter[str]]:
    """How often each solver is asked."""
    found: Counter[str] = Counter()
    before = portfolio._Process.ask  # pyright: ignore[reportPrivateUsage]

    def noting(process: Any, question: dict[str, Any]) -> None:
        found[question["solver"]] += 1
        before(process, question)

    monkeypatch.setattr(portfolio._Process, "ask", noting)  # pyright: ignore[reportPrivateUsage]
    yield found


@pytest.mark.parametrize(("text", "verdict"), [(POSSIBLE, "sat"), (IMPOSSIBLE, "unsat")])
def test_all_are_heard_that_are_to_agree(text: str, verdict: str, asked: Counter[str]) -> None:
    with Portfolio(2, agree=True) as solvers:
        assert solvers.ask(text, 5.0).verdict == verdict
        assert asked == {"z3": 1, "z3-nlsat": 1, "cvc5": 1}


def test_one_that_is_asked_alone_has_to_agree_with_cvc5(asked: Counter[str]) -> None:
    with Portfolio(1) as solvers:
        assert solvers.ask(IMPOSSIBLE, 5.0, only="z3").verdict == "unsat"
    assert asked == {"z3": 1}
    with Portfolio(1, agree=True) as solvers:
        assert solvers.ask(IMPOSSIBLE, 5.0, only="z3").verdict == "unsat"
    assert asked == {"z3": 2, "cvc5": 1}


def test_a_contradiction_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    before = portfolio._outcome  # pyright: ignore[reportPrivateUsage]

    def lying(answer: dict[str, Any], solver: str) -> Any:
        return before({**answer, "verdict": "unsat"} if solver == "cvc5" else answer, solver)

    monkeypatch.setattr(portfolio, "_outcome", lying)
    with Portfolio(2, agree=True) as solvers, pytest.raises(SolverContradiction):
        solvers.ask(POSSIBLE, 5.0)
