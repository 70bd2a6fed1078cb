"""What of a step is judged: instants at which it may stop, complete runs, what masks promise.

Each model is valid in dL, or says what has no run; each was once judged otherwise.
"""

import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest
from both_forms import Both, quick_builds, theorem
from emit.test_gym_module import environment_of, imported
from generators.kyx_builder import model_text

import dl2c
from dl2c.configuration import resolve_options
from dl2c.lint.check import examine
from dl2c.options import Options, with_options
from dl2c.pipeline import emit
from dl2c.report.falsify import falsify
from dl2c.source import Source
from dl2c.training.rollout import rollout

RETURNS = model_text(
    "x = 0 -> [{ t := 0; {x' = 1, t' = 1 & t <= 1} x := 0; {t' = 1 & t <= 2} }*] x <= 0",
    variables="Real x; Real t;",
)
"""x is 0 wherever a run may stop, and 1 in the middle of every step."""

FALLS = model_text("x = 5 -> [{x' = -1 & x >= 0} ?x = 0;] x = 0", variables="Real x;")
"""No run but the one that lasts five seconds."""


@pytest.fixture(autouse=True)
def quick() -> Any:
    with quick_builds(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def endings(text: str, **options: Any) -> list[tuple[str, str]]:
    """How ten episodes of twenty random steps at most end."""
    rows = list(rollout("random", text, episodes=10, max_episode_steps=20, **options))
    return [(r["status"], r["reason"]) for r in rows if r["terminated"] or r["truncated"]]


def unfalsified(text: str, target: Any = "safety", **options: Any) -> bool:
    return falsify(text, target=target, episodes=50, steps=5, n_envs=10, **options).episode is None


# What is watched -----------------------------------------------------------------------------


def test_what_is_restored_before_a_step_may_stop_violates_nothing() -> None:
    assert set(endings(RETURNS)) == {("none", "time_limit")}
    assert unfalsified(RETURNS) and unfalsified(RETURNS, "postcondition")
    assert set(endings(RETURNS, safety_check="step")) == {("none", "time_limit")}
    assert set(endings(RETURNS, safety_check="flows")) == {("failure", "postcondition")}


EITHER = (
    "t := 0; { {x' = 1, t' = 1 & t <= 1} ++ {x' = 1, t' = 1 & t <= 1} x := 0; "
    "++ {x' = 1, t' = 1 & t <= 1} ?true; ++ {x' = 1, t' = 1 & t <= 1} {?x >= 0; ++ x := 0;} }"
)
NEAR = "/* @safety: penalty=-3, on_failure={} */ Bool near(Real x) <-> x <= 1/2;"


@pytest.mark.parametrize(("trigger", "ends"), [("terminate:failure", True), ("continue:failure", False)])
def test_which_flows_are_watched_is_decided_path_by_path(trigger: str, ends: bool) -> None:
    model = Both(theorem(NEAR.format(trigger), EITHER), tolerance=0)
    seen = model.first((0, 1), x=0)
    assert (seen.duration, seen.cost, seen.ended) == (0.5 if ends else 1, 1, ends)
    seen = model.first((1, 1), x=0)
    assert (seen.duration, seen.state["x"], seen.cost, seen.ended) == (1, 0, 0, False)
    seen = model.first((3, 1), x=0)
    assert (seen.duration, seen.state["x"], seen.cost, seen.ended) == (1, 0, 0, False)
    assert model.first((2, 1), x=0).cost == 1, "where the step ends it is judged"
    assert model.first((2, 1), x=0).duration == 1


def test_under_flows_the_body_runs_on_after_a_cut() -> None:
    model = Both(theorem(NEAR.format("terminate:failure"), EITHER), tolerance=0, safety_check="flows")
    for choice, x in ((0, 0.5), (1, 0.0), (2, 0.5), (3, 0.0)):
        seen = model.first((choice, 1), x=0)
        assert (seen.duration, seen.state["x"], seen.cost, seen.ended) == (0.5, x, 1, True)


def test_of_a_repeated_flow_only_the_last_one_is_watched() -> None:
    body = "{ t := 0; {x' = 1, t' = 1 & t <= 1} }*"
    model = Both(theorem(NEAR.format("continue:failure").replace("x <= 1/2", "x <= 1/2 | x >= 3/2"), body))
    assert model.first(1, x=0).cost == 1
    seen = model.first(3, x=0)
    assert (seen.state["x"], seen.cost) == (3, 0), "x passes 1/2 to 3/2 in the first two"
    seen = model.first(2, x=-1)
    assert (seen.state["x"], seen.cost) == (1, 1)


def test_a_flow_inside_a_while_loop_is_followed_by_its_test() -> None:
    body = "{?x < 2; t := 0; {x' = 1, t' = 1 & t <= 1}}*; ?!(x < 2);"
    text = theorem(NEAR.format("continue:failure").replace("x <= 1/2", "x <= 1/2 | x >= 2"), body)
    assert Both(text).first(x=0).cost == 0
    assert Both(text, safety_check="flows").first(x=0).cost == 1


GOAL = "/* @progress: on_failure=terminate:failure */ Bool goal(Real x) <-> x >= 2;"


def test_obligations_fall_due_where_a_step_may_stop() -> None:
    """x is 1 when t is 1, and 2 at the end of the step."""
    body = "t := 0; {x' = 1, t' = 1 & t <= 3/2} {x' = 1, t' = 1 & t <= 2} t := 0;"
    text = theorem(GOAL, body, "t >= 1 -> goal(x)")
    assert not Both(text).first(x=0).ended
    assert Both(text, safety_check="flows").first(x=0).ending == ("terminated", "failure", "goal")


def test_flows_that_are_not_watched_need_no_margins() -> None:
    """Nothing is searched along the flow but its domain."""
    sine = "/* @safety: on_failure=terminate:failure */ Bool safe(Real x) <-> sin(x) <= 2;"
    text = model_text(
        "x = 0 & v = 1 -> [{ t := 0; {x' = v, t' = 1 & t <= 1 & x^3 <= 9} x := 0; }*] safe(x)",
        sine,
        "Real x; Real v; Real t;",
    )
    for option, watched in (("continuous", 0), ("flows", 1)):
        (flow,) = dl2c.make(text, safety_check=option).manifest.flows
        assert len([name for name, _ in flow.events if name == "safe (safety)"]) == watched


def test_check_names_the_flow_after_which_a_step_goes_on() -> None:
    def found(**options: Any) -> list[Any]:
        messages = examine(Source("returns.kyx", RETURNS), resolve_options(options))
        return [d for d in messages if d.code == "safety-after-steps"]

    (message,) = found()
    assert message.span.text == "{x' = 1, t' = 1 & t <= 1}"
    assert not found(safety_check="step") and not found(safety_check="flows")


def test_the_old_default_is_a_name_of_the_new_one(tmp_path: Path) -> None:
    with pytest.warns(DeprecationWarning, match="use `safety_check=continuous`"):
        assert with_options(Options(), {"safety_check": "auto"}).safety_check == "continuous"
    file = tmp_path / "model.kyx"
    file.write_text(RETURNS, encoding="utf-8")
    command = [sys.executable, "-m", "dl2c", "check", str(file), "--safety-check", "auto"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "warning: `safety_check=auto` is deprecated: use `safety_check=continuous`" in done.stderr
    written = RETURNS.replace("Problem", "/* @episode: safety_check=auto */ Problem")
    (message,) = [d for d in examine(Source("m.kyx", written), Options()) if d.code == "deprecated-option"]
    assert message.span.text == "auto" and message.help == "write `continuous`"


# Steps without a run -------------------------------------------------------------------------


def test_what_has_no_run_violates_nothing() -> None:
    assert unfalsified(FALLS, dt="0.1") and unfalsified(FALLS, "postcondition", dt="0.1")
    assert unfalsified(FALLS, "failure", dt="0.1", on_blocked="terminate")
    assert endings(FALLS, dt="0.1") == [("none", "deadlock")] * 10


SHAPED = """
  /* @safety: reward=5, penalty=-7, shape={x}, on_failure=terminate:failure */
  Bool safe(Real x) <-> x <= 1;
  /* @stability: reward=50, shape={2 * x} */ Bool low(Real x) <-> x <= 9;
"""
STUCK = "{ ?false; ++ {x' = 1 & x <= 3} ?x <= 0; ++ x := 1 / (x - 2); ++ x := 0; }"


@pytest.mark.parametrize("loops", [True, False])
@pytest.mark.parametrize("on_blocked", ["truncate", "terminate"])
def test_a_step_without_a_run_earns_shapes_in_a_loop_and_else_nothing(loops: bool, on_blocked: str) -> None:
    text = theorem(SHAPED, STUCK, "x <= 1")
    text = text if loops else text.replace("}*]", "}]")
    penalty = -0.25
    model = Both(text, on_blocked=on_blocked, blocked_penalty=penalty)
    for action, reason in ((0, "blocked"), (1, "blocked"), (2, "numerical")):
        model.begin(x=2)
        env = model.env
        _, reward, terminated, truncated, info = env.step(action)
        earned = (6.0 if loops else 0.0) + (penalty if reason == "blocked" else 0)
        assert (reward, info["cost"], info["status"], info["reason"]) == (earned, 0, "none", reason)
        assert info["postcondition"] is not loops, "Q of the kept state; without a loop nothing was violated"
        assert terminated == (reason == "blocked" and on_blocked == "terminate") != truncated
    model.begin(x=2)
    seen = model.step(3)
    assert (seen.reward, seen.cost) == (5 + 50, 0), "a complete run is judged as ever"


@pytest.mark.parametrize("loops", [True, False])
@pytest.mark.parametrize("on_blocked", ["truncate", "terminate"])
def test_plain_python_judges_steps_without_a_run_alike(loops: bool, on_blocked: str, tmp_path: Path) -> None:
    text = theorem(SHAPED, "{ ?x < 0; ++ x := 1 / (x - 2); ++ x := 0; }", "x <= 1")
    text = text.replace("x = x", "x <= 9") if loops else text.replace("}*]", "}]")
    options: dict[str, Any] = {"on_blocked": on_blocked, "blocked_penalty": -0.25}
    given = resolve_options(options)
    plain = environment_of(imported(emit(Source("model.kyx", text), "gym", given, True), tmp_path))()
    compiled = dl2c.make(text, **options)
    for action in range(3):
        for env in (plain, compiled):
            env.reset(options={"state": {"x": 2.0, "v": 0.0, "a": 0.0, "t": 0.0}})
        _, *first, found = plain.step(action)
        _, *second, wanted = compiled.step(action)
        assert first == second
        assert all(found[k] == wanted[k] for k in ("status", "reason", "cost", "postcondition", "blocked"))


def test_interpreter_and_compiled_code_agree_on_steps_without_a_run() -> None:
    for text in (theorem(SHAPED, STUCK, "x <= 1"), theorem(SHAPED, STUCK, "x <= 1").replace("}*]", "}]")):
        model = Both(text)
        for action in range(4):
            model.first(action, x=2)
    model = Both(FALLS, dt="0.1")
    seen = model.first(x=5)
    assert (seen.reward, seen.cost, seen.ending) == (0, 0, ("truncated", "none", "deadlock"))
    assert seen.postcondition


@pytest.mark.parametrize(("first", "second"), [("failure", "success"), ("success", "failure")])
def test_failure_goes_before_success_where_nothing_ends(first: str, second: str) -> None:
    text = f"""Theorem "both"
Definitions
  /* @safety: penalty=-1, on_failure=continue:{first} */
  Bool p(Real x) <-> x < 0;
  /* @safety: penalty=-1, on_failure=continue:{second} */
  Bool q(Real x) <-> x < 0;
End.
ProgramVariables Real x; End.
Problem x = 1 -> [{{ x := x + 1; }}*] (p(x) & q(x)) End.
End."""
    env: Any = dl2c.make(text, default_bound="-10:10")
    env.reset(seed=0)
    info = env.step(env.action_space.sample())[4]
    assert info["status"] == "failure" and info["cost"] == 2
