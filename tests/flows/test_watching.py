"""Safety and obligations along flows (semantics 6), with results worked out by hand."""

import pytest
from both_forms import Both, theorem
from generators.kyx_builder import lowered

from dl2c.flows.watch import watches_along
from dl2c.ir.model import TRUE, Model

UP_AND_DOWN = "t := 0; {x' = v, v' = a, t' = 1 & t <= 1}"
"""From x = 0, v = 1 with a = -2: x = t - t^2, which is 3/16 at t = 1/4 and 3/4, 1/4 at t = 1/2, 0 at 1."""
START = {"x": 0.0, "v": 1.0, "a": -2.0}


def below(condition: str, on_failure: str = "terminate:failure") -> str:
    ending = f", on_failure={on_failure}" if on_failure else ""
    return f"/* @safety: reward=1, penalty=-3{ending} */ Bool below(Real x) <-> ({condition});"


# Safety --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("on_failure", "flag"), [("terminate:failure", "terminated"), ("truncate:failure", "truncated")]
)
def test_a_violation_on_the_way_ends_the_flow_where_it_ends_the_episode(on_failure: str, flag: str) -> None:
    model = Both(theorem(below("x <= 3/16", on_failure), UP_AND_DOWN, "x <= 3/16"), tolerance=0)
    seen = model.first(**START)
    assert seen.duration == 0.25
    assert seen.state == {"x": 3 / 16, "v": 0.5, "a": -2, "t": 0.25}
    assert (seen.reward, seen.cost, seen.ending) == (-3, 1, (flag, "failure", "below"))
    assert seen.postcondition, "Q is judged on the state alone"
    assert seen.success is False


@pytest.mark.parametrize(
    ("on_failure", "status"), [("", "none"), ("continue:failure", "failure"), ("continue:success", "success")]
)
def test_a_violation_that_ends_nothing_is_remembered_to_the_end_of_the_step(
    on_failure: str, status: str
) -> None:
    """The state after the step is good again; the penalty, the cost and on_failure say otherwise."""
    model = Both(theorem(below("x <= 3/16", on_failure), UP_AND_DOWN), tolerance=0)
    seen = model.first(**START)
    assert (seen.duration, seen.state["x"]) == (1, 0)
    assert (seen.reward, seen.cost, seen.ending) == (-3, 1, ("", status, ""))
    model.begin(x=0, v=0, a=0)
    again = model.step()
    assert (again.reward, again.cost, again.ending) == (1, 0, ("", "none", "")), "a step forgets the last"


def test_safety_of_the_step_looks_at_its_end_only() -> None:
    model = Both(theorem(below("x <= 3/16"), UP_AND_DOWN), tolerance=0, safety_check="step")
    seen = model.first(**START)
    assert (seen.duration, seen.reward, seen.cost, seen.ended) == (1, 1, 0, False)
    seen = model.first(x=0, v=1, a=0)
    assert (seen.duration, seen.reward, seen.cost) == (1, -3, 1)
    assert seen.ending == ("terminated", "failure", "below")


@pytest.mark.parametrize(
    ("body", "last"),
    [
        (UP_AND_DOWN, {0}),
        ("{a := 1; ++ a := 2;}" + UP_AND_DOWN, {0}),
        ("{ {x' = 1 & x <= 9} ++ v := 1; {x' = v & x <= 9} }", {0, 1}),
        ("if (x > 0) { {x' = 1 & x <= 9} } else { {x' = 2 & x <= 9} }", {0, 1}),
        ("{x' = 1 & x <= 9} t := 0; {x' = 2 & x <= 9}", {1}),
        ("t := 0;", set[int]()),
        ("{x' = 1 & x <= 9} v := 0;", set[int]()),
        ("{x' = 1 & x <= 9} ?x > 0;", set[int]()),
        ("{ {x' = 1 & x <= 9} ++ v := 1; }", {0}),
        ("if (x > 0) { {x' = 1 & x <= 9} }", {0}),
        ("{ {x' = 1 & x <= 9} ++ {x' = 2 & x <= 9} v := 1; }", {0}),
        ("{x' = 1 & x <= 9} { ?x > 0; ++ v := 1; }", set[int]()),
    ],
)
def test_safety_is_watched_along_flows_with_which_a_step_may_end(body: str, last: set[int]) -> None:
    def model_under(chosen: str) -> Model:
        problem, options = f"x = 0 -> [{{ {body} }}*] below(x)", {"safety_check": chosen}
        return lowered(problem, below("x <= 3/16"), "Real x; Real v; Real a; Real t;", options=options)

    flows = range(body.count("'") - body.count("t' =") - body.count("v' ="))
    for chosen, wanted in (("continuous", last), ("step", set[int]()), ("flows", set(flows))):
        model = model_under(chosen)
        assert {k for k in flows if any(w.stays != TRUE for w in watches_along(model, k))} == wanted
    with pytest.warns(DeprecationWarning, match="use `safety_check=continuous`"):
        assert model_under("auto") == model_under("continuous")


