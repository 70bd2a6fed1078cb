"""When a margin of degree two at most is left: C without branches has the bits of Python with them."""

import math
import struct
from typing import Any

import pytest
from c_functions import functions
from hypothesis import given
from hypothesis import strategies as st

from dl2c.emit.simulator.flow_c import EXITS
from dl2c.flows.exact import exit_time

NEAR = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -4.0, 4.0, 1e-9, -4.905])
NUMBERS = NEAR | st.floats(-1e6, 1e6, allow_nan=False)


@pytest.fixture(scope="module")
def native(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A library with the exits of cgen/runtime/flow_exact.h."""
    calls = {
        f"double {kind}(double c0, double c1, double c2)": f"{c}(c0, c1, c2)" for kind, c in EXITS.items()
    }
    return functions(tmp_path_factory.mktemp("exits"), '#include "flow_exact.h"', calls)


@given(st.sampled_from(list(EXITS)), NUMBERS, NUMBERS, NUMBERS)
def test_c_leaves_when_python_does(native: Any, kind: str, c0: float, c1: float, c2: float) -> None:
    expected = exit_time(kind, c0, c1, c2)
    found = getattr(native, kind)(c0, c1, c2)
    assert bits(found) == bits(math.inf if expected is None else float(expected))


def bits(value: float) -> bytes:
    """Both zeros are one time."""
    return struct.pack("d", value + 0.0)
