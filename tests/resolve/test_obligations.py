"""When `on_failure` of a @progress predicate counts (semantics 6), with results worked out by hand."""

import pytest
from both_forms import Both, theorem
from generators.kyx_builder import lowered

BODY = "t := 0; {x' = v, w' = -1, t' = 1 & t <= 1}"
"""One second: x moves with v, w is the time left."""


def goal(post: str, extra: str = "", **options: object) -> Both:
    definitions = f"""
      /* @progress: reward=10, penalty=-1, on_failure=terminate:failure{extra} */
      Bool goal(Real x) <-> x >= 1;
    """
    return Both(theorem(definitions, BODY, post, variables="w"), **options)


FAILED, RUNNING = ("terminated", "failure", "goal"), ("", "none", "")


def test_an_obligation_that_is_not_due_ends_nothing() -> None:
    """w <= 0 is never reached: the penalty is given, the episode goes on."""
    seen = goal("w <= 0 -> goal(x)").first(x=0, w=5)
    assert (seen.reward, seen.ending, seen.postcondition) == (-1, RUNNING, True)


def test_an_obligation_that_falls_due_after_the_step_is_judged_there() -> None:
    model = goal("w <= 0 -> goal(x)")
    assert model.first(x=0, v=0, w=1).ending == FAILED
    assert model.first(x=0, v=1, w=1).ending == RUNNING, "x is 1 when w is 0"
    assert model.first(x=1, v=0, w=-9).ending == RUNNING


def test_an_obligation_that_falls_due_on_the_way_is_judged_there() -> None:
    """w is 0 after half a second. Progress does not cut the flow, and the end does not mend it."""
    model = goal("w <= 0 -> goal(x)")
    seen = model.first(x=0, v=1, w=0.5)
    assert (seen.duration, seen.state["x"], seen.reward) == (1, 1, 10), "too late: 1/2 when it was due"
    assert seen.ending == FAILED
    assert model.first(x=0.5, v=1, w=0.5).ending == RUNNING, "met at the very instant"


def test_an_obligation_met_earlier_in_the_step_is_met() -> None:
    """x falls from 1.25 through 1 after 1/4 s; w is 0 after 1/2 s. The next step begins unmet."""
    model = goal("w <= 0 -> goal(x)")
    model.begin(x=1.25, v=-1, w=0.5)
    assert model.step().ending == RUNNING
    assert model.step().ending == FAILED
    assert model.first(x=1, v=-1, w=0).ending == RUNNING, "met at the first instant"
    assert model.first(x=0.99, v=-1, w=0).ending == FAILED


def test_obligations_are_watched_whatever_safety_is() -> None:
    model = goal("w <= 0 -> goal(x)", safety_check="step")
    assert model.first(x=0, v=1, w=0.5).ending == FAILED


def test_due_is_exact_and_met_is_within_the_tolerance() -> None:
    model = goal("w <= 0 -> goal(x)")
    assert model.first(x=1 - 2e-9, v=0, w=1).ending == RUNNING
    assert model.first(x=0, v=0, w=1 + 2**-30).ending == RUNNING
    assert goal("w <= 0 -> goal(x)", tolerance=0).first(x=1 - 2e-9, v=0, w=1).ending == FAILED


def test_an_obligation_waits_where_its_condition_has_no_value() -> None:
    """1/(w - 1/2) passes its pole while w falls from 1 to 0, and is below -3 where w > 1/6."""
    model = goal("1 / (w - 1/2) <= -3 -> goal(x)")
    seen = model.first(x=0, v=0, w=1)
    assert seen.ending == FAILED
    assert goal("1 / (w - 1/2) >= 1/8 & w < 1/8 -> goal(x)").first(x=0, w=1).ending == RUNNING


def test_of_one_predicate_failure_goes_before_success() -> None:
    """Failed on the way, met in the end, and both would end the episode with the same status."""
    model = goal("w <= 0 -> goal(x)", ", on_success=truncate:failure")
    assert model.first(x=0, v=1, w=0.5).ending == ("terminated", "failure", "goal")
    assert model.first(x=0, v=1, w=1).ending == ("truncated", "failure", "goal")


# The forms of an obligation --------------------------------------------------------------------

