"""How episodes end and what is said of them (semantics 6), with results worked out by hand."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from both_forms import Both, quick_builds, theorem
from gymnasium.vector import AutoresetMode

import dl2c

BODY = "t := 0; {x' = v, t' = 1 & t <= 1}"
RUNNING = ("", "none", "")

# Which ending wins -----------------------------------------------------------------------------

# Each predicate fires where its own variable is 1. The first of this list that fires wins.
RANKED = [
    ("c", "safety", "on_success=truncate:failure", ("truncated", "failure")),
    ("i", "safety", "on_success=terminate:failure", ("terminated", "failure")),
    ("b", "progress", "on_success=terminate:failure", ("terminated", "failure")),
    ("a", "stability", "on_success=terminate:failure", ("terminated", "failure")),
    ("d", "safety", "on_success=terminate:success", ("terminated", "success")),
    ("e", "progress", "on_success=truncate:success", ("truncated", "success")),
    ("g", "safety", "on_success=terminate:none", ("terminated", "none")),
    ("h", "safety", "on_success=truncate", ("truncated", "none")),
    ("f", "stability", "on_success=truncate:none", ("truncated", "none")),
]


def bit(name: str) -> str:
    """The variable of a predicate."""
    return f"{name}1"


def test_failure_before_success_before_none_then_category_then_declaration() -> None:
    """Every pair and every triple of endings, and all at once; declared in the order of their names."""
    declared = sorted(RANKED)
    definitions = "\n".join(
        f"  /* @{category}: {ending} */ Bool p{name}(Real {bit(name)}) <-> {bit(name)} = 1;"
        for name, category, ending, _ in declared
    )
    model = Both(theorem(definitions, BODY, variables=" ".join(bit(name) for name, *_ in declared)))
    assert model.first().ending == RUNNING
    for count in (1, 2, 3, len(RANKED)):
        for firing in combinations(RANKED, count):
            seen = model.first(**{bit(name): 1.0 for name, *_ in firing})
            name, _, _, (flag, status) = firing[0]
            assert seen.ending == (flag, status, f"p{name}")
            assert seen.success == (status == "success")


# Continue --------------------------------------------------------------------------------------

CHECKPOINTS = """
  /* @progress: on_success=continue:success */ Bool half(Real x) <-> x >= 1;
  /* @stability: on_failure=continue:failure */ Bool slow(Real v) <-> v <= 1;
  /* @progress: on_success=terminate:none */ Bool all(Real x) <-> x >= 4;
  /* @progress: on_success=terminate:success */ Bool more(Real x) <-> x >= 9;
"""


def test_a_continue_status_is_written_only_where_nothing_ends() -> None:
    model = Both(theorem(CHECKPOINTS, BODY), max_episode_steps=3)
    assert model.first(x=0, v=0.5).ending == RUNNING
    assert model.first(x=0.5, v=0.5).ending == ("", "success", "")
    assert model.first(x=-5, v=2).ending == ("", "failure", "")
    assert model.first(x=0, v=2).ending == ("", "failure", ""), "of several the last declared is written"
    seen = model.first(x=3.5, v=0.5)
    assert (seen.ending, seen.success) == (("terminated", "none", "all"), False)
    seen = model.first(x=8.5, v=0.5)
    assert (seen.ending, seen.success) == (("terminated", "success", "more"), True)


def test_a_continue_status_is_no_success_at_the_time_limit() -> None:
    model = Both(theorem(CHECKPOINTS, BODY), max_episode_steps=2)
    model.begin(x=1, v=0)
    first, last = model.step(), model.step()
    assert (first.ending, first.success) == (("", "success", ""), None)
    assert (last.ending, last.success) == (("truncated", "none", "time_limit"), False)


# Other ends ------------------------------------------------------------------------------------


def test_the_time_limit_gives_way_to_predicates() -> None:
    model = Both(theorem(CHECKPOINTS, BODY), max_episode_steps=1)
    assert model.first(x=4, v=0).ending == ("terminated", "none", "all")
    assert model.first(x=0, v=0).ending == ("truncated", "none", "time_limit")
    unlimited = Both(theorem(CHECKPOINTS, BODY), max_episode_steps=0)
    unlimited.begin()
    assert all(unlimited.step().ending == RUNNING for _ in range(20))


def test_a_problem_without_a_loop_ends_after_one_step() -> None:
    text = theorem(CHECKPOINTS, BODY).replace("}*]", "}]")
    model = Both(text)
    seen = model.first(x=1, v=0)
    assert (seen.ending, seen.success) == (("terminated", "none", "end"), False)
    assert model.first(x=9, v=0).ending == ("terminated", "success", "more")


def test_a_deadlock_ends_with_status_none() -> None:
    model = Both(theorem(CHECKPOINTS, "?x <= 1; " + BODY))
    assert model.first(x=0.5, v=1).ending == ("truncated", "none", "deadlock")
    assert model.first(x=0.5, v=3.5).ending == ("terminated", "none", "all")


# Models without annotations --------------------------------------------------------------------

PLAIN = """
Theorem "Plain"
ProgramVariables
  Real x;
  Real v;
  Real t;
End.
Problem
  0 <= x & x <= 1 & -1 <= v & v <= 1
    -> [{ v := v + 1; t := 0; {x' = v, t' = 1 & t <= 1} }*] x <= 2
