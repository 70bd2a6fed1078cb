"""Where CVODES comes from: finding it, linking with it, and what is said where it is missing."""

import importlib.util
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from generators.native_model import MODEL_C, MODEL_H, build_model

from dl2c.native import sundials
from dl2c.native.binding import load_library
from dl2c.native.cache import build_key
from dl2c.native.compile import compile_library, declarations
from dl2c.native.errors import CompilerFailed, NativeError
from dl2c.native.sundials import casadi_library, find_sundials, load_solver
from dl2c.native.toolchain import find_compiler
from dl2c.options import Options, UnknownOption, as_words, with_options

TOY = {"toy.h": MODEL_H, "toy.c": MODEL_C}


def test_casadi_has_cvodes_and_its_version_is_known() -> None:
    found = find_sundials("casadi", find_compiler())
    assert found.version.startswith("casadi 3.")
    assert (found.flags, found.link_flags) == ((), ())
    assert casadi_library().is_file()


def test_a_casadi_without_cvodes_is_reported(monkeypatch: Any, tmp_path: Path) -> None:
    for spec in (None, SimpleNamespace(origin=None), SimpleNamespace(origin=str(tmp_path / "__init__.py"))):
        with monkeypatch.context() as patch:
            patch.setattr(importlib.util, "find_spec", {"casadi": spec}.get)
            with pytest.raises(NativeError, match="--sundials system"):
                casadi_library()


def test_a_system_without_sundials_is_told_what_to_install(monkeypatch: Any, tmp_path: Path) -> None:
    monkeypatch.setenv("CFLAGS", f"-nostdinc -I{tmp_path}")
    with pytest.raises(CompilerFailed, match="apt install libsundials-dev"):
        find_sundials("system", find_compiler())
    headers = tmp_path / "sundials"
    headers.mkdir()
    for version, major in (("2.7.0", 2), ("6.1.1", 6), ("7.1.1", 7)):
        text = f'#define SUNDIALS_VERSION "{version}"\n#define SUNDIALS_VERSION_MAJOR {major}\n'
        (headers / "sundials_version.h").write_text(text, encoding="utf-8")
        if major < 6:
            with pytest.raises(CompilerFailed, match=r"2\.7\.0 is too old"):
                find_sundials("system", find_compiler())
        else:
            found = find_sundials("system", find_compiler())
            assert found.version == version
            assert ("-lsundials_core" in found.link_flags) == (major == 7)


def test_a_model_links_with_the_systems_sundials(tmp_path: Path) -> None:
    try:
        system = find_sundials("system", find_compiler())
    except CompilerFailed as problem:
        pytest.skip(str(problem))
    build_model(tmp_path)
    wanted = '#ifndef DL2C_SUNDIALS_SYSTEM\n#error "no flag"\n#endif\n#include <cvodes/cvodes.h>\n'
    created = "int dl2c_create(void);\nint dl2c_create(void) { return CVodeCreate(1, NULL) != NULL; }\n"
    source = TOY | {"toy.c": wanted + MODEL_C + created}
    library = compile_library(source, "toy", tmp_path, sundials=system)
    assert b"libsundials_cvodes" in library.read_bytes()
    assert load_library(tmp_path).sizes.nx == 1


def test_a_build_depends_on_the_provider() -> None:
    keys = {build_key({"m.kyx": "text"}, as_words(Options()))}
    try:
        keys.add(build_key({"m.kyx": "text"}, as_words(Options(sundials="system"))))
    except CompilerFailed as problem:
        pytest.skip(str(problem))
    assert len(keys) == 2


def test_a_provider_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UnknownOption, match="'casadi', 'system'"):
        with_options(Options(), {"sundials": "conda"})


def solverless(seen: list[bytes], ffi: Any) -> Any:
    def dl2c_solver_library(path: bytes, problem: Any, room: int) -> int:
        seen.append(path)
        ffi.memmove(problem, b"no function CVode\0", 18)
        return -5 if path.endswith((b".so", b".dylib")) else 0

    return SimpleNamespace(dl2c_solver_library=dl2c_solver_library)


def test_an_unfit_library_is_reported_when_a_model_is_loaded() -> None:
    ffi, seen = declarations(), list[bytes]()
    with pytest.raises(NativeError, match="no function CVode"):
        load_solver(ffi, solverless(seen, ffi), "casadi")
    assert seen == [os.fsencode(casadi_library())]
    load_solver(ffi, solverless(seen, ffi), "system")
    assert len(seen) == 2


def test_models_without_such_flows_load_no_solver(monkeypatch: Any, tmp_path: Path) -> None:
    monkeypatch.setattr(sundials, "casadi_library", lambda: pytest.fail("looked for"))
    load_library(build_model(tmp_path))
