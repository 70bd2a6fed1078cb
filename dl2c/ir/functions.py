"""The functions of dL that can be executed: all that is known of each, in one row.

Whoever reads, computes, encloses or prints a function asks this table. C has its enclosures along flows
in cgen/runtime/functions.h, with the same operations in the same order, and those of sound monitors in
cgen/monitor/functions.h. Only abs, min, max, sqrt and pow are written out by each arithmetic.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np

from dl2c.ir.model import ONE, ZERO, Add, Call, Compare, Div, Neg, Pow, Sub, Term

Domain: TypeAlias = Callable[..., tuple[Compare, ...]]
"""Conditions under which a function has a value, from its arguments."""

Slope: TypeAlias = Callable[[Term, Term], Term]
"""A derivative, from the value and the argument."""

Range: TypeAlias = tuple[float, float]

EVERYTHING: Range = (-math.inf, math.inf)

Series: TypeAlias = tuple[Sequence[float], float, float]
"""Of a function about a number: its five coefficients, what they leave out, and by how much they are off
beyond 2^-46 of the first."""

TINY = 2.0**-1000
"""Smaller numbers count as zero."""

SLOP = 2.0**-50
"""Relative rounding error of an operation on Taylor models, and of a function of libm."""


@dataclass(frozen=True, slots=True)
class Function:
    """`value` computes it in doubles, or raises an `ArithmeticError` or a `ValueError`; `array` is numpy's.

    `exact`: IEEE arithmetic gives the nearest double, as the C library need not. `domain` is None where
    every real argument has a value; `overflows` where doubles have none for some. The domain is `among` two
    numbers and the values `between` two. A function is `rising` if it grows on its domain, or between its
    poles; a wave has the period 2*pi, values between -1 and 1, and a `crest`. `ends` gives the least and
    the largest value of libm on an interval from `low` to `high`: by default, of a rising function, those
    at the ends. `shows_infinity`: it has no finite value for an infinite argument. `unit` is that of the
    arguments, or its root, or none, and then arguments have none either. `slope` is the derivative, if
    any is used. `series` expands it about a number for arguments up to `d` away; None where it cannot.

    `c` is the name in C (as in dL unless given), `casadi` in CasADi (as in C), `python` in Python sources
    that dl2c writes (`math.` and the name in C), `enclosure` in cgen/monitor (`iv_` and the name in dL).
    That enclosure is, at a number, as wide as `width` times epsilon times its size, for which `size` has
    the rule for an argument a. It widens with the argument, twice as much where it is `steep`.
    """

    value: Callable[..., Any]
    array: Callable[..., Any]
    c: str = ""
    casadi: str = ""
    python: str = ""
    enclosure: str = ""
    width: int = 0
    size: str = ""
    steep: bool = False
    arity: int = 1
    unit: Literal["same", "none", "root"] = "none"
    exact: bool = False
    domain: Domain | None = None
    overflows: bool = False
    among: Range = EVERYTHING
    between: Range = EVERYTHING
    rising: bool = False
    crest: float | None = None
    ends: Callable[[float, float], Range] | None = None
    shows_infinity: bool = False
    slope: Slope | None = None
    series: Callable[[float, float], Series | None] | None = None

    @property
    def total(self) -> bool:
        """Whether it has a value for every argument of reasonable size."""
        return self.domain is None and not self.overflows

    @property
    def has_poles(self) -> bool:
        """Whether its domain is in pieces."""
        return self.domain is _without_pole

    @property
    def raises(self) -> bool:
        """Whether that of Python's `math` raises an error for some numbers."""
        return self.python.startswith("math.") and not (self.total or self.has_poles)


def least(a: float, b: float) -> float:
    """The second where neither is smaller, as dL's min."""
    return a if a < b else b


def greatest(a: float, b: float) -> float:
    """The second where neither is larger."""
    return a if a > b else b


