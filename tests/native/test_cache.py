"""The build cache: every entry is whole, built once, and under a key that says it all."""

import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from subprocess import check_output
from typing import Any, NoReturn

import pytest

from dl2c import code
from dl2c.code import code_digest
from dl2c.native import cache, toolchain
from dl2c.native.cache import build_key, cache_dir, cache_entries, cached, clear, prune
from dl2c.native.errors import NativeError
from dl2c.options import Options, as_words

KEY = "0123456789abcdef" * 2

BUILDER = """
import os, signal, sys, time
from pathlib import Path
from dl2c.native.cache import cached

def build(directory):
    with open(sys.argv[1], "a") as log:
        log.write("built\\n")
    (directory / "half").write_text("half")
    time.sleep(float(sys.argv[2]))
    if sys.argv[3] == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    (directory / "library").write_text("whole")

print((cached("0123456789abcdef" * 2, build, lambda entry: entry) / "library").read_text())
"""


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "cache"))


def builder(log: Path, seconds: float, end: str = "live") -> subprocess.Popen[str]:
    command = [sys.executable, "-c", BUILDER, str(log), str(seconds), end]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2])


def as_it_is(entry: Path) -> Path:
    return entry


def writes(text: str) -> Callable[[Path], None]:
    return lambda directory: (directory / "library").write_text(text) and None


def entry(number: int, size: int, age: float) -> Path:
    made = cached(f"{number:032x}", writes("x" * size), as_it_is)
    then = time.time() - age
    os.utime(made / cache.SEAL, (then, then))
    return made


def test_concurrent_builders_build_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    processes = [builder(log, 0.3) for _ in range(4)]
    assert [process.communicate()[0].strip() for process in processes] == ["whole"] * 4
    assert log.read_text() == "built\n"


def test_killed_build_leaves_no_entry(tmp_path: Path) -> None:
    log = tmp_path / "log"
    victim = builder(log, 0.0, "die")
    victim.communicate()
    assert victim.returncode == -signal.SIGKILL
    assert cache_entries() == ()
    assert (cached(KEY, writes("whole"), as_it_is) / "library").read_text() == "whole"
    assert not list(cache_dir().glob("*.tmp")), "what the killed build left is gone"


def test_failing_build_passes_its_error_on() -> None:
    def build(directory: Path) -> None:
        (directory / "half").write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached(KEY, build, as_it_is)
    assert cache_entries() == () and not list(cache_dir().glob("*.tmp"))


