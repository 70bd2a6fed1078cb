"""When a margin of degree two at most is left: C without branches has the bits of Python with them."""

import math
import struct
import subprocess
from typing import Any

import cffi
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dl2c.code import cgen_dir
from dl2c.emit.simulator.flow_c import EXITS
from dl2c.flows.exact import exit_time
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS, find_compiler

NEAR = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -4.0, 4.0, 1e-9, -4.905])
NUMBERS = NEAR | st.floats(-1e6, 1e6, allow_nan=False)


@pytest.fixture(scope="module")
def native(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A library with the exits of cgen/runtime/flow_exact.h."""
    folder = tmp_path_factory.mktemp("exits")
    declared = [f"double {kind}(double c0, double c1, double c2)" for kind in EXITS]
    bodies = [
        f'__attribute__((visibility("default"))) {line} {{ return {name}(c0, c1, c2); }}'
        for line, name in zip(declared, EXITS.values(), strict=True)
    ]
    source, library = folder / "exits.c", folder / "libexits.so"
    source.write_text('#include "flow_exact.h"\n' + "\n".join(bodies) + "\n")
    command = [*find_compiler().command, *CODE_FLAGS, *STRICT_FLAGS, "-Wno-missing-prototypes", "-shared"]
    command += [f"-I{cgen_dir() / 'runtime'}", str(source), "-o", str(library), "-lm", *EXACT_FLAGS]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef("\n".join(f"{line};" for line in declared))
    return ffi.dlopen(str(library))


@given(st.sampled_from(list(EXITS)), NUMBERS, NUMBERS, NUMBERS)
def test_c_leaves_when_python_does(native: Any, kind: str, c0: float, c1: float, c2: float) -> None:
    expected = exit_time(kind, c0, c1, c2)
    found = getattr(native, kind)(c0, c1, c2)
    assert bits(found) == bits(math.inf if expected is None else float(expected))


def bits(value: float) -> bytes:
    """Both zeros are one time."""
    return struct.pack("d", value + 0.0)