DUE, MET = "n = {k} & w <= 0", "p{k}(x)"
FORMS = [
    ("{D} -> {P}", True),
    ("!({D}) | {P}", True),
    ("{P} | !({D})", True),
    ("n = {k} -> (w <= 0 -> {P})", True),
    ("n = {k} & w <= 0 & x > -50 -> {P}", True),
    ("!({D} & !{P})", True),
    ("n != {k} | w > 0 | {P}", True),
    ("{D} -> {P} & x > -50", True),
    ("{D} -> ({P} <-> true)", True),
    ("later{k}(x, w, n)", True),
    ("x > -50 & (x < 50 & ({D} -> {P}))", True),
    ("{P}", False),
    ("{P} -> {D}", False),
    ("!({P}) | {D}", False),
    ("{D} -> !{P}", False),
    ("{D} -> x >= 1", False),  # P is matched by its call
]


def form(k: int) -> str:
    text = FORMS[k][0].replace("{D}", DUE).replace("{P}", MET)
    return f"({text.replace('{k}', str(k))})"


def test_which_forms_are_obligations() -> None:
    wanted = [k for k, (text, due) in enumerate(FORMS) if due]
    definitions = "\n".join(
        f"""  /* @progress: on_failure=terminate:failure */ Bool p{k}(Real x) <-> x >= 1;
          Bool later{k}(Real x, Real w, Real n) <-> (n = {k} & w <= 0 -> p{k}(x));"""
        for k in wanted
    )
    model = Both(theorem(definitions, BODY, " & ".join(map(form, wanted)), variables="w n"))
    for k in wanted:
        assert model.first(x=0, w=0.5, n=k).ending == ("terminated", "failure", f"p{k}"), FORMS[k]
        assert model.first(x=0, w=1.5, n=k).ending == RUNNING
        assert model.first(x=1, w=0.5, n=k).ending == RUNNING


@pytest.mark.parametrize("k", [k for k, (_, due) in enumerate(FORMS) if not due])
def test_which_forms_are_none(k: int) -> None:
    definitions = f"/* @progress: on_failure=terminate:failure */ Bool p{k}(Real x) <-> x >= 1;"
    problem = f"true -> [{{ {BODY} }}*] {form(k)}"
    (predicate,) = lowered(problem, definitions, "Real x; Real v; Real t; Real w; Real n;").predicates
    assert predicate.due is None


# No obligation ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("action", "flag"), [("terminate", "terminated"), ("truncate", "truncated")])
def test_without_an_obligation_failure_counts_at_the_time_limit(action: str, flag: str) -> None:
    """With the annotated flag alone, not with that of the time limit."""
    definitions = f"""
      /* @progress: on_failure={action}:failure, on_success=continue:success */
      Bool goal(Real x) <-> x >= 1;
    """
    model = Both(theorem(definitions, BODY, variables="w"), max_episode_steps=3)
    model.begin(x=0)
    assert [model.step().ending for _ in range(3)] == [RUNNING, RUNNING, (flag, "failure", "goal")]
    model.begin(x=2)
    wanted = [("", "success", ""), ("", "success", ""), ("truncated", "none", "time_limit")]
    assert [model.step().ending for _ in range(3)] == wanted


def test_a_status_at_the_time_limit_is_no_ending() -> None:
    definitions = "/* @progress: on_failure=continue:failure */ Bool goal(Real x) <-> x >= 1;"
    model = Both(theorem(definitions, BODY, variables="w"), max_episode_steps=2)
    model.begin(x=0)
    assert [model.step().ending for _ in range(2)] == [RUNNING, ("truncated", "none", "time_limit")]


def test_an_obligation_does_not_count_at_the_time_limit() -> None:
    model = goal("w <= 0 -> goal(x)", max_episode_steps=1)
    assert model.first(x=0, w=9).ending == ("truncated", "none", "time_limit")


def test_the_literal_reading_ends_every_episode_that_is_not_there_yet() -> None:
    for post in ("w <= 0 -> goal(x)", "true"):
        model = goal(post, progress_failure="literal")
        assert model.first(x=0, v=0.5, w=9).ending == FAILED
        assert model.first(x=0, v=1, w=9).ending == RUNNING, "judged after the step alone"