def test_an_interruption_leaves_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also right after the folder of a build is made."""
    make = os.mkdir

    def interrupted(path: Any, *rest: Any, **named: Any) -> None:
        make(path, *rest, **named)
        if str(path).endswith(".tmp"):
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cached(KEY, writes("whole"), as_it_is)
    assert not list(cache_dir().glob("*.tmp"))


@pytest.mark.parametrize("damage", ["truncated", "removed", "added", "unsealed"])
def test_corrupted_entry_is_built_again(damage: str) -> None:
    made = cached(KEY, writes("whole"), as_it_is)
    match damage:
        case "truncated":
            (made / "library").write_text("who")
        case "removed":
            (made / "library").unlink()
        case "added":
            (made / "stray").write_text("")
        case _:
            (made / cache.SEAL).write_text("{")
    again = cached(KEY, writes("anew"), as_it_is)
    assert [path.name for path in sorted(again.iterdir())] == ["library", cache.SEAL]
    assert (again / "library").read_text() == "anew"


def test_hit_does_not_build() -> None:
    first = cached(KEY, writes("first"), as_it_is)
    assert cached(KEY, writes("second"), as_it_is) == first
    assert (first / "library").read_text() == "first"


def test_cache_belongs_to_one_user(monkeypatch: pytest.MonkeyPatch) -> None:
    root = cache_dir()
    root.chmod(0o777)
    assert stat.S_IMODE(cache_dir().stat().st_mode) == 0o700
    other = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: other)
    with pytest.raises(NativeError, match=r"another user.*DL2C_CACHE_DIR"):
        cached(KEY, writes(""), as_it_is)


def test_unusable_cache_is_a_clear_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(NativeError, match="set DL2C_CACHE_DIR"):
        cache_dir()


def test_pruning_removes_the_least_recently_used() -> None:
    old, older, recent = entry(1, 4000, 200), entry(2, 4000, 300), entry(3, 4000, 100)
    assert [e.directory for e in cache_entries()] == [recent, old, older]
    assert prune(cap=100_000) == ()
    assert [e.directory for e in prune(cap=9000)] == [older]
    cached(old.name, writes("used again"), as_it_is)
    assert [e.directory for e in prune(cap=5000)] == [recent]
    assert [e.directory for e in cache_entries()] == [old]


def test_pruning_spares_what_was_just_used() -> None:
    entry(1, 4000, 1)
    entry(2, 4000, 100)
    assert [int(e.key, 16) for e in prune(cap=0, idle=60)] == [2]


def test_clear_removes_everything_but_running_builds(tmp_path: Path) -> None:
    entry(1, 10, 0)
    running = builder(tmp_path / "log", 1.0)
    while not list(cache_dir().glob(f"{KEY}.*.tmp/half")):
        time.sleep(0.02)
    assert len(clear()) == 1
    assert running.communicate()[0].strip() == "whole"
    assert [e.key for e in cache_entries()] == [KEY]


def test_key_depends_on_everything(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    model = {"m.kyx": "text"}
    keys = [
        build_key(model, as_words(Options())),
        build_key({"m.kyx": "texts"}, as_words(Options())),
        build_key(model | {"lib.kyx": ""}, as_words(Options())),
        build_key(model, as_words(Options(dt=Fraction(1, 20)))),
        build_key(model, as_words(Options(native=True))),
    ]
    monkeypatch.setenv("CFLAGS", "-g")
    keys.append(build_key(model, as_words(Options())))
    monkeypatch.setattr(cache, "code_digest", lambda: "another version")
    keys.append(build_key(model, as_words(Options())))
    monkeypatch.setattr(cache, "version_of", lambda package: "0.0")
    keys.append(build_key(model, as_words(Options())))
    other = tmp_path / "othercc"
    other.write_text("#!/bin/sh\necho othercc 1.0\n")
    other.chmod(0o755)
    monkeypatch.setenv("CC", str(other))
    keys.append(build_key(model, as_words(Options())))
    monkeypatch.setattr(cache, "find_compiler", lambda: toolchain.Compiler((str(other),), "othercc 2.0"))
    keys.append(build_key(model, as_words(Options())))
    assert len(set(keys)) == len(keys)


def test_key_is_a_function_of_its_input() -> None:
    model = {"a.kyx": "1", "b.kyx": "2"}
    assert build_key(model, as_words(Options())) == build_key(
        dict(reversed(model.items())), as_words(Options())
    )


def test_the_code_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening a model that is built already must not read all of the package each time."""
    known = code_digest()

    def unread(folder: str) -> NoReturn:
        raise AssertionError(f"{folder} is read again")

    monkeypatch.setattr("dl2c.code.os.scandir", unread)
    assert code_digest() == known


@pytest.mark.parametrize("changed", ["dl2c/emit/names.py", "dl2c/parse/new.lark", "cgen/runtime/rng.h"])
def test_the_digest_covers_all_code(changed: str, tmp_path: Path) -> None:
    package, c = code.PACKAGE, code.cgen_dir()
    left_out = shutil.ignore_patterns("__pycache__")
    for folder, name in ((package, "dl2c"), (c, "cgen")):
        shutil.copytree(folder, tmp_path / name, ignore=left_out)
    ask = "from dl2c.code import code_digest; print(code_digest())"

    def told() -> str:
        return check_output([sys.executable, "-B", "-c", ask], cwd=tmp_path, text=True).strip()

    assert told() == code_digest()
    path = tmp_path / changed
    path.write_text((path.read_text() if path.exists() else "") + "\n", encoding="utf-8")
    assert told() != code_digest()


def test_a_compiler_is_asked_once_until_it_changes(tmp_path: Path) -> None:
    program = tmp_path / "othercc"
    for number in ("1.0", "2.0"):
        program.unlink(missing_ok=True)
        program.write_text(f"#!/bin/sh\necho asked >> {tmp_path}/{number}\necho othercc {number}\n")
        program.chmod(0o755)
        found = [toolchain.find_compiler({"CC": str(program), "PATH": "/bin"}).version for _ in range(3)]
        assert found == [f"othercc {number}"] * 3
        assert (tmp_path / number).read_text() == "asked\n"