def test_after_a_cut_the_rest_of_the_body_runs() -> None:
    """Assignments, and flows of their own length; nothing of the rest is skipped."""
    body = UP_AND_DOWN + " n := n + 1; m := 0; {w' = 2, m' = 1 & m <= 3}"
    text = theorem(below("x <= 3/16"), body, variables="n m w")
    seen = Both(text, tolerance=0, safety_check="flows").first(**START)
    assert seen.state == {"x": 3 / 16, "v": 0.5, "a": -2, "t": 0.25, "n": 1, "m": 3, "w": 6}
    assert (seen.duration, seen.cost, seen.ending) == (3.25, 1, ("terminated", "failure", "below"))
    seen = Both(text, tolerance=0).first(**START)
    assert (seen.duration, seen.state["x"], seen.cost, seen.ended) == (4, 0, 0, False)


def test_a_violation_on_the_second_of_two_flows() -> None:
    """w rises to 2 in one second; then x = t - t^2 is cut at t = 1/4."""
    body = "m := 0; {w' = 2, m' = 1 & m <= 1} " + UP_AND_DOWN
    model = Both(theorem(below("x <= 3/16"), body, variables="m w"), tolerance=0)
    seen = model.first(**START)
    assert (seen.duration, seen.state["w"], seen.state["t"], seen.cost) == (1.25, 2, 0.25, 1)


def test_a_violation_on_the_first_of_two_flows_is_remembered() -> None:
    body = UP_AND_DOWN + " m := 0; {w' = 2, m' = 1 & m <= 1}"
    text = theorem(below("x <= 3/16", "continue:failure"), body, variables="m w")
    seen = Both(text, tolerance=0, safety_check="flows").first(**START)
    assert (seen.duration, seen.state["x"], seen.reward, seen.cost) == (2, 0, -3, 1)


# Conditions on x = t - t^2 and v = 1 - 2 t, and when each is first violated; None for never.
VIOLATIONS: list[tuple[str, float | None]] = [
    ("x <= 1/4", None),  # touches the bound at t = 1/2
    ("x < 1/4", 0.5),
    ("x != 1/4", 0.5),
    ("x >= 0", None),  # reaches it again at the end
    ("x > 0", 0),  # false at the first instant, and at the last
    ("x <= 0", 0),  # leaves at once
    ("x != 0", 0),
    ("t < 1", 1),  # false at the last instant alone
    ("t != 1/4", 0.25),
    ("!(x >= 3/16 & v >= 0)", 0.25),
    ("x <= 3/16 | v <= 0", 0.25),
    ("x <= 3/16 | v >= 0", 0.5),  # violated between t = 1/2 and t = 3/4 only
    ("x <= 1/4 & v >= -1/2", 0.75),
    ("abs(x - 1/8) <= 1/16", 0),
    ("abs(v) <= 1/2 | x < 3/16", None),
    ("abs(v) < 1/2 | x < 3/16", 0.25),
    ("min(x, 1/8) <= 1/16 | t <= 1/4", 0.25),
    ("max(x, 1/8) < 1/4", 0.5),
    ("x^3 <= 27/4096", 0.25),  # degree 6 in time
    ("1 / (x + 13/16) >= 1", 0.25),
    ("1 / (t - 1/4) < 0", 0.25),  # has no value there
]
MANY = "\n".join(
    f"  /* @safety: on_failure=terminate:failure */ Bool p{k}(Real x, Real v, Real t, Real n) <-> "
    f"(n = {k} -> ({condition}));"
    for k, (condition, _) in enumerate(VIOLATIONS)
)


@pytest.fixture(scope="module")
def many() -> Both:
    return Both(theorem(MANY, UP_AND_DOWN, variables="n"), tolerance=0)


