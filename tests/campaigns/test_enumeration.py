"""The enumeration of runs itself, against results worked out by hand."""

from fractions import Fraction
from typing import Any

from oracles.judgement_of_steps import Outcome, agreed
from oracles.run_enumeration import Rules, State
from oracles.small_programs import (
    Assign,
    Atom,
    Choice,
    Ending,
    Flow,
    Formula,
    Predicate,
    Problem,
    Program,
    Term,
    Test,
    number,
    variable,
)

STOP = Ending("terminate", "failure")
NO_SLACK = {"tolerance": Fraction(0)}


def compare(name: str, op: str, value: str) -> Atom:
    return Atom(variable(name), op, number(value))


def clocked(seconds: str, *domain: Formula, **rates: Term) -> Program:
    motion = Flow((*rates.items(), ("t", number(1))), (compare("t", "<=", seconds), *domain))
    return Assign("t", number(0)), motion


def safe(condition: Formula, ending: Ending = STOP, **more: Any) -> Predicate:
    return Predicate("safe", "safety", condition, number(1), number(-3), on_failure=ending, **more)


def outcome(
    body: Program, *predicates: Predicate, loop: bool = True, at: tuple[int, ...] = (), **said: Any
) -> Outcome:
    start = {"x": "0", "v": "0", "t": "0"} | {k: said.pop(k) for k in ("x", "v") if k in said}
    state = State({name: Fraction(value) for name, value in start.items()})
    extra = {"extra": said.pop("extra")} if "extra" in said else {}
    return agreed(Problem(("x", "v", "t"), body, loop, predicates, **extra), state, at, Rules(**said), 1)


RISING = clocked("1", x=variable("v"), v=number(-2))
"""From x = 0, v = 1: x = t - t^2."""


def test_a_violation_on_the_last_flow_cuts_it() -> None:
    told = outcome(RISING, safe(compare("x", "<=", "3/16")), v="1", **NO_SLACK)
    assert (told.duration, told.state.values["x"], told.state.values["v"]) == (
        Fraction(1, 4),
        Fraction(3, 16),
        Fraction(1, 2),
    )
    assert (told.reward, told.cost, told.status, told.reason, told.terminated) == (
        -3,
        1,
        "failure",
        "safe",
        True,
    )
    assert "x" in told.state.rough, "a root in doubles may be rounded"


def test_what_follows_a_flow_keeps_it_from_being_watched() -> None:
    for last in (Test(compare("x", "<=", "9")), Assign("v", number(0))):
        told = outcome((*RISING, last), safe(compare("x", "<=", "3/16")), v="1", **NO_SLACK)
        assert (told.duration, told.cost, told.ended()) == (1, 0, False)
    told = outcome(
        (*RISING, Assign("v", number(0))),
        safe(compare("x", "<=", "3/16")),
        v="1",
        safety_check="flows",
        **NO_SLACK,
    )
    assert (told.duration, told.cost, told.state.values["v"]) == (Fraction(1, 4), 1, 0)


def test_a_postcondition_says_nothing_about_the_middle_of_a_step() -> None:
    """x is above 0 on the way only: the box holds."""
    body = (
        *clocked("1", x=number(1)),
        Assign("x", number(0)),
        Flow((("t", number(1)),), (compare("t", "<=", "2"),)),
    )
    told = outcome(body, extra=compare("x", "<=", "0"))
    assert (told.duration, told.cost, told.reward, told.ended()) == (2, 0, 0, False)


def test_a_violation_that_ends_nothing_is_remembered() -> None:
    told = outcome(RISING, safe(compare("x", "<=", "3/16"), Ending("continue", "failure")), v="1", **NO_SLACK)
    assert (told.duration, told.reward, told.cost, told.status, told.reason) == (1, -3, 1, "failure", "")
    told = outcome(RISING, safe(compare("x", "<=", "3/16")), v="1", safety_check="step", **NO_SLACK)
    assert (told.duration, told.reward, told.cost, told.ended()) == (1, 1, 0, False)


def test_each_path_is_judged_by_its_own_end() -> None:
    choice = Choice(0, ((Assign("v", number(1)), *RISING), (*RISING, Assign("v", number(0)))))
    judged = [
        outcome((choice,), safe(compare("x", "<=", "3/16")), v="1", at=(k,), **NO_SLACK).cost for k in (0, 1)
    ]
    assert judged == [1, 0]


