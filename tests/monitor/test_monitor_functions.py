"""Enclosures of functions in sound monitors: no number outside, judged by mpmath, and none much too wide."""

import ctypes
import math
import random
import subprocess
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from selection import few_and_many, quick_among

from dl2c.code import cgen_dir
from dl2c.emit.monitor.interval_c import TABLES, prelude
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.model import LARGEST_STATE
from dl2c.native.toolchain import EXACT_FLAGS, find_compiler, warning_flags

Real = NDArray[np.floating]
TYPES = {"double": np.float64, "float": np.float32}
LARGEST = {"double": Fraction(LARGEST_STATE), "float": Fraction(10**12)}
ULPS = {"exp": 8, "sin": 8, "cos": 8, "tan": 30, "tanh": 8, "arcsin": 60, "arctan": 30, "sqrt": 3, "log": 12}
"""How wide an enclosure of the value at a number may be, in multiples of epsilon times the scale below."""

EXACT: dict[str, Callable[..., mpmath.mpf]] = {
    "exp": mpmath.exp,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tan": mpmath.tan,
    "tanh": mpmath.tanh,
    "arcsin": mpmath.asin,
    "arctan": mpmath.atan,
    "sqrt": mpmath.sqrt,
    "log": mpmath.log,
}
SCALE: dict[str, Callable[[float, float], float]] = {
    "exp": lambda x, y: y * (1 + abs(x)),
    "sin": lambda x, y: 1,
    "cos": lambda x, y: 1,
    "tan": lambda x, y: 1 + y * y,
    "tanh": lambda x, y: 1,
    "arcsin": lambda x, y: 1,
    "arctan": lambda x, y: 1,
    "sqrt": lambda x, y: y,
    "log": lambda x, y: 1 + abs(y),
}


