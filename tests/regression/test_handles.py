"""Environments that are closed, stepped and reset from several threads, or from inside of a call.

Each case is a process of its own: a call of freed memory may end it.
"""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent

BEGIN = """
import gc, sys, threading
import gymnasium as gym
import numpy as np
import dl2c
from dl2c.env.stepping import python_step

EXPECTED = (gym.error.ResetNeeded, ValueError)
lost = []

def until_refused(call):
    try:
        while True:
            call()
    except EXPECTED as refused:
        lost.append(refused)

def single(slow):
    env = dl2c.make("example:pendulum" if slow else "example:waypoint", max_episode_steps=0)
    env.reset(seed=0)
    return env
"""

CASES = {
    "close while others step": """
for number in range(60):
    env = single(slow=number % 2 == 0)
    action = env.action_space.sample()
    threads = [threading.Thread(target=until_refused, args=(lambda: (env.step(action), env.reset()),))
               for _ in range(2)]
    for thread in threads: thread.start()
    env.close()
    for thread in threads: thread.join()
assert len(lost) == 120
""",
    "close while a vector steps": """
for number in range(30):
    envs = dl2c.make_vec("example:pendulum", 256, num_threads=1 + number % 3, max_episode_steps=0)
    envs.reset(seed=0)
    actions = envs.action_space.sample()
    thread = threading.Thread(target=until_refused, args=(lambda: envs.step(actions),))
    thread.start()
    envs.close()
    thread.join()
assert len(lost) == 30
""",
    "close from an index": """
for number in range(50):
    env = single(slow=False)
    class Closes:
        def __index__(self):
            env.close()
            return 0
    env.step(Closes())
    try:
        env.step(0)
        raise SystemExit("it went on")
    except EXPECTED:
        pass
""",
    "steps and resets from an index": """
env = single(slow=False)
class Steps:
    def __init__(self, call): self.call = call
    def __index__(self):
        self.call()
        return 0
for call in (lambda: env.step(0), env.reset, lambda: env.state, lambda: env.save()):
    try:
        env.step(Steps(call))
    except ValueError as refused:
        assert "under way" in str(refused), refused
        lost.append(refused)
    env.reset()
    env.step(0)
assert len(lost) == 4, lost
""",
    "close from an entry of an action": """
env = dl2c.make_vec("example:waypoint", 4)
env.reset(seed=0)
class Closes:
    def __array__(self, dtype=None, copy=None):
        env.close()
        return np.zeros(4, np.int64)
try:
    env.step(Closes())
    env.step(np.zeros(4, np.int64))
    raise SystemExit("it went on")
except EXPECTED:
    pass
""",
    "dropped while it steps": """
for number in range(40):
    env = single(slow=number % 2 == 0)
    step, action = env.step, env.action_space.sample()
    def go():
        for _ in range(200):
            if step(action)[2] or step(action)[3]: break
    def run():
        try: go()
        except EXPECTED: pass
    thread = threading.Thread(target=run)
    thread.start()
    del env, step
    gc.collect()
    thread.join()
""",
    "after closing": """
env, envs = single(slow=False), dl2c.make_vec("example:waypoint", 2, render_mode="ansi")
envs.reset(seed=0)
for each in (env, envs):
    each.close()
    each.close()
calls = [env.action_masks, env.render, env.reset, env.save, lambda: env.state, lambda: env.step(0)]
calls += [envs.action_masks, envs.render, envs.reset, lambda: envs.state(0)]
calls += [lambda: envs.step(np.zeros(2, int))]
for call in calls:
    try:
        call()
        raise SystemExit(f"{call} answered")
    except EXPECTED:
        pass
""",
}


@pytest.mark.parametrize("case", CASES)
def test_no_call_reaches_freed_memory(case: str) -> None:
    command = [sys.executable, "-X", "faulthandler", "-c", BEGIN + CASES[case]]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=240, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