def test_a_blocked_step_is_not_judged() -> None:
    """x = 5, and what leads to x = 0 takes longer than the domain lasts."""
    body = (Flow((("x", number(-1)),), (compare("x", ">=", "1"),)), Test(compare("x", "=", "0")))
    shaped = safe(compare("x", "<=", "0"), shape=Term(((Fraction(1, 4), "x", 1),)))
    for loop, reward in ((True, Fraction(3, 4)), (False, Fraction(-1, 2))):
        told = outcome(body, shaped, loop=loop, x="5", on_blocked="truncate", blocked_penalty=Fraction(-1, 2))
        assert (told.blocked, told.reward, told.cost, told.status) == (True, reward, 0, "none")
        assert (told.reason, told.truncated, told.terminated) == ("blocked", True, False)


def test_a_flow_without_clock_lasts_to_the_end_of_its_domain_where_nothing_repeats() -> None:
    body = (Flow((("x", number(-1)),), (compare("x", ">=", "0"),)), Test(compare("x", "=", "0")))
    told = outcome(body, extra=compare("x", "=", "0"), loop=False, x="5")
    assert (told.duration, told.state.values["x"], told.cost, told.reason) == (5, 0, 0, "end")
    assert "x" not in told.state.rough, "x is set to its bound"
    told = outcome(body[:1], extra=compare("x", "<=", "9"), x="5")
    assert told.duration == Fraction(1, 10)


def test_a_domain_ends_flows() -> None:
    up = number(1)
    for op, met in (("<=", True), ("<", False), ("!=", False)):
        told = outcome(clocked("2", compare("x", op, "1"), x=up), loop=False)
        assert told.duration == 1 and ("x" not in told.state.rough) == met
    assert outcome(clocked("2", compare("x", "<=", "0"), x=up)).duration == 0
    assert outcome(clocked("2", compare("x", "<", "0"), x=up), on_blocked="terminate").blocked
    touched = outcome(clocked("1", compare("x", "<=", "1/4"), x=variable("v"), v=number(-2)), v="1")
    assert touched.duration == 1


def test_failure_goes_before_success_and_safety_before_progress() -> None:
    done = Predicate("done", "progress", compare("x", ">=", "0"), on_success=Ending("truncate", "success"))
    failed = safe(compare("x", "<=", "-1"), Ending("truncate", "failure"))
    lucky = safe(compare("x", "<=", "-1"), Ending("terminate", "success"))
    body = (Assign("x", number(0)),)
    assert outcome(body, done, failed).reason == "safe"
    assert (outcome(body, done, lucky).reason, outcome(body, done, lucky).terminated) == ("safe", True)
    kept = safe(compare("x", "<=", "1"), on_success=Ending("continue", "success"))
    assert outcome(body, kept).status == "success" and outcome(body, done, kept).reason == "done"


def test_obligations_are_watched_and_cut_nothing() -> None:
    """Due at t = 1/2 where x is 1/2; the end does not mend it. Met once before, it is met."""
    due = compare("t", ">=", "1/2")
    goal = Predicate("goal", "progress", compare("x", ">=", "1"), number(10), on_failure=STOP, due=(due,))
    told = outcome(clocked("1", x=number(1)), goal)
    assert (told.duration, told.reward, told.reason, told.status) == (1, 10, "goal", "failure")
    assert not outcome(clocked("1", x=number(-1)), goal, x="5/4").ended()
    assert outcome(clocked("1/4", x=number(1)), goal).reason == ""
    assert outcome((*clocked("1", x=number(1)), Assign("v", number(0))), goal).reason == "", (
        "judged at the end"
    )


def test_requests_without_a_run_become_others() -> None:
    """Of three alternatives, the first that passes; the one that agrees longest goes first."""
    gate = Choice(0, tuple((Test(compare("x", "<=", b)), Assign("v", number(b))) for b in ("-1", "1", "2")))
    told = outcome((gate,), at=(0,), extra=compare("x", "<=", "9"))
    assert (told.blocked, told.state.values["v"]) == (True, 1)
    stuck = (Choice(0, ((Test(compare("x", "<=", "-1")), Assign("v", number(1))),) * 2),)
    assert outcome(stuck, at=(1,), extra=compare("x", "<=", "9")).reason == "deadlock"
