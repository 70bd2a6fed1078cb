"""What of a step is judged: instants at which it may stop, complete runs, what masks promise.

Each model is valid in dL, or says what has no run; each was once judged otherwise.
"""

import subprocess
import sys
import warnings
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from both_forms import Both, quick_builds, theorem
from differential import run_models
from kyx_builder import lowered, model_text
from random_models import random_model, random_program

import dl2c
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.ir.model import Model
from dl2c.lint.check import examine
from dl2c.options import Options, UnknownOption, with_options
from dl2c.pipeline import resolve_options
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
    """The condition is no polynomial along the first flow, which stays exact all the same."""
    sine = "/* @safety: on_failure=terminate:failure */ Bool safe(Real x) <-> sin(x) <= 2;"
    text = model_text(
        "x = 0 & v = 1 -> [{ t := 0; {x' = v, t' = 1 & t <= 1 & x^3 <= 9} x := 0; }*] safe(x)",
        sine,
        "Real x; Real v; Real t;",
    )
    assert [f.kernel for f in dl2c.make(text).manifest.flows] == ["exact"]
    assert [f.kernel for f in dl2c.make(text, safety_check="flows").manifest.flows] != ["exact"]


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


def test_interpreter_and_compiled_code_agree_on_steps_without_a_run() -> None:
    for text in (theorem(SHAPED, STUCK, "x <= 1"), theorem(SHAPED, STUCK, "x <= 1").replace("}*]", "}]")):
        model = Both(text)
        for action in range(4):
            model.first(action, x=2)
    model = Both(FALLS, dt="0.1")
    seen = model.first(x=5)
    assert (seen.reward, seen.cost, seen.ending) == (0, 0, ("truncated", "none", "deadlock"))
    assert seen.postcondition


# Flows without a clock -----------------------------------------------------------------------


def once(motion: str, assumed: str, names: str = "x", **options: Any) -> Any:
    """The end of the only step of a problem without a loop: its state, duration and reason."""
    declared = "".join(f"Real {n}; " for n in names.split())
    env = dl2c.make(model_text(f"{assumed} -> [{motion}] true", variables=declared), **options)
    env.reset(seed=0)
    *_, info = env.step(0)
    return env.state, info["duration"], info["reason"]


def test_a_flow_without_clock_or_loop_lasts_to_the_end_of_its_domain() -> None:
    seen = Both(FALLS).first(x=5)
    assert (seen.state["x"], seen.duration, seen.cost) == (0, 5, 0)
    assert seen.ending == ("terminated", "none", "end") and seen.postcondition
    assert unfalsified(FALLS) and endings(FALLS) == [("none", "end")] * 10


@pytest.mark.parametrize(
    ("equations", "domain", "state", "duration"),
    [
        ("x' = -1", "x >= 0", {"x": 5}, 5),  # straight-line code
        ("x' = -1", "x > 0", {"x": 5}, 5),
        ("x' = -1", "x >= -2000", {"x": 5}, 0.1),  # not met in time
        ("x' = -1", "x >= -995", {"x": 5}, 1000),  # just in time
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 4, "a": -2}, 2),
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 4, "a": 2}, 0.1),
        ("x' = v, v' = a", "v >= 0", {"x": 0, "v": 0, "a": -2}, 0),
        ("x' = v, v' = a", "v >= 0 & x <= 3", {"x": 0, "v": 4, "a": -2}, 1),
        ("x' = v, v' = a", "x^2 <= 100 | v <= -9", {"x": 0, "v": 0, "a": 2}, 10**0.5),  # roots isolated
        ("x' = v, v' = a", "x^2 <= 100 | v <= -9", {"x": 0, "v": 0, "a": 0}, 0.1),
        ("x' = v, v' = a", "x^3 <= 64 & v >= -1", {"x": 0, "v": 2, "a": 0}, 2),
        ("x' = -1", "v >= 0", {"x": 5, "v": 1}, 0.1),  # nothing moves it
        ("x' = 10^98, v' = -1", "v >= 0", {"x": 0, "v": 200}, 0.1),  # x gets too large before
    ],
)
def test_when_polynomial_flows_without_a_clock_end(
    equations: str, domain: str, state: dict[str, float], duration: float
) -> None:
    text = (
        theorem("", f"{{{equations} & {domain}}}").replace("}*]", "}]").replace("[-100:100]", "[-9999:9999]")
    )
    seen = Both(text).first(**state)
    assert seen.duration == pytest.approx(duration, abs=1e-12)


