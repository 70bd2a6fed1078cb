"""The entries of an observation, and their limits (semantics 7)."""

import math
from fractions import Fraction

import numpy as np

from dl2c.ir.model import Bound, Model, Symbol
from dl2c.options import Options


def observed(model: Model, options: Options) -> list[tuple[str, Symbol, Bound]]:
    """The entries of an observation: observed variables, then sampled constants (semantics 7)."""
    entries = [(v.name, Symbol(v.name, "variable"), v.bound) for v in model.variables if v.observed]
    if options.observe_constants:
        sampled = [c for c in model.constants if c.value is None and c.observed]
        entries += [(c.name, Symbol(c.name, "constant"), c.bound) for c in sampled]
    return entries


def fixed_entries(model: Model, options: Options) -> int:
    """How many of the entries, the last ones, are constants and so the same in all of an episode."""
    return sum(symbol.kind == "constant" for _, symbol, _ in observed(model, options))


def observation_limits(bound: Bound, options: Options) -> tuple[float, float]:
    """The declared bound rounded outward to the observation's type; infinite where open or not wanted."""
    if options.observation_bounds == "unbounded":
        return -math.inf, math.inf
    low = -math.inf if bound.low is None else _outward(bound.low, -1, options)
    return low, math.inf if bound.high is None else _outward(bound.high, 1, options)


def _outward(value: Fraction, direction: int, options: Options) -> float:
    kind = np.float32 if options.obs_dtype == "float32" else np.float64
    largest = float(np.finfo(kind).max)
    if abs(value) > largest:
        return math.copysign(math.inf if (value > 0) == (direction > 0) else largest, value)
    near = kind(float(value))
    if (Fraction(float(near)) - value) * direction < 0:
        near = np.nextafter(near, kind(direction * math.inf))
    return float(near)
