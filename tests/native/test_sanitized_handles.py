"""The cases of regression/test_handles.py with environments built under sanitizers: nothing is reported.

Python is not built with a sanitizer, so only reports with a frame in generated code or the runtime count; of
addresses all do.
"""

import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from regression.test_handles import BEGIN, CASES

ROOT = Path(__file__).resolve().parents[2]

SANITIZERS = {"address": ("address,undefined", "libasan.so"), "thread": ("thread", "libtsan.so")}
REPORT = r"ERROR: AddressSanitizer|WARNING: ThreadSanitizer|runtime error:|DEADLYSIGNAL|CHECK failed"
OWN = r"/(?:builds|single)[^\s]*|batch\.[ch]|single\.c|model\.c|\.cpython-[^\s]*\.so|dl2c_\w+"
"""What stands in a frame of code that dl2c made."""

CONTROL = """
#include <stdlib.h>
int shared;
void once(int k) { for (int i = 0; i < 20000000; i++) shared += k; }
int beyond(int k) { int *p = malloc(4 * sizeof(int)); int found = p[k]; free(p); return found; }
int overflow(int k) { return 2147483647 + k; }
"""

RACE = """
import ctypes, threading
made = ctypes.CDLL("./control.so")
threads = [threading.Thread(target=made.once, args=(k,)) for k in (1, 2)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""
CONTROLS = {
    ("address", "import ctypes; ctypes.CDLL('./control.so').beyond(9)"): "heap-buffer-overflow",
    ("address", "import ctypes; ctypes.CDLL('./control.so').overflow(9)"): "signed integer overflow",
    ("thread", RACE): "data race",
}


@cache
def library(name: str) -> str:
    """Where the compiler has a library; skips where it has none."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    found = subprocess.run(
        ["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True
    ).stdout.strip()
    if not Path(found).is_absolute():
        pytest.skip(f"gcc lacks {name}")
    return str(Path(found).resolve())


def flags(sanitizer: str) -> list[str]:
    chosen = f"-fsanitize={SANITIZERS[sanitizer][0]}"
    return ["-O1", "-g", chosen, "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]


def ran(code: str, sanitizer: str, folder: Path) -> tuple[int, str]:
    """Run Python with the sanitizer's library; the exit code and all that was said."""
    loaded = f"{library(SANITIZERS[sanitizer][1])} {library('libstdc++.so.6')}"
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "DL2C_CACHE_DIR": str(folder / "cache"),
        "CC": "gcc",
        "CFLAGS": " ".join([*flags(sanitizer), "-DDL2C_NO_TARGET_CLONES"]),
        "LD_PRELOAD": loaded,
        "ASAN_OPTIONS": "detect_leaks=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "TSAN_OPTIONS": "exitcode=0 report_signal_unsafe=0",
    }
    steady = [setarch, "-R"] if (setarch := shutil.which("setarch")) else []
    done = subprocess.run(
        [*steady, sys.executable, "-X", "faulthandler", "-c", code], cwd=folder, env=environment,
        capture_output=True, text=True, timeout=580, check=False,
    )  # fmt: skip
    if re.search(r"unexpected memory mapping|personality", done.stderr):
        pytest.skip(f"the sanitizer does not work on this system: {done.stderr.splitlines()[0]}")
    return done.returncode, done.stderr


def reports(said: str, sanitizer: str) -> list[str]:
    """The reports that concern dl2c."""
    parts = re.split(rf"(?=(?:{REPORT}))", said)[1:]
    return [part for part in parts if sanitizer == "address" or re.search(OWN, part)]


@pytest.mark.slow
@pytest.mark.parametrize(("sanitizer", "code"), CONTROLS)
def test_sanitizers_see_what_is_wrong(sanitizer: str, code: str, tmp_path: Path) -> None:
    """Or else the others would say nothing."""
    library(SANITIZERS[sanitizer][1])
    (tmp_path / "control.c").write_text(CONTROL, encoding="utf-8")
    command = ["gcc", *flags(sanitizer), "-O0", "-shared", "-fPIC", "control.c", "-o", "control.so"]
    subprocess.run(command, cwd=tmp_path, check=True)
    _, said = ran(code, sanitizer, tmp_path)
    assert CONTROLS[sanitizer, code] in said and re.search(REPORT, said), said[-2000:]


@pytest.mark.slow
@pytest.mark.parametrize("sanitizer", SANITIZERS)
def test_handles_are_clean(sanitizer: str, tmp_path: Path) -> None:
    wrong: list[str] = []
    for name, case in CASES.items():
        code, said = ran(BEGIN + case, sanitizer, tmp_path)
        if code != 0 or reports(said, sanitizer):
            wrong.append(f"{name}: {code}\n{said[:3000]}")
    built = [path for path in (tmp_path / "cache").rglob("*.so") if path.is_file()]
    assert built and all(SANITIZERS[sanitizer][1].encode() in path.read_bytes() for path in built)
    assert not wrong, "\n\n".join(wrong)
