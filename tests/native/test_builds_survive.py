"""Builds that are run at once, killed or short of disk: the next one is right."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
from hostile.cases import model
from selection import quick_among

from dl2c.native.binding import load_library
from dl2c.native.cache import SEAL, cache_dir, cache_entries

ROOT = Path(__file__).resolve().parents[2]

BUILD = """
import json, sys
import numpy as np
import dl2c

compiled = dl2c.build(sys.argv[1])
batch = compiled.library.batch(2)
batch.reset(seeds=np.array([1, 2], np.uint64))
batch.step()
print(json.dumps([str(compiled.directory), batch.obs.tolist(), batch.rewards.tolist()]))
"""

LIMITED = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (%d, %d))
"""


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


def builder(
    path: Path, before: str = "", group: bool = False, cache: Path | None = None
) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", before + BUILD, str(path)]
    environment = os.environ if cache is None else {**os.environ, "DL2C_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT, start_new_session=group, env=environment
    )


def result(process: subprocess.Popen[str]) -> list[object]:
    out, err = process.communicate()
    assert process.returncode == 0, err
    return json.loads(out)


def written(folder: Path, text: str) -> Path:
    path = folder / "model.kyx"
    path.write_text(text, encoding="utf-8")
    return path


def test_processes_that_build_at_once_build_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    log = tmp_path / "log"
    compiler = tmp_path / "logged-cc"
    compiler.write_text(f'#!/bin/sh\necho "$@" >> "{log}"\nexec cc "$@"\n', encoding="utf-8")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    path = written(tmp_path, model())
    results = [result(process) for process in [builder(path) for _ in range(8)]]
    assert all(r == results[0] for r in results)
    commands = log.read_text(encoding="utf-8").splitlines()
    assert sum("-c Plain.c" in command for command in commands) == 1


def example(name: str) -> str:
    return (ROOT / "examples" / f"{name}.kyx").read_text(encoding="utf-8")


def check_kills(
    folder: Path, texts: list[str], kills: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kill a build with all its compilers at some moment; the next one is right and tidy.

    It has the files and the trajectory of a build of the same text that nothing
    disturbed, in a cache of its own. No build finds what another one compiled.
    """
    flags = os.environ["CFLAGS"]
    rng = Random(seed)
    interrupted, fastest = 0, [60.0] * len(texts)
    for k in range(kills):
        which = k % len(texts)
        monkeypatch.setenv("CFLAGS", f"{flags} -DNUMBER={k}")
        path = written(folder, texts[which])
        own = folder / "undisturbed" / str(k)
        start = time.monotonic()
        original, *expected = result(builder(path, cache=own))
        fastest[which] = min(fastest[which], time.monotonic() - start)
        victim = builder(path, group=True)
        time.sleep(rng.uniform(0.1, 1.0) * fastest[which])
        interrupted += victim.poll() is None
        with suppress(ProcessLookupError):
            os.killpg(victim.pid, signal.SIGKILL)
        victim.communicate()
        directory, *found = result(builder(path))
        assert found == expected
        assert texts_in(Path(str(directory))) == texts_in(Path(str(original)))
        load_library(Path(str(directory)))
        assert not list(cache_dir().glob("*.tmp")), "what a killed build left is gone"
    assert interrupted > 0
    assert len(cache_entries()) == 3 * kills, "two of a model, and the steps of environments with these flags"


def texts_in(folder: Path) -> dict[str, str]:
    """All that a build holds but its seal and its library, which names the place where it was compiled."""
    paths = [path for path in folder.iterdir() if path.suffix != ".so" and path.name != SEAL]
    return {path.name: path.read_text(encoding="utf-8") for path in paths}


@pytest.mark.slow
def test_killed_builds_leave_nothing_broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_kills(tmp_path, [model()], 5, 1, monkeypatch)


@pytest.mark.slow
def test_many_killed_builds_leave_nothing_broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("waypoint", "watertank", "passive_safety", "dubins", "pendulum")
    check_kills(tmp_path, [model(), *map(example, names)], 60, 2, monkeypatch)


def check_at_once(folder: Path, texts: list[str], processes: int) -> None:
    """Builds of the same and of different models in one cache: each is built once and is right."""
    paths: list[Path] = []
    for k, text in enumerate(texts):
        (folder / str(k)).mkdir()
        paths.append(written(folder / str(k), text))
    results = [result(b) for b in [builder(paths[k % len(paths)]) for k in range(processes)]]
    alone = [result(builder(path, cache=folder / "alone")) for path in paths]
    for k, (_, *found) in enumerate(results):
        assert found == alone[k % len(paths)][1:]
    assert len(cache_entries()) == 2 * len(texts) + 1, "two of each model, and the steps of environments"
    assert not list(cache_dir().glob("*.tmp"))


def test_different_models_are_built_at_once(tmp_path: Path) -> None:
    check_at_once(tmp_path, [model(), model(name="Other", x="y1")], 4)


@pytest.mark.slow
def test_many_models_are_built_at_once(tmp_path: Path) -> None:
    check_at_once(tmp_path, [model(), *map(example, ("waypoint", "watertank", "dubins"))], 8)


@pytest.mark.parametrize("room", quick_among((0, 1000, 20_000), (1000,)))
def test_full_disk_is_a_clear_error(room: int, tmp_path: Path) -> None:
    """The limit on file sizes stands for a disk without room."""
    path = written(tmp_path, model())
    process = builder(path, LIMITED % (room, room))
    _, err = process.communicate()
    assert process.returncode != 0
    last = [line for line in err.splitlines() if not line.startswith(" ")]
    assert any(word in line for line in last for word in ("NativeError", "CompilerFailed")), err
    assert result(builder(path)), "with room again it builds"


def test_folder_that_cannot_be_written_is_a_clear_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for place in ("/proc/dl2c", str(written(tmp_path, model()) / "below")):
        monkeypatch.setenv("DL2C_CACHE_DIR", place)
        process = builder(tmp_path / "model.kyx")
        _, err = process.communicate()
        assert "NativeError: cannot use the build cache" in err and "DL2C_CACHE_DIR" in err
