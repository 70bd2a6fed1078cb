"""The functions of dL that can be executed: all that is known of each, in one row.

Whoever reads, computes, encloses or prints a function asks this table. What it does not hold are
algorithms: enclosures along flows (flows/taylor.py, cgen/runtime/hull.h and taylor_functions.h) and in
sound monitors (cgen/monitor/functions.h).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from dl2c.ir.model import ONE, ZERO, Add, Call, Compare, Div, Neg, Pow, Sub, Term

Domain: TypeAlias = Callable[..., tuple[Compare, ...]]
"""Conditions under which a function has a value, from its arguments."""

Slope: TypeAlias = Callable[[Term, Term], Term]
"""A derivative, from the value and the argument."""

Range: TypeAlias = tuple[float, float]

EVERYTHING: Range = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class Function:
    """`value` computes it in doubles, or raises an `ArithmeticError` or a `ValueError`; `array` is numpy's.

    `exact`: IEEE arithmetic gives the nearest double, as the C library need not. `domain` is None where
    every real argument has a value; `overflows` where doubles have none for some. A function that grows
    on its domain, which is `among` two numbers, is `rising` between two values. `shows_infinity`: it has
    no finite value for an infinite argument. `unit` is that of the arguments, or its root, or none, and
    then arguments have none either. `slope` is the derivative, if any is used.

    `c` is the name in C (as in dL unless given), `casadi` in CasADi (as in C), `python` in Python sources
    that dl2c writes (`math.` and the name in C), `enclosure` in cgen/monitor (`iv_` and the name in dL).
    That enclosure is, at a number, as wide as `width` times epsilon times its size; it widens with the
    argument, twice as much where it is `steep`.
    """

    value: Callable[..., Any]
    array: Callable[..., Any]
    c: str = ""
    casadi: str = ""
    python: str = ""
    enclosure: str = ""
    width: int = 0
    steep: bool = False
    arity: int = 1
    unit: Literal["same", "none", "root"] = "none"
    exact: bool = False
    domain: Domain | None = None
    overflows: bool = False
    among: Range = EVERYTHING
    rising: Range | None = None
    shows_infinity: bool = False
    slope: Slope | None = None

    @property
    def total(self) -> bool:
        """Whether it has a value for every argument of reasonable size."""
        return self.domain is None and not self.overflows

    @property
    def has_poles(self) -> bool:
        """Whether its domain is in pieces."""
        return self.domain is _without_pole


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


def _named(name: str, row: Function) -> Function:
    """The row with the names that it does not give."""
    c = row.c or name
    return replace(
        row,
        c=c,
        casadi=row.casadi or c,
        python=row.python or f"math.{c}",
        enclosure=row.enclosure or f"iv_{name}",
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
        domain=_nonnegative, shows_infinity=True,
    ),
    "exp": Function(
        math.exp, np.exp, python="exp", width=8, steep=True, overflows=True, rising=(0.0, math.inf),
        slope=lambda f, _: f,
    ),
    "sin": Function(
        math.sin, np.sin, enclosure="iv_sine", width=8, shows_infinity=True,
        slope=lambda _, a: Call("cos", (a,)),
    ),
    "cos": Function(
        math.cos, np.cos, enclosure="iv_cosine", width=8, shows_infinity=True,
        slope=lambda _, a: Neg(Call("sin", (a,))),
    ),
    "tan": Function(
        math.tan, np.tan, enclosure="iv_tangent", width=30, steep=True, shows_infinity=True,
        domain=_without_pole,
        slope=lambda f, _: Add(ONE, Pow(f, 2)),
    ),
    "arcsin": Function(
        math.asin, np.arcsin, c="asin", python="arcsin", width=60, steep=True, domain=_within_one,
        among=(-1.0, 1.0), rising=EVERYTHING,
        slope=lambda _, a: Div(ONE, Call("sqrt", (Sub(ONE, Pow(a, 2)),))),
    ),
    "arctan": Function(
        math.atan, np.arctan, c="atan", width=30, rising=EVERYTHING,
        slope=lambda _, a: Div(ONE, Add(ONE, Pow(a, 2))),
    ),
    "tanh": Function(
        math.tanh, np.tanh, width=8, rising=(-1.0, 1.0), slope=lambda f, _: Sub(ONE, Pow(f, 2))
    ),
    "pow": Function(
        math.pow, np.power, casadi="constpow", python="power", enclosure="iv_power", width=20, steep=True,
        arity=2, domain=_positive_base,
    ),
}  # fmt: skip

FUNCTIONS: Mapping[str, Function] = {name: _named(name, row) for name, row in _ROWS.items()}
"""All of them by their names in dL."""

DEFINED = {"div": (("x", "y"), "x/y")}
"""Functions that are another way to write a term: their parameters and the term."""

KYX_MATH = {
    **{name: row.arity for name, row in FUNCTIONS.items() if name != "pow"},
    **{name: len(parameters) for name, (parameters, _) in DEFINED.items()},
    "e": 0,
    "pi": 0,
}
"""Every name of the package kyx.math, the only one there is, with its arity. A power is written `x^y`."""