def _nonnegative(a: Term) -> tuple[Compare, ...]:
    return (Compare(">=", a, ZERO),)


def _without_pole(a: Term) -> tuple[Compare, ...]:
    return (Compare("!=", Call("cos", (a,)), ZERO),)


def _positive_base(base: Term, _: Term) -> tuple[Compare, ...]:
    return (Compare(">", base, ZERO),)


def _within_one(a: Term) -> tuple[Compare, ...]:
    return Compare(">=", Sub(ONE, a), ZERO), Compare(">=", Add(ONE, a), ZERO)


def libm(function: Callable[..., float], *args: float) -> float:
    """A function of libm as C has it: NaN or infinity instead of an exception."""
    try:
        return function(*args)
    except OverflowError:
        return math.inf
    except (ValueError, ZeroDivisionError):
        return math.nan


def _at_ends(function: Callable[[float], float], low: float, high: float) -> Range:
    return libm(function, low), libm(function, high)


def geometric_rest(q: float) -> float:
    """q^5 / (1 - q): the remainder of a geometric series, 0 <= q < 1."""
    return q * q * q * q * q / (1.0 - q)


def _root_series(a: float, d: float) -> Series | None:
    if not a > TINY:
        return None
    q = d / a
    if not q < 0.999:
        return None
    root = math.sqrt(a)
    slope = root / (2.0 * a)
    second = -slope / (4.0 * a)
    third = -second / (2.0 * a)
    f = (root, slope, second, third, -third * 5.0 / (8.0 * a))
    return f, 0.03125 * root * geometric_rest(q), 0.0


def _exp_series(a: float, d: float) -> Series | None:
    if not (d < 1 and abs(a) < 700):
        return None
    v = math.exp(a)
    return (v, v, v / 2.0, v / 6.0, v / 24.0), v * 0.023 * (d * d * d * d * d), 0.0


def _wave_series(v: float, slope: float, d: float) -> Series | None:
    """From the value and the derivative in the middle."""
    if not d < 4:
        return None
    f = (v, slope, -v / 2.0, -slope / 6.0, v / 24.0)
    return f, d * d * d * d * d / 120.0, 8.0 * SLOP * (1.0 + d * (1.0 + d))


def _tanh_series(a: float, d: float) -> Series:
    """The fourth derivative is below 4.8 everywhere, as is that of arctan."""
    v = math.tanh(a)
    slope = 1.0 - v * v
    f = (v, slope, -v * slope, slope * (3.0 * (v * v) - 1.0) / 3.0, 0.0)
    return f, 0.2 * (d * d * d * d), 8.0 * SLOP * (1.0 + d)


def _arctan_series(a: float, d: float) -> Series:
    slope = 1.0 / (1.0 + a * a)
    third = slope * slope * slope * (3.0 * (a * a) - 1.0) / 3.0
    f = (math.atan(a), slope, -a * (slope * slope), third, 0.0)
    return f, 0.2 * (d * d * d * d), 8.0 * SLOP * (1.0 + d)


def _arcsin_series(a: float, d: float) -> Series | None:
    """The third derivative grows with the size of the argument."""
    far = abs(a) + d
    if not far < 0.999999:
        return None
    left = (1.0 - far) * (1.0 + far)
    slope = 1.0 / math.sqrt((1.0 - a) * (1.0 + a))
    f = (math.asin(a), slope, 0.5 * a * (slope * slope * slope), 0.0, 0.0)
    rest = d * d * d * (1.0 + 2.0 * (far * far)) / (5.9 * (left * left * math.sqrt(left)))
    return f, rest, 8.0 * SLOP * (1.0 + slope * d)


def _named(name: str, row: Function) -> Function:
    """The row with the names that it does not give."""
    c = row.c or name
    return replace(
        row,
        c=c,
        casadi=row.casadi or c,
        python=row.python or f"math.{c}",
        enclosure=row.enclosure or f"iv_{name}",
        ends=row.ends or (partial(_at_ends, row.value) if row.rising else None),
    )


