"""Masks that follow alternatives to the end of a step (`mask_depth=step`)."""

import subprocess
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from both_forms import Both, quick_builds, theorem
from differential import run_models
from generators.random_models import random_model, random_program
from selection import few_and_many

import dl2c
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.ir.model import Model

AFTERWARDS = "{ v := 1; ++ v := -1; ++ v := 3; } t := 0; {x' = v, t' = 1 & t <= 1} ?x <= 2 & x >= 0;"
BOTH_DEPTHS = [("flow", [1, 1, 1]), ("step", [1, 0, 0])]


@pytest.fixture(autouse=True)
def quick() -> Any:
    with quick_builds(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


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
    wanted: list[list[bool]] = []
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


@pytest.mark.parametrize("seeds", few_and_many((5, 6, 7), range(120)))
def test_both_forms_agree_whatever_is_watched_and_masked(seeds: Sequence[int], tmp_path: Path) -> None:
    _, total = run_models(seeds, 40, tmp_path, judged)
    _, more = run_models(seeds, 20, tmp_path, judged_program, episodes=True)
    assert total["steps"] > 100 and more["steps"] > 20
    assert (
        len(seeds) < 20 or min((total + more)[k] for k in ("blocked", "failed", "deadlock", "numerical")) > 0
    )