@pytest.mark.parametrize("k", range(len(VIOLATIONS)), ids=[condition for condition, _ in VIOLATIONS])
def test_where_a_condition_is_first_violated(many: Both, k: int) -> None:
    """A flow may touch a closed bound but not an open one; at the first and the last instant too."""
    _, cut = VIOLATIONS[k]
    seen = many.first(**START, n=k)
    if cut is None:
        assert (seen.duration, seen.cost, seen.ended) == (1, 0, False)
    else:
        assert seen.duration == pytest.approx(cut, abs=1e-12)
        assert (seen.cost, seen.reason) == (1, f"p{k}")


def test_a_violation_at_the_first_instant_alone() -> None:
    model = Both(theorem(below("x > 0", "continue:failure"), UP_AND_DOWN), tolerance=0)
    seen = model.first(x=0, v=1, a=0)
    assert (seen.duration, seen.state["x"], seen.reward, seen.cost) == (1, 1, -3, 1)


def test_a_flow_without_time_is_watched_at_its_one_instant() -> None:
    """The domain ends the flow at once. x is good again after it."""
    body = "x := x + 10; {x' = 1 & x <= 10} x := x - 10;"
    model = Both(theorem(below("x <= 5", "continue:failure"), body), safety_check="flows")
    seen = model.first(x=0)
    assert (seen.duration, seen.state["x"], seen.reward, seen.cost) == (0, 0, -3, 1)
    assert Both(theorem(below("x <= 5"), body)).first(x=0).cost == 0, "the step ends with no flow"


def test_the_first_violation_that_ends_the_episode_cuts() -> None:
    """`low` fails at t = 1/4 and ends nothing, `mid` cuts at t = 1/2, `high` would fail at t = 3/4."""
    definitions = """
      /* @safety: penalty=-1, on_failure=continue:failure */ Bool low(Real x) <-> x <= 1/4;
      /* @safety: penalty=-20, on_failure=terminate:failure */ Bool mid(Real x) <-> x <= 1/2;
      /* @safety: penalty=-300, on_failure=terminate:failure */ Bool high(Real x) <-> x <= 3/4;
    """
    seen = Both(theorem(definitions, UP_AND_DOWN), tolerance=0).first(x=0, v=1, a=0)
    assert (seen.duration, seen.reward, seen.cost) == (0.5, -21, 2)
    assert seen.ending == ("terminated", "failure", "mid")


def test_a_condition_without_a_value_is_violated() -> None:
    """1/x at x = 0, reached at t = 1/2; a/v where v never moves from 0, at once."""
    passes = Both(theorem(below("1/x < 0 | x > 0"), "t := 0; {x' = v, t' = 1 & t <= 1}"), tolerance=0)
    seen = passes.first(x=-0.5, v=1)
    assert (seen.duration, seen.cost) == (pytest.approx(0.5, abs=1e-9), 1)
    stays = below("x + a / v <= 5").replace("Real x)", "Real x, Real a, Real v)")
    model = Both(theorem(stays, "t := 0; {x' = 1, t' = 1 & t <= 1}"))
    assert model.first(a=1, v=1).cost == 0
    seen = model.first(a=1, v=0)
    assert (seen.duration, seen.cost, seen.reason) == (0, 1, "below")


@pytest.mark.parametrize("tolerance", [0.0, 1e-9, 1e-3])
def test_forced_acceleration_ends_at_the_closed_form(tolerance: float) -> None:
    """x + v*t + a*t^2/2 = m, by the quadratic formula; m is 1 and the slack where the flow begins."""
    text = theorem(below("x <= 1"), "t := 0; {x' = v, v' = a, t' = 1 & t <= 50}", "below(x)")
    model = Both(text, tolerance=str(tolerance))
    for x, v, a in ((0, 1, 2), (0.3, 0, 1.5), (-2, 3, 0.1), (0.99, 0.125, 7), (1, 0, 1)):
        bound = 1 + tolerance * (1 + abs(x) + 1)
        time = ((v * v + 2 * a * (bound - x)) ** 0.5 - v) / a
        seen = model.first(x=x, v=v, a=a)
        assert seen.duration == pytest.approx(time, abs=1e-9)
        assert seen.state["x"] == pytest.approx(bound, abs=1e-9)
        assert (seen.cost, seen.ending) == (1, ("terminated", "failure", "below"))