_ROWS = {
    "abs": Function(
        abs, np.abs, c="fabs", python="abs", enclosure="iv_magnitude",
        unit="same", exact=True, shows_infinity=True,
    ),
    "min": Function(
        least, np.minimum, c="dl2c_min", casadi="fmin", python="least", enclosure="iv_least",
        arity=2, unit="same", exact=True,
    ),
    "max": Function(
        greatest, np.maximum, c="dl2c_max", casadi="fmax", python="greatest", enclosure="iv_greatest",
        arity=2, unit="same", exact=True,
    ),
    "sqrt": Function(
        math.sqrt, np.sqrt, python="sqrt", enclosure="iv_root", unit="root", exact=True,
        domain=_nonnegative, among=(0.0, math.inf), shows_infinity=True, series=_root_series,
    ),
    "sin": Function(
        math.sin, np.sin, enclosure="iv_sine", width=8, size="1 + size(a)",
        crest=math.pi / 2, shows_infinity=True, slope=lambda _, a: Call("cos", (a,)),
        series=lambda a, d: _wave_series(libm(math.sin, a), libm(math.cos, a), d),
    ),
    "cos": Function(
        math.cos, np.cos, enclosure="iv_cosine", width=8, size="1 + size(a)",
        crest=0.0, shows_infinity=True, slope=lambda _, a: Neg(Call("sin", (a,))),
        series=lambda a, d: _wave_series(libm(math.cos, a), -libm(math.sin, a), d),
    ),
    "tanh": Function(
        math.tanh, np.tanh, width=8, size="1 + size(a)", between=(-1.0, 1.0), rising=True,
        slope=lambda f, _: Sub(ONE, Pow(f, 2)), series=_tanh_series,
    ),
    "arctan": Function(
        math.atan, np.arctan, c="atan", width=30, size="1 + size(a)", rising=True,
        slope=lambda _, a: Div(ONE, Add(ONE, Pow(a, 2))), series=_arctan_series,
    ),
    "tan": Function(
        math.tan, np.tan, enclosure="iv_tangent", width=30, size="(1 + size(a))*(1 + tan(a)^2)", steep=True,
        domain=_without_pole, rising=True, shows_infinity=True, slope=lambda f, _: Add(ONE, Pow(f, 2)),
    ),
    "arcsin": Function(
        math.asin, np.arcsin, c="asin", width=60, size="1 + size(a)/sqrt(1 - a^2)", steep=True,
        domain=_within_one, among=(-1.0, 1.0), rising=True,
        slope=lambda _, a: Div(ONE, Call("sqrt", (Sub(ONE, Pow(a, 2)),))), series=_arcsin_series,
    ),
    "exp": Function(
        math.exp, np.exp, python="exp", width=8, size="exp(a)*(1 + size(a))", steep=True,
        overflows=True, between=(0.0, math.inf), rising=True, slope=lambda f, _: f, series=_exp_series,
    ),
    "pow": Function(
        math.pow, np.power, casadi="constpow", enclosure="iv_power", width=20, steep=True,
        arity=2, domain=_positive_base,
    ),
}  # fmt: skip

FUNCTIONS: Mapping[str, Function] = {name: _named(name, row) for name, row in _ROWS.items()}
"""All of them by their names in dL."""

OF_DERIVATIVES = {"log": "log", "sign": "dl2c_sign"}
"""Functions that CasADi's derivatives of these use besides, by its names, with their names in C."""

DEFINED = {"div": (("x", "y"), "x/y")}
"""Functions that are another way to write a term: their parameters and the term."""

KYX_MATH = {
    **{name: row.arity for name, row in FUNCTIONS.items() if name != "pow"},
    **{name: len(parameters) for name, (parameters, _) in DEFINED.items()},
    "e": 0,
    "pi": 0,
}
"""Every name of the package kyx.math, the only one there is, with its arity. A power is written `x^y`."""