@pytest.mark.parametrize("integrator", ["auto", "cvodes", "dopri5"])
@pytest.mark.parametrize(
    ("equations", "domain", "start", "duration"),
    [
        ("x' = -x", "x >= 1", "x = 5", 1.6094379124341003),
        ("x' = -x", "x >= -1", "x = 5", 0.1),
        ("x' = -x * x", "x >= 1/100", "x = 1", 99),
        ("x' = x * x", "x >= -1", "x = 1", 0.1),  # no solution beyond one second
    ],
)
def test_when_other_flows_without_a_clock_end(
    integrator: str, equations: str, domain: str, start: str, duration: float
) -> None:
    state, lasted, reason = once(f"{{{equations} & {domain}}}", start, integrator=integrator)
    assert (lasted, reason) == (pytest.approx(duration, rel=1e-6), "end")
    assert duration == 0.1 or state["x"] == (1 if "x >= 1" in domain and "/" not in domain else 0.01)


def test_a_dt_is_a_cap_and_max_flow_the_patience() -> None:
    motion, start = "{x' = -1 & x >= 0}", "x = 5"
    assert once(motion, start)[1] == 5
    assert once(motion, start, dt=2)[1] == 2
    assert once(motion, start, max_flow=4)[1] == pytest.approx(0.1)
    assert once(motion, start, max_flow=5)[1] == 5
    assert once(motion, "x = 1/20", max_flow="0.01")[1] == 0.05, "it ends with its domain even so"
    assert once("{x' = -1}", start)[1] == pytest.approx(0.1)
    with pytest.raises(UnknownOption, match="must be positive"):
        with_options(Options(), {"max_flow": 0})
    looped = lowered("x = 5 -> [{ {x' = -1 & x >= 0} }*] true", variables="Real x;")
    assert [(f.cap, f.reach) for f in looped.flows] == [(Fraction(1, 10), None)]


@pytest.mark.parametrize("integrator", ["auto", "dopri5"])
def test_watches_count_on_the_motion_that_is_taken(integrator: str) -> None:
    """x leaves 3 on the way to an end that is out of reach."""
    low = "/* @safety: on_failure=terminate:failure */ Bool low(Real x) <-> x <= 3;"
    for domain, cost, duration in (("x <= 9", 1, 1), ("x <= 99999", 0, 0.1)):
        text = model_text(f"x = 0 -> [{{x' = 3 & {domain}}}] low(x)", low, "Real x;")
        env = dl2c.make(text, integrator=integrator)
        env.reset(seed=0)
        *_, info = env.step(0)
        assert (info["cost"], info["duration"]) == (cost, pytest.approx(duration, abs=1e-6))


@pytest.mark.parametrize("integrator", ["auto", "dopri5"])
def test_lanes_follow_flows_without_a_clock_alike(integrator: str) -> None:
    text = model_text("0 <= x & x <= 2000 -> [{x' = -1 & x >= 0}] true", variables="Real x;")
    envs = dl2c.make_vec(text, 70, integrator=integrator)
    envs.reset(seed=3)
    *_, infos = envs.step(np.zeros(70, np.int64))
    for k in range(0, 70, 9):
        env = dl2c.make(text, integrator=integrator)
        env.reset(seed=3 + k)
        *_, info = env.step(0)
        assert info["duration"] == infos["duration"][k]
    assert {True, False} == set((infos["duration"] > 0.2).tolist())


def test_an_export_in_plain_python_says_that_it_cannot() -> None:
    from dl2c.pipeline import emit

    with pytest.raises(dl2c.CompileError, match="plain Python"):
        emit(Source("falls.kyx", FALLS), "gym", resolve_options({}), True)


# Masks ---------------------------------------------------------------------------------------

AFTERWARDS = "{ v := 1; ++ v := -1; ++ v := 3; } t := 0; {x' = v, t' = 1 & t <= 1} ?x <= 2 & x >= 0;"
BOTH_DEPTHS = [("flow", [1, 1, 1]), ("step", [1, 0, 0])]


@pytest.mark.parametrize(("depth", "wanted"), BOTH_DEPTHS)
def test_masks_of_depth_step_see_tests_after_the_motion(depth: str, wanted: list[int]) -> None:
    model = Both(theorem("", AFTERWARDS), mask_depth=depth)
    model.begin(x=0)
    assert model.env.action_masks().astype(int).tolist() == wanted
    assert model.first(0, x=0).state["x"] == 1
    assert model.env.action_masks().astype(int).tolist() == ([1, 1, 0] if depth == "step" else [1, 1, 1])


def test_masked_steps_of_such_alternatives_never_block() -> None:
    text = theorem("", AFTERWARDS.replace("?x", "x := x + 1/2; ?x")).replace("x = x", "0 <= x & x <= 2")
    env = dl2c.make(text, mask_depth="step", max_episode_steps=0)
    blocked = dl2c.make(text, max_episode_steps=0)
    counts = [0, 0]
    for which, chosen in enumerate((env, blocked)):
        chosen.action_space.seed(1)
        _, info = chosen.reset(seed=1)
        for _ in range(300):
            _, _, terminated, truncated, info = chosen.step(
                chosen.action_space.sample(mask=info["action_mask"])
            )
            counts[which] += info["blocked"]
            if terminated or truncated:
                _, info = chosen.reset()
    assert counts[0] == 0 < counts[1]


