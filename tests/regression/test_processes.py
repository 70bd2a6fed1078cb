"""The cache of builds under attack, and environments in other processes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from selection import quick_among

import dl2c
from dl2c.env.single import Dl2cEnv
from dl2c.native import cache, toolchain
from dl2c.native.cache import cache_entries

ROOT = Path(__file__).resolve().parent.parent.parent


# The cache ---------------------------------------------------------------------


@pytest.mark.usefixtures("unoptimised")
def test_an_entry_that_cannot_be_loaded_is_built_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whole, but of no use: the seal is that of a library that no linker takes."""

    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    built = dl2c.build("example:waypoint", max_episode_steps=5)
    library = next(built.directory.glob("*.so"))
    useless = tmp_path / "useless"
    useless.write_bytes(b"\x7fELF" + bytes(1000))
    useless.replace(library)  # in its place, since this process has the library open
    seal = json.dumps(cache._digests(built.directory), indent=1, sort_keys=True)
    (built.directory / cache.SEAL).write_text(seal, encoding="utf-8")
    again = dl2c.build("example:waypoint", max_episode_steps=5)
    batch = again.library.batch(1)
    batch.reset(seeds=np.zeros(1, np.uint64))
    assert len(cache_entries()) >= 1 and library.stat().st_size > 10_000


CLEARING = """
import sys, time
from dl2c.native.cache import clear
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    clear()
"""

LOADING = """
import sys
import dl2c
for seed in range(int(sys.argv[1])):
    env = dl2c.make("example:acc")
    env.reset(seed=seed)
    env.step(env.action_space.sample())
    env.close()
print("well")
"""


@pytest.mark.parametrize(
    ("seconds", "processes", "times"), [(20, 2, 2), pytest.param(150, 4, 30, marks=pytest.mark.slow)]
)
def test_builds_are_loaded_while_the_cache_is_cleared(
    seconds: int, processes: int, times: int, tmp_path: Path
) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "DL2C_CACHE_DIR": str(tmp_path),
        "CFLAGS": "-O0 -DDL2C_NO_TARGET_CLONES",
    }
    pipe = subprocess.PIPE
    clearing = subprocess.Popen([sys.executable, "-c", CLEARING, str(seconds)], env=environment)
    loading = [
        subprocess.Popen(
            [sys.executable, "-c", LOADING, str(times)], env=environment, stdout=pipe, stderr=pipe, text=True
        )
        for _ in range(processes)
    ]
    for process in loading:
        said, wrong = process.communicate(timeout=280)
        assert said == "well\n", wrong
    clearing.kill()
    clearing.wait()


def test_long_code_is_optimised_less_and_does_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    seen: list[list[float]] = []
    for limit in (toolchain.LONG_CODE, 0):
        monkeypatch.setattr(toolchain, "LONG_CODE", limit)
        dl2c.native.cache.clear()
        batch = dl2c.build("example:bouncing_ball").library.batch(16, autoreset="same_step")
        batch.reset(seeds=np.arange(16, dtype=np.uint64))
        rows: list[float] = []
        for step in range(60):
            batch.choices[:] = step % 2
            batch.step()
            rows += batch.obs.ravel().tolist() + batch.rewards.tolist()
        seen.append(rows)
    assert seen[0] == seen[1]


# Processes ---------------------------------------------------------------------


def opened() -> Dl2cEnv:
    return dl2c.make("example:waypoint", max_episode_steps=8)


@pytest.mark.parametrize("method", quick_among(("fork", "spawn", "forkserver"), ("fork", "spawn")))
def test_environments_run_in_processes(method: str) -> None:
    """Gymnasium's and Stable-Baselines3's, to the same observations as one after the other."""
    from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    seen: list[list[float]] = []
    for envs in (SyncVectorEnv([opened] * 2), AsyncVectorEnv([opened] * 2, context=method)):
        rows = envs.reset(seed=3)[0].ravel().tolist()
        for step in range(20):
            rows += envs.step(np.array([step % 2, 0]))[0].ravel().tolist()
        envs.close()
        seen.append(rows)
    for vec in (DummyVecEnv([opened] * 2), SubprocVecEnv([opened] * 2, start_method=method)):
        vec.seed(3)
        rows = np.asarray(vec.reset()).ravel().tolist()
        for step in range(20):
            rows += np.asarray(vec.step(np.array([step % 2, 0]))[0]).ravel().tolist()
        vec.close()
        seen.append(rows)
    assert seen[0] == seen[1] and seen[2] == seen[3]
