"""What goes into the cache is compiled in two units: rewards, and what models with other rewards share."""

import re
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile.cases import model

from dl2c.emit.names import file_stem
from dl2c.native import compile as compiling
from dl2c.native.binding import Library, load_library
from dl2c.native.cache import cache_entries, clear
from dl2c.native.compile import CDEF, compile_library
from dl2c.native.errors import CompilerFailed
from dl2c.options import Options
from dl2c.pipeline import Compilation, compile_model
from dl2c.source import Source

GOOD = Path(__file__).parents[1] / "good"


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The sources that are compiled, in order."""
    sources: list[str] = []

    def run_all(commands: Iterable[tuple[str, ...]], directory: Path) -> None:
        listed = list(commands)
        sources.extend(command[command.index("-c") + 1] for command in listed)
        ran(listed, directory)

    ran = compiling.run_all
    monkeypatch.setattr(compiling, "run_all", run_all)
    return sources


def built(text: str, **options: Any) -> Library:
    return compile_model(Source("plain.kyx", text), replace(Options(), **options)).library


def rewards(library: Library) -> list[float]:
    batch = library.batch(3)
    batch.reset(seeds=np.arange(3, dtype=np.uint64))
    batch.step()
    return batch.rewards.tolist()


def test_another_reward_compiles_nothing_else(compiled: list[str]) -> None:
    first = rewards(built(model(shape="y")))
    assert sorted(compiled) == ["Plain.c", "Plain_rewards.h"]
    compiled.clear()
    second = rewards(built(model(shape="2 * y + 1")))
    assert compiled == ["Plain_rewards.h"]
    assert second == [2 * reward + 1 for reward in first]


def test_comments_and_what_is_known_of_the_theorem_compile_nothing_else(compiled: list[str]) -> None:
    built(model())
    compiled.clear()
    built(f"/* Some words. */\n{model()}")
    assert compiled == ["Plain_rewards.h"]


@pytest.mark.parametrize(
    ("change", "options"),
    [
        ({"control": "{ a := A; ++ a := A / -2; }"}, {}),
        ({"domain": "& x <= 8"}, {}),
        ({"start": "& x <= 0.5"}, {}),
        ({}, {"obs_dtype": "float64"}),
    ],
)
def test_whatever_else_changes_is_compiled(
    change: dict[str, str], options: dict[str, Any], compiled: list[str]
) -> None:
    built(model())
    compiled.clear()
    built(model(**change), **options)
    assert sorted(compiled) == ["Plain.c", "Plain_rewards.h"]


@pytest.mark.parametrize("flags", ["-O1", "-O2 -DDL2C_NO_TARGET_CLONES"])
def test_so_do_other_flags(flags: str, compiled: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    built(model())
    compiled.clear()
    monkeypatch.setenv("CFLAGS", flags)
    built(model(shape="y + 1"))
    assert sorted(compiled) == ["Plain.c", "Plain_rewards.h"]


def test_for_a_debugger_all_is_compiled(compiled: list[str]) -> None:
    for shape in ("y", "2 * y"):
        built(model(shape=shape), debug=True)
    assert compiled == ["Plain.c"] * 2


def test_an_object_that_is_gone_or_broken_is_compiled_again(compiled: list[str]) -> None:
    first = rewards(built(model(shape="y")))
    (kept,) = (found for entry in cache_entries() for found in entry.directory.glob("*.o"))
    kept.write_bytes(b"broken")
    assert rewards(built(model(shape="y + 1"))) == [reward + 1 for reward in first]
    clear()
    assert rewards(built(model(shape="y + 2"))) == [reward + 2 for reward in first]
    assert compiled.count("Plain.c") == 3


def test_what_cannot_be_compiled_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CFLAGS", "-fno-such-thing")
    with pytest.raises(CompilerFailed):
        built(model())
    assert cache_entries() == ()


def trajectory(library: Library) -> list[bytes]:
    """What is in all arrays of a full block and some lanes more, over steps."""
    n = 67
    batch = library.batch(n, autoreset="next_step", max_steps=9)
    rng = np.random.default_rng(1)
    batch.reset(seeds=np.arange(n, dtype=np.uint64))
    seen: list[bytes] = []
    for _ in range(20):
        batch.choices[...] = rng.integers(0, 3, batch.choices.shape)
        batch.inputs[...] = rng.uniform(-3.0, 3.0, batch.inputs.shape)
        batch.step()
        seen += [array.tobytes() for array in batch.arrays()]
    return seen


LIFT = (GOOD / "lift.kyx").read_text(encoding="utf-8")


def linked(text: str, folder: Path, keep: bool, native: bool) -> Library:
    found = Compilation(Source("model.kyx", text), Options())
    name = file_stem(found.lowered.model.name)
    compile_library(found.emitted(found.claim()), name, folder, keep=keep, native=native)
    (folder / "manifest.json").write_text(found.manifest().to_json(), encoding="utf-8")
    return load_library(folder)


@pytest.mark.parametrize(
    ("text", "native"),
    [(LIFT, True), (model(shape="1 / (y - 3)"), False), (model(shape="sqrt(y) / A"), True)],
    ids=["lift", "no value", "function"],
)
def test_two_units_give_the_bits_of_one(
    text: str, native: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CFLAGS", "-O2")
    one, two = (linked(text, tmp_path / str(keep), keep, native) for keep in (False, True))
    assert (cache_entries() != ()) and trajectory(one) == trajectory(two)


@pytest.mark.skipif(shutil.which("nm") is None, reason="nm is not installed")
@pytest.mark.parametrize("native", [True, False])
def test_only_the_interface_can_be_called_from_outside(
    native: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CFLAGS", "-O1")
    linked(model(), tmp_path / "built", True, native)
    listed = ["nm", "-D", "--defined-only", str(tmp_path / "built" / "libPlain.so")]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    exported = {line.split()[-1] for line in lines} - {"_init", "_fini"}
    interface = set(re.findall(r"\b(dl2c_\w+)\(", CDEF.read_text(encoding="utf-8")))
    assert exported and exported <= interface
