"""For which processors C is compiled: the one at hand in the cache, any where it is written to a folder."""

import json
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dl2c import build
from dl2c.cli import app
from dl2c.native.loading import find
from dl2c.native.toolchain import cpu_features, find_compiler

CLONES = (sys.platform, platform.machine()) == ("linux", "x86_64")


def results(name: str, **options: bool) -> list[bytes]:
    """All arrays of 70 environments after each of 50 steps."""
    batch = build(f"example:{name}", **options).library.batch(70, autoreset="same_step")
    batch.reset(seeds=np.arange(70, dtype=np.uint64))
    seen: list[bytes] = []
    for _ in range(50):
        batch.step()
        seen.append(b"".join(array.tobytes() for array in batch.arrays()))
    return seen


@pytest.mark.skipif(not CLONES, reason="clones for several processors are those of x86-64 on Linux")
@pytest.mark.parametrize("name", ["waypoint", "pendulum"])
def test_a_processor_of_its_own_changes_no_bit(name: str) -> None:
    assert results(name) == results(name, native=False)


@pytest.mark.parametrize("name", ["waypoint", "pendulum"])
def test_code_for_a_debugger_gives_the_same_bits(name: str) -> None:
    assert results(name, debug=True) == results(name)
    library = find(build(f"example:{name}", debug=True).directory).read_bytes()
    assert (
        b".debug_info" in library
        and b".debug_info" not in find(build(f"example:{name}").directory).read_bytes()
    )


def test_code_for_a_debugger_lacks_what_the_model_does_not_call() -> None:
    names = (b"dl2c_admissible", b"dl2c_draw_near", b"dl2c_look_from")
    without_inputs, with_inputs = (
        find(build(f"example:{name}", debug=True).directory).read_bytes()
        for name in ("forced_acceleration", "pendulum")
    )
    assert [name in without_inputs for name in names] == [False, False, False]
    assert [name in with_inputs for name in names] == [True, False, False]


def test_debug_is_the_last_word_on_optimisation() -> None:
    for native in (None, True, False):
        flags = find_compiler().flags(native, size=10**6, debug=True)
        assert [f for f in flags if f.startswith("-O")][-1] == "-O0"
        assert "-march=native" not in flags and "-ffp-contract=off" in flags


@pytest.mark.skipif(
    "avx512f" not in cpu_features() or shutil.which("objdump") is None, reason="needs AVX-512 and objdump"
)
@pytest.mark.parametrize(("name", "wide"), [("waypoint", True), ("dubins", False)])
def test_vectors_are_widest_where_motion_is_exact(
    name: str, wide: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a CPU with which GCC takes narrower ones itself."""
    if "Free Software Foundation" not in find_compiler().version:
        pytest.skip("GCC alone is asked")
    monkeypatch.setenv("CFLAGS", "-mtune=icelake-server")
    library = find(build(f"example:{name}").directory)
    code = subprocess.run(["objdump", "-d", str(library)], capture_output=True, text=True, check=True).stdout
    assert (code.count("%zmm") > 500) == wide


def test_what_a_folder_asks_for_runs_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "-march=native" not in find_compiler().flags(native=False)
    assert ("-march=native" in find_compiler().flags(native=None)) == CLONES
    monkeypatch.chdir(tmp_path)
    for words in ([], ["-o", "taken"], ["-o", "here", "--native"]):
        assert CliRunner().invoke(app, ["build", "example:thermostat", *words]).exit_code == 0
    manifests = [
        json.loads(Path(f, "Thermostat", "manifest.json").read_text()) for f in ("build", "taken", "here")
    ]
    assert [m["options"]["native"] for m in manifests] == [None, False, True]