End.
End.
"""


def test_without_annotations_the_postcondition_is_safety() -> None:
    """From x = 0 and v = -1/2: x is 1/2, then 2, and leaves 2 at once in the third step."""
    model = Both(PLAIN, tolerance=0)
    box = model.env.observation_space
    assert box.shape == (3,) and np.isinf(box.low).all() and np.isinf(box.high).all()
    model.begin(x=0, v=-0.5)
    first, second = model.step(), model.step()
    assert (first.state["x"], first.reward, first.cost, first.ending) == (0.5, 0, 0, RUNNING)
    assert (second.state["x"], second.duration, second.cost) == (2, 1, 0)
    third = model.step()
    assert (third.duration, third.reward, third.cost, third.success) == (0, -1, 1, False)
    assert third.ending == ("terminated", "failure", "postcondition")


def test_a_postcondition_that_fails_on_the_way_ends_the_episode() -> None:
    seen = Both(PLAIN.replace("<= 2", "<= 3/4"), tolerance=0).first(x=0.5, v=0)
    assert seen.duration == pytest.approx(0.25, abs=1e-15)
    assert (seen.reward, seen.postcondition) == (-1, True)


def test_a_diamond_alone_is_progress() -> None:
    model = Both(PLAIN.replace("[{", "<{").replace("*]", "*>").replace("<= 2", ">= 2"))
    model.begin(x=0.5, v=0)
    first, second = model.step(), model.step()
    assert (first.reward, first.ending) == (0, RUNNING)
    assert (second.reward, second.success) == (1, True)
    assert second.ending == ("terminated", "success", "progress")


def test_with_annotations_the_postcondition_ends_nothing() -> None:
    model = Both(theorem("", BODY, "x <= 1"))
    seen = model.first(x=5)
    assert (seen.reward, seen.cost, seen.ending, seen.postcondition) == (0, 0, RUNNING, False)


# Info ------------------------------------------------------------------------------------------

INFO = """
  /* @safety: on_failure=truncate:failure */ Bool low(Real x) <-> x <= 5;
  /* @safety: on_failure=continue:none */ Bool lower(Real x) <-> x <= 1;
  /* @progress: on_success=terminate:success */ Bool slow(Real v) <-> v <= -9;
"""
STARTS: list[tuple[dict[str, float], dict[str, Any]]] = [
    # a state, and what info says after a second of x' = v
    ({"x": 0, "v": 1}, {"status": "none", "reason": "", "cost": 0, "postcondition": True}),
    ({"x": 1, "v": 1}, {"status": "none", "reason": "", "cost": 1, "postcondition": False}),
    ({"x": 9, "v": 0}, {"status": "failure", "reason": "low", "cost": 2, "postcondition": False}),
    ({"x": 9, "v": -9}, {"status": "failure", "reason": "low", "cost": 2, "postcondition": False}),
    ({"x": 1, "v": -9}, {"status": "success", "reason": "slow", "cost": 0, "postcondition": True}),
]


@pytest.mark.parametrize(("state", "wanted"), STARTS)
def test_info(state: dict[str, float], wanted: dict[str, Any]) -> None:
    """`is_success` belongs to the last step alone; so do the flags."""
    model = Both(theorem(INFO, BODY, "x <= 1"), tolerance=0)
    model.begin(**state)
    *_, terminated, truncated, info = model.env.step(0)
    assert {key: info[key] for key in wanted} == wanted
    flags = {"success": (True, False), "failure": (False, True), "none": (False, False)}
    assert (terminated, truncated) == flags[wanted["status"]]
    assert info.get("is_success") == {"success": True, "failure": False, "none": None}[wanted["status"]]


@pytest.mark.parametrize("mode", [AutoresetMode.DISABLED, AutoresetMode.SAME_STEP])
def test_info_of_many_environments(mode: AutoresetMode) -> None:
    """Statuses and reasons are codes; the environments hold the words."""
    with quick_builds():
        envs = dl2c.make_vec(theorem(INFO, BODY, "x <= 1"), len(STARTS), tolerance=0, autoreset_mode=mode)
    assert envs.status_names == {0: "none", 1: "success", 2: "failure"}
    envs.reset(seed=0)
    for i, (state, _) in enumerate(STARTS):
        envs.batch.set_state(i, [state["x"], state["v"], 0.0, 0.0], [])
    _, _, terminated, truncated, infos = envs.step(np.zeros(len(STARTS), np.int64))
    ended = terminated | truncated
    assert ended.tolist() == [False, False, True, True, True] and not (terminated & truncated).any()
    same_step = mode == AutoresetMode.SAME_STEP
    for i, (_, wanted) in enumerate(STARTS):
        info = infos["final_info"] if same_step and ended[i] else infos
        assert info["status"].dtype == np.int8
        assert envs.status_names[int(info["status"][i])] == wanted["status"]
        assert envs.reason_names[int(info["reason"][i])] == wanted["reason"]
        assert (info["cost"][i], info["postcondition"][i]) == (wanted["cost"], wanted["postcondition"])
        if ended[i]:
            assert info["is_success"][i] == (wanted["status"] == "success") and info["_is_success"][i]
        elif not same_step:
            assert not info["_is_success"][i]


def test_a_step_that_blocks_is_rewarded_by_the_shapes_of_its_state() -> None:
    definitions = (
        "/* @safety: penalty=-3, shape={x}, on_failure=terminate:failure */ Bool low(Real x) <-> x <= 1;"
    )
    text = theorem(definitions, "{?v > 0; x := 0; ++ ?v < 0; x := 1;} " + BODY)
    with quick_builds():
        env = dl2c.make(text, on_blocked="terminate", blocked_penalty=-0.5)
    env.reset(options={"state": {"x": 2, "v": 1, "a": 0, "t": 0}})
    _, reward, terminated, truncated, info = env.step(1)
    assert (reward, terminated, truncated) == (2 - 0.5, True, False)
    assert (info["reason"], info["status"], info["cost"], info["duration"]) == ("blocked", "none", 0, 0)