def test_every_door_has_the_same_masks() -> None:
    text = theorem("", AFTERWARDS).replace("x = x", "0 <= x & x <= 2")
    single = dl2c.make(text, mask_depth="step")
    vector = dl2c.make_vec(text, 5, mask_depth="step")
    stable = Dl2cVecEnv(text, 5, mask_depth="step")
    vector.reset(seed=7)
    stable.seed(7)
    stable.reset()
    wanted = []
    for k in range(5):
        single.reset(seed=7 + k)
        wanted.append(single.action_masks().tolist())
    assert vector.action_masks().tolist() == wanted
    assert np.array(stable.env_method("action_masks")).tolist() == wanted
    assert len({tuple(row) for row in wanted}) > 1


def test_deadlock_uses_the_same_mask() -> None:
    body = "t := 0; {x' = 1, t' = 1 & t <= 1} ?x <= 2;"
    model = Both(theorem("", body), mask_depth="step")
    seen = model.first(x=1)
    assert (seen.state["x"], seen.ending) == (2, ("truncated", "none", "deadlock"))
    assert not Both(theorem("", body)).first(x=1).ended


def test_masks_of_depth_step_do_not_follow_inputs_chance_and_chosen_durations() -> None:
    chosen = "{ v := 1; ++ v := *; ?-1 <= v & v <= 1; } " + AFTERWARDS.split("}", 1)[1]
    env = dl2c.make(theorem("", chosen), mask_depth="step")
    state = dict.fromkeys(("x", "v", "a", "t"), 0.0)
    env.reset(options={"state": state | {"x": 1.5}})
    assert env.action_masks().tolist() == [False, True]
    env = dl2c.make(theorem("", AFTERWARDS), mask_depth="step", duration="agent")
    env.reset(options={"state": state})
    assert env.action_masks().all()
    drawn = AFTERWARDS.replace("t := 0;", "t := 0; /* @choice: role=env */ {a := 0; ++ a := 1;}")
    env = dl2c.make(theorem("", drawn), mask_depth="step")
    env.reset(options={"state": state})
    assert env.action_masks().all()


def test_decisions_after_the_motion_are_masked_too() -> None:
    body = "t := 0; {x' = 1, t' = 1 & t <= 1} { ?x <= 1; v := 1; ++ ?x >= 1; v := 2; ++ ?x >= 9; v := 3; }"
    model = Both(theorem("", body), mask_depth="step")
    model.begin(x=0)
    assert model.env.action_masks().tolist() == [True, True, False]
    model.begin(x=-0.5)
    assert model.env.action_masks().tolist() == [True, False, False]


def test_info_says_how_deep_masks_look(tmp_path: Path) -> None:
    file = tmp_path / "model.kyx"
    file.write_text(theorem("", AFTERWARDS), encoding="utf-8")
    for depth, words in (("flow", "up to the first motion"), ("step", "to the end of a step")):
        command = [sys.executable, "-m", "dl2c", "info", str(file), "--mask-depth", depth]
        shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert words in shown and f"mask_depth={depth}" in shown


# Interpreter and compiled code ---------------------------------------------------------------


def judged(seed: int) -> Model:
    """A random model under random options of this page."""
    return varied(random_model(seed), Random(seed))


def judged_program(seed: int) -> Model:
    """Likewise with loops in a step and decisions of the environment."""
    return varied(random_program(seed), Random(seed))


def varied(model: Model, rng: Random) -> Model:
    loops = rng.random() < 0.6
    flows = model.flows
    if not loops:
        reach = rng.choice((Fraction(1, 2), Fraction(3), Fraction(50)))
        flows = tuple(f if f.horizons else replace(f, cap=Fraction(1, 10), reach=reach) for f in flows)
    return replace(
        model,
        flows=flows,
        loops=loops,
        continuous=rng.random() < 0.8,
        everywhere=rng.random() < 0.3,
        mask_depth=rng.choice(("flow", "step", "step")),
    )


@pytest.mark.parametrize(
    "seeds", [range(8), pytest.param(range(8, 120), marks=pytest.mark.slow)], ids=["some", "many"]
)
def test_both_forms_agree_whatever_is_watched_and_masked(seeds: range, tmp_path: Path) -> None:
    _, total = run_models(seeds, 40, tmp_path, judged)
    _, more = run_models(seeds, 20, tmp_path, judged_program, episodes=True)
    assert total["steps"] > 100 and more["steps"] > 20
    assert (
        len(seeds) < 20 or min((total + more)[k] for k in ("blocked", "failed", "deadlock", "numerical")) > 0
    )
