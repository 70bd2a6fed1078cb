"""Compiling, loading and calling libraries. The model is written by hand, without the runtime."""

import pickle
import platform
import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from generators.native_model import MODEL_C, MODEL_H, build_model
from generators.toy_library import toy_manifest
from native import declare

from dl2c.native import cgen_dir, toolchain
from dl2c.native.binding import Batch, Library, load_library
from dl2c.native.compile import CDEF, INSPECT_CDEF, compile_library
from dl2c.native.errors import CompilerFailed, CompilerMissing, NativeError, ResetFailed
from dl2c.native.manifest import Manifest
from dl2c.native.toolchain import find_compiler, first_errors, run_all
from dl2c.version import install

TOY = {"toy.h": MODEL_H, "toy.c": MODEL_C}


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_model(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def library(directory: Path) -> Library:
    return load_library(directory)


@pytest.fixture
def batch(library: Library) -> Batch:
    made = library.batch(3)
    made.reset(seeds=np.array([1, 2, 3], np.uint64))
    return made


def declared(text: str) -> list[str]:
    """The declarations of a C header, one string each, without comments and layout."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    text = re.sub(r"^\s*#.*$", "", text, flags=re.M).replace("DL2C_API ", "")
    tokens = re.findall(r"\w+|[^\w\s]", text)
    return re.findall(r"(?:[^;{}]|\{[^}]*\})+;", " ".join(tokens))


def test_cdef_declares_what_the_header_declares() -> None:
    header = declared((cgen_dir() / "include" / "dl2c.h").read_text(encoding="utf-8"))
    assert declared(CDEF.read_text(encoding="utf-8")) == header
    assert len(header) > 15
    inspect = declared((cgen_dir() / "include" / "dl2c_inspect.h").read_text(encoding="utf-8"))
    assert inspect == declared(INSPECT_CDEF.read_text(encoding="utf-8"))
    assert len(inspect) == 2


def test_kept_declarations_are_those_of_the_cdef() -> None:
    assert declare.arguments(declare.MODULE.read_text(encoding="utf-8")) == declare.made()


def test_step_reads_and_writes_the_bound_arrays(batch: Batch) -> None:
    assert batch.began.tolist() == [True] * 3
    batch.choices[:, 0] = [1, 0, 1]
    batch.step()
    assert batch.obs.tolist() == [[2.0, 0.5], [2.0, 0.5], [4.0, 0.5]]
    assert batch.rewards.tolist() == [2.25, 2.25, 4.25]
    assert not batch.began.any() and batch.obs.dtype == np.float32


def test_arrays_have_the_shapes_of_the_header(batch: Batch) -> None:
    assert (batch.choices.shape, batch.inputs.shape, batch.mask.shape) == ((3, 1), (3, 0), (3, 2))
    assert batch.executed_inputs.shape == (3, 0) and batch.status.shape == (3,)


def test_reset_touches_only_masked_environments(batch: Batch) -> None:
    batch.reset(np.array([False, True, False]), np.array([9, 9, 9], np.uint64))
    assert batch.obs[:, 0].tolist() == [1.0, 9.0, 3.0]


def test_set_state_inverts_get_state(batch: Batch) -> None:
    batch.set_state(1, [4.5], [0.25])
    x, p = batch.get_state(1)
    assert (x.tolist(), p.tolist()) == ([4.5], [0.25])
    batch.set_state(0, x, p)
    assert batch.obs[0].tolist() == batch.obs[1].tolist()


def test_states_are_those_of_each_environment(batch: Batch) -> None:
    for i in range(batch.n):
        batch.set_state(i, [i + 0.5], [-1.0 - i])
    assert batch.states([2, 0, 2]).tolist() == [[2.5, -3.0], [0.5, -1.0], [2.5, -3.0]]
    assert batch.states(range(0)).shape == (0, 2)
    with pytest.raises(IndexError, match="environment 3"):
        batch.states([0, 3])


def test_status_codes_become_exceptions(batch: Batch) -> None:
    with pytest.raises(ResetFailed, match="no initial state"):
        batch.reset(seeds=np.array([1, 13, 2], np.uint64))
    with pytest.raises(ResetFailed, match="not admissible"):
        batch.reset_to(0, 7, [-1.0], [0.0])
    with pytest.raises(NativeError, match="out of memory"):
        batch.library.batch(1, max_steps=-1)


def test_wrong_shapes_never_reach_c(batch: Batch) -> None:
    with pytest.raises(ValueError, match="3 values"):
        batch.reset(seeds=np.array([1], np.uint64))
    with pytest.raises(ValueError, match="1 values"):
        batch.set_state(0, [], [0.0])
    with pytest.raises(IndexError):
        batch.get_state(3)
    with pytest.raises(ValueError, match="at least one"):
        batch.library.batch(0)
    with pytest.raises(ValueError, match="'same_step'"):
        batch.library.batch(1, autoreset="sometimes")


def test_closed_batch_refuses_to_step(batch: Batch) -> None:
    batch.close()
    batch.close()
    with pytest.raises(NativeError, match="closed"):
        batch.step()


def test_native_objects_are_not_pickled(batch: Batch) -> None:
    for native in (batch, batch.library):
        with pytest.raises(TypeError, match="text and options"):
            pickle.dumps(native)


def test_builds_of_one_name_live_side_by_side(library: Library, tmp_path: Path) -> None:
    other = load_library(build_model(tmp_path, gain=100))
    for made, expected in ((other.batch(1), 100.0), (library.batch(1), 1.0)):
        made.reset()
        made.choices[:] = 1
        made.step()
        assert made.obs[0, 0] == expected


def test_rebuilt_folder_is_loaded_anew(tmp_path: Path) -> None:
    seen = []
    for gain in (2, 3):
        made = load_library(build_model(tmp_path, gain=gain)).batch(1)
        made.reset()
        made.choices[:] = 1
        made.step()
        seen.append(made.obs[0, 0])
    assert seen == [2.0, 3.0]


def test_same_library_loads_once(directory: Path, library: Library) -> None:
    assert load_library(directory).lib is library.lib


def test_manifest_of_another_library_is_refused(directory: Path, tmp_path: Path) -> None:
    built = next(directory.glob("libtoy*"))
    (tmp_path / built.name).write_bytes(built.read_bytes())
    for wrong in (replace(toy_manifest((2,)), abi_version=99), toy_manifest((2, 2))):
        (tmp_path / "manifest.json").write_text(wrong.to_json(), encoding="utf-8")
        with pytest.raises(NativeError, match="build the model again"):
            load_library(tmp_path)


def test_folder_without_library_is_refused(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(toy_manifest().to_json(), encoding="utf-8")
    with pytest.raises(NativeError, match="no library"):
        load_library(tmp_path)


def test_manifest_reading_inverts_writing(tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    manifest = toy_manifest(counts=(2, 3), inputs=2)
    path.write_text(manifest.to_json(), encoding="utf-8")
    assert Manifest.read(path) == manifest


def test_no_compiler_names_the_ways_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(toolchain.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(CompilerMissing, match=f"apt install gcc.*{re.escape(install('zig'))}"):
        compile_library(TOY, "toy", tmp_path)
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    with pytest.raises(CompilerMissing, match="CC=no-such-compiler"):
        find_compiler()


@pytest.mark.parametrize(
    "flaw", ["static int unused(void) { return 1; }", "int narrow(double x) { return x; }"]
)
def test_warnings_in_generated_code_are_errors(flaw: str, tmp_path: Path) -> None:
    with pytest.raises(CompilerFailed, match=r"error:.*Werror"):
        compile_library(TOY | {"toy.c": MODEL_C + flaw + "\n"}, "toy", tmp_path)
    assert not list(tmp_path.glob("*.so")) and not list(tmp_path.glob("objects-*"))


def test_a_failure_ends_compilers_at_once(tmp_path: Path) -> None:
    """Ctrl-C too, which does not reach them where it is sent to one process."""
    began = time.monotonic()
    tidy = "trap 'rm begun; kill $!; exit' TERM; sleep 600 & touch begun; wait"
    until_begun = "until test -e begun; do sleep 0.05; done; exit 1"
    with pytest.raises(CompilerFailed, match="exit code 1"):
        run_all([("sh", "-c", until_begun), ("sh", "-c", tidy)], tmp_path)
    assert not list(tmp_path.iterdir())
    assert time.monotonic() - began < 60


def test_compiler_messages_are_short() -> None:
    said = "In file included from a.c:1:\n" + "a.c:3:1: error: it broke\n" + "noise\n" * 100
    assert first_errors(said).startswith("a.c:3:1: error") and len(first_errors(said).splitlines()) == 12


@pytest.mark.parametrize("flag", ["-Ofast", "-ffast-math"])
def test_inexact_arithmetic_is_refused(flag: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CFLAGS", f"-g {flag}")
    with pytest.raises(CompilerFailed, match=f"{flag}.*remove it"):
        compile_library(TOY, "toy", tmp_path)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the flag that would fuse is one of x86-64")
def test_cflags_are_honoured_and_cannot_fuse(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CFLAGS", "-DGAIN=0 -mfma -ffp-contract=fast")
    made = load_library(build_model(tmp_path)).batch(1)
    k = 1.0 + 2.0**-52
    made.set_state(0, [-1.0], [k])
    made.choices[:] = 1
    made.step()
    assert made.get_state(0)[0][0] == -1.0, "GAIN came from CFLAGS"
    assert made.rewards[0] == k * k - 1.0


def test_zig_is_the_last_resort(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(toolchain.importlib.util, "find_spec", lambda name: object())
    found = find_compiler()
    assert found.zig and found.command == (sys.executable, "-m", "ziglang", "cc")
    assert "-mcpu=baseline" in found.flags(native=False)
    assert {"-march=native", "-DDL2C_NO_TARGET_CLONES"} <= set(found.flags(native=True))
