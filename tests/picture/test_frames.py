"""Frames of scenes: what they need, what they cost, and that they change nothing."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env

import dl2c
from dl2c.env.opening import source_of


@pytest.fixture(autouse=True)
def compiled_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures take their time outside of the model's C."""
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


def running(model: str, steps: int = 0) -> Any:
    """An environment after some steps."""
    env = dl2c.make(model, render_mode="rgb_array")
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(steps):
        env.step(env.action_space.sample())
    return env


# As environments ------------------------------------------------------------------


def test_gymnasiums_checker_accepts_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    check_env(gym.make("dl2c:dl2c/StaticSafetyLine-v0", render_mode="rgb_array").unwrapped)


def test_neither_a_display_nor_matplotlib_is_needed() -> None:
    script = (
        "import sys, dl2c; env = dl2c.make('example:dubins', render_mode='rgb_array'); env.reset(seed=0); "
        "env.step([0.0]); print(env.render().shape, 'matplotlib' in sys.modules)"
    )
    environment = {
        k: v for k, v in os.environ.items() if k not in ("DISPLAY", "SDL_VIDEODRIVER", "WAYLAND_DISPLAY")
    }
    environment |= {"PYTHONPATH": str(REPOSITORY), "PYGAME_HIDE_SUPPORT_PROMPT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == "(520, 640, 3) False\n"


def test_environments_without_pictures_import_no_pygame() -> None:
    script = "import sys, dl2c; dl2c.make('example:dubins').reset(seed=0); print('pygame' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n"


def test_a_transition_aside_is_not_part_of_the_picture() -> None:
    env = running("example:dubins", steps=3)
    before = env.render()
    env.transition(env.save(), env.action_space.sample())
    assert np.array_equal(before[:-48], env.render()[:-48])


# What it costs --------------------------------------------------------------------


def processor_time(work: Callable[[], object], times: int) -> float:
    """The least of several measurements, in seconds a time."""
    found: list[float] = []
    for _ in range(5):
        begun = time.process_time()
        for _ in range(times):
            work()
        found.append((time.process_time() - begun) / times)
    return min(found)


def test_a_frame_costs_no_more_than_five_of_the_cart_pole() -> None:
    """It costs about one; that of a plane that is shaded anew costs most."""
    cart: Any = gym.make("CartPole-v1", render_mode="rgb_array").unwrapped
    cart.reset(seed=0)
    unit = processor_time(cart.render, 40)
    shaded = re.sub(r"/\* @scene.*?\*/", "", source_of("example:dubins").text, flags=re.DOTALL)
    for model in ("example:static_safety", shaded):
        env = running(model, steps=5)
        assert processor_time(env.render, 40) < 5 * unit


def test_sixty_frames_take_less_than_three_seconds() -> None:
    env = running("example:static_safety")
    begun = time.process_time()
    for _ in range(60):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        env.render()
        if terminated or truncated:
            env.reset()
    assert time.process_time() - begun < 3.0
