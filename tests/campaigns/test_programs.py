"""Steps of random programs are what the enumeration of their runs says.

A quick form runs with all tests; `make test-events` runs the slow one. DL2C_PROGRAMS says how many programs,
DL2C_SEED which, DL2C_PROGRAM only one of them.
"""

import os
from collections import Counter
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
import pytest
from oracles.judgement_of_steps import Outcome, agreed
from oracles.random_programs import Trial, draw_state, draw_trial
from oracles.run_enumeration import State, deadlocked
from oracles.small_programs import choices
from oracles.truth_in_time import Undecided

import dl2c

PROGRAMS = int(os.environ.get("DL2C_PROGRAMS", "500"))
SEED = int(os.environ.get("DL2C_SEED", "7"))
ONLY = os.environ.get("DL2C_PROGRAM")
QUICK, BATCH = 9, 25
EPISODES, STEPS = 12, 5


def action(env: Any, request: tuple[int, ...]) -> Any:
    if len(request) < 2:
        return request[0] if request else env.action_space.sample()
    return np.array(request)


def differences(trial: Trial, told: Outcome, env: Any, result: tuple[Any, ...]) -> list[str]:
    """What a step did otherwise than told."""
    _, reward, terminated, truncated, info = result
    near = 1e-9 if trial.rules.tolerance == 0 else 4e-6
    numbers = {name: (env.state[name], told.state.values[name]) for name in told.state.values}
    numbers |= {"duration": (info["duration"], told.duration), "reward": (reward, told.reward)}
    found = [
        f"{name} is {is_}, should be {float(should)}"
        for name, (is_, should) in numbers.items()
        if not abs(is_ - float(should)) <= near * (1 + abs(float(should)))
    ]
    words = {
        "blocked": (info["blocked"], told.blocked),
        "cost": (info["cost"], told.cost),
        "terminated": (terminated, told.terminated),
        "truncated": (truncated, told.truncated),
        "status": (info["status"], told.status),
        "reason": (info["reason"], told.reason),
    }
    if told.ended() and told.status is not None:
        words["is_success"] = (info["is_success"], told.status == "success")
    found += [
        f"{name} is {is_!r}, should be {should!r}"
        for name, (is_, should) in words.items()
        if should is not None and is_ != should
    ]
    return found


def following(state: State, env: Any) -> State:
    """The state to go on from: what the environment has, exactly, rough where a rounding was met."""
    values = {name: Fraction(env.state[name]) for name in state.values}
    apart = {name for name in values if values[name] != state.values[name]}
    return State(values, state.rough | frozenset(apart))


def episode(trial: Trial, env: Any, random: Random, counts: Counter[str]) -> str:
    """What went wrong, or nothing."""
    state = State(draw_state(random))
    sizes = [len(c.alternatives) for c in sorted(choices(trial.problem.body), key=lambda c: c.number)]
    start = {name: float(value) for name, value in state.values.items()}
    history = [f"from {start}"]
    stuck = deadlocked(trial.problem, state)
    try:
        env.reset(options={"state": start})
    except RuntimeError:
        counts["starts without a run"] += 1
        return "" if stuck else f"{history[0]}: no run is said to be possible"
    if stuck:
        return f"{history[0]}: a run is said to be possible"
    for number in range(1, STEPS + 1):
        request = tuple(random.randrange(size) for size in sizes)
        told = agreed(trial.problem, state, request, trial.rules, number)
        result = env.step(action(env, request))
        counts["steps"] += 1
        counts["blocked"] += told.blocked
        counts["cut or failed"] += told.cost > 0
        counts[f"ended: {(told.reason or 'left open').rstrip('0123456789_')}"] += told.ended()
        history.append(f"request {list(request)}")
        if wrong := differences(trial, told, env, result):
            return f"{', '.join(history)}: {'; '.join(wrong)}"
        if told.ended():
            return ""
        state = following(told.state, env)
    return ""


def try_program(place: int, counts: Counter[str]) -> list[str]:
    trial = draw_trial(SEED, place)
    env: Any = dl2c.make(str(trial.problem), **trial.options)
    random = Random(f"{SEED} {place} episodes")
    found: list[str] = []
    for _ in range(EPISODES):
        try:
            wrong = episode(trial, env, random, counts)
        except Undecided as reason:
            counts[f"undecided: {reason}"] += 1
            continue
        found += [wrong] if wrong else []
    env.close()
    test = "tests/campaigns/test_programs.py -k slow_form"
    command = f"DL2C_SEED={SEED} DL2C_PROGRAM={place} python -m pytest {test}"
    return [f"{trial}\n{found[0]}\n({len(found)} of {EPISODES} episodes)\n{command}\n"] if found else []


def run_programs(places: range) -> None:
    counts, wrong = Counter[str](), list[str]()
    for place in places:
        wrong += try_program(place, counts)
    print(f"\nseed {SEED}, programs {places.start} to {places.stop - 1}: {dict(sorted(counts.items()))}")
    assert not wrong, f"{len(wrong)} of {len(places)} programs\n" + "\n".join(wrong[:3])
    undecided = sum(n for name, n in counts.items() if name.startswith("undecided"))
    assert len(places) < BATCH or undecided < counts["steps"] / 10


@pytest.mark.parametrize("first", range(0, QUICK, 3))
def test_programs_quick_form(first: int) -> None:
    run_programs(range(first, first + 3))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, PROGRAMS, BATCH) if ONLY is None else [int(ONLY)])
def test_programs_slow_form(first: int) -> None:
    run_programs(range(first, min(first + BATCH, PROGRAMS) if ONLY is None else first + 1))