def library(real: str, folder: Path) -> ctypes.CDLL:
    """Each enclosure as a function of arrays: ends of arguments in, ends of values out."""
    loops = ["#include <float.h>", "#include <math.h>", "#include <stdbool.h>", f"typedef {real} real;"]
    calls = "\n".join(
        f"""
void all_{name}(long n, const real *low, const real *high, real *from, real *to);
void all_{name}(long n, const real *low, const real *high, real *from, real *to)
{{
  for (long k = 0; k < n; k++) {{
    const iv_pair found = {c}(iv_between(low[k], high[k]));
    from[k] = found.lo;
    to[k] = found.hi;
  }}
}}"""
        for name, c in {
            **{f: FUNCTIONS[f].enclosure for f in FUNCTIONS if f in EXACT},
            "log": "iv_log",
        }.items()
    )
    text = "\n".join([*loops, prelude(calls, real == "float", LARGEST[real]), calls])
    (folder / "all.c").write_text(text, encoding="utf-8")
    command = (*find_compiler().command, "-std=c99", "-O2", "-shared", "-fPIC", *warning_flags())
    subprocess.run([*command, *EXACT_FLAGS, "all.c", "-o", "all.so", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


def enclosed(lib: ctypes.CDLL, name: str, low: Real, high: Real) -> tuple[Real, Real]:
    found = np.empty_like(low), np.empty_like(low)
    given = [part.ctypes.data_as(ctypes.c_void_p) for part in (low, high, *found)]
    getattr(lib, f"all_{name}")(ctypes.c_long(len(low)), *given)
    return found


def points(name: str, real: str, count: int, rng: random.Random) -> Real:
    """Numbers of all sizes, and close to where an enclosure takes another way."""
    largest = {"exp": 699.0, "sin": 1e6, "cos": 1e6, "tan": 1e6, "arcsin": 1.0}.get(name, 1e30)
    if real == "float":
        largest = min(largest, {"exp": 79.0, "sin": 5999.0, "cos": 5999.0, "tan": 5999.0}.get(name, 1e12))
    turns = [0.0, math.pi / 4, math.log(2) / 2, math.sqrt(0.5), 0.5, 1.0, 10.0, 20.0, math.pi / 2]

    def one() -> float:
        match rng.randrange(5):
            case 0:
                return rng.uniform(-largest, largest)
            case 1:
                return rng.choice((-1, 1)) * math.exp(rng.uniform(-40, math.log(largest)))
            case 2:
                return rng.choice(turns) * (1 + rng.uniform(-1, 1) * 2.0 ** rng.uniform(-52, -1))
            case 3:
                step = rng.choice((math.pi / 4, math.log(2) / 2)) * rng.randint(-1000, 1000)
                return step * (1 + rng.uniform(-4, 4) * 2.0**-52)
            case _:
                return rng.randint(-640, 640) / 64
        raise AssertionError

    found = np.array([one() for _ in range(count)], TYPES[real])
    if name in ("log", "sqrt"):
        found = np.abs(found)
        found = found[found > 0]
    return found[np.abs(found) <= largest]


def values(name: str, arguments: Real) -> Iterator[tuple[float, mpmath.mpf]]:
    exact = EXACT[name]
    for x in arguments.tolist():
        yield x, exact(mpmath.mpf(x))


SIZES = [400, pytest.param(1_200_000, marks=pytest.mark.slow)]
"""Points a function and type: the long form has more than ten million in all."""


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("real", TYPES)
@pytest.mark.parametrize("name", EXACT)
def test_no_value_is_outside_of_its_enclosure(name: str, real: str, count: int, tmp_path: Path) -> None:
    lib = library(real, tmp_path)
    epsilon = float(np.finfo(TYPES[real]).eps)
    for start in range(0, count, 100_000):
        arguments = points(name, real, min(count, 100_000), random.Random(f"{name} {real} {start}"))
        low, high = enclosed(lib, name, arguments, arguments)
        with mpmath.workprec(160):
            for (x, y), a, b in zip(values(name, arguments), low.tolist(), high.tolist(), strict=True):
                if a > b:
                    assert name == "tan" and abs(y) > 1e3, (name, x)
                    continue
                assert a <= y <= b, (name, x)
                room = ULPS[name] * epsilon * SCALE[name](x, float(y))
                assert b - a <= room, (name, x, (b - a) / room)


@pytest.mark.parametrize("count", few_and_many(300, 2000))
@pytest.mark.parametrize("real", TYPES)
@pytest.mark.parametrize("name", quick_among(EXACT, ("arcsin", "log", "tan")))
def test_all_values_of_an_interval_are_enclosed(count: int, name: str, real: str, tmp_path: Path) -> None:
    lib = library(real, tmp_path)
    rng = random.Random(f"{name} {real}")
    ends = points(name, real, count, rng)
    widths = np.array([abs(rng.gauss(0, 1)) * 10 ** rng.uniform(-6, 1) for _ in ends], TYPES[real])
    low, high = ends, ends + widths
    if name == "arcsin":
        high = np.minimum(high, np.ones_like(high))
    first, last = enclosed(lib, name, low, high)
    for a, b, p, q in zip(low.tolist(), high.tolist(), first.tolist(), last.tolist(), strict=True):
        if p > q:
            assert name in ("tan", "exp")
            continue
        for share in (0.0, 1.0, *(rng.random() for _ in range(5))):
            x = min(max(a + share * (b - a), a), b)
            y = EXACT[name](mpmath.mpf(x))
            assert p <= y <= q, (name, a, b, x)


@pytest.mark.parametrize("real", TYPES)
def test_values_that_are_numbers_are_known_exactly(real: str, tmp_path: Path) -> None:
    lib = library(real, tmp_path)
    exact = {"exp": (0, 1), "sin": (0, 0), "cos": (0, 1), "tan": (0, 0), "tanh": (0, 0), "log": (1, 0)}
    exact |= {"arctan": (0, 0), "arcsin": (0, 0), "sqrt": (2.25, 1.5)}
    for name, (x, y) in exact.items():
        at = np.array([x], TYPES[real])
        low, high = enclosed(lib, name, at, at)
        assert low[0] == high[0] == y, name


def test_what_has_no_value_is_not_known(tmp_path: Path) -> None:
    lib = library("double", tmp_path)
    for name, x in {"log": 0.0, "arcsin": 1.0000000000000002, "sqrt": -1e-300, "exp": 800.0}.items():
        low, high = enclosed(lib, name, np.array([x]), np.array([x]))
        assert low[0] > high[0], name
    low, high = enclosed(lib, "tan", np.array([1.5]), np.array([1.6]))
    assert low[0] > high[0]


def test_constants_are_right() -> None:
    with mpmath.workdps(100):
        for name, value in {"iv_half_pi": mpmath.pi / 2, "iv_log_2": mpmath.log(2)}.items():
            assert mpmath.nstr(value, 99).startswith(TABLES[name])


def test_every_function_has_an_enclosure() -> None:
    headers = (cgen_dir() / "monitor" / "functions.h", cgen_dir() / "monitor" / "intervals.h")
    text = "".join(path.read_text(encoding="utf-8") for path in headers)
    assert all(f"iv_pair {row.enclosure}(" in text for row in FUNCTIONS.values())
