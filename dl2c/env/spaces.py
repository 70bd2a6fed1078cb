"""The observation space and its types."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dl2c.native.manifest import Manifest


def float_type(manifest: Manifest) -> "np.dtype[Any]":
    """The type of observations and of continuous actions."""
    return np.dtype(manifest.options["obs_dtype"])


def observation_space(manifest: Manifest) -> spaces.Box:
    """The Box of an observation. Declared bounds are rounded outward to its type."""
    dtype = float_type(manifest)
    if manifest.options["observation_bounds"] == "unbounded":
        return spaces.Box(-np.inf, np.inf, (len(manifest.observations),), dtype.type)
    low = _outward(np.array([q.low for q in manifest.observations]), dtype, -np.inf)
    high = _outward(np.array([q.high for q in manifest.observations]), dtype, np.inf)
    return spaces.Box(low, high, low.shape, dtype.type)


def _outward(bounds: NDArray[np.float64], dtype: "np.dtype[Any]", end: float) -> NDArray[Any]:
    with np.errstate(over="ignore", under="ignore"):
        rounded = bounds.astype(dtype)
        inside = rounded > bounds if end < 0 else rounded < bounds
        return np.where(inside, np.nextafter(rounded, dtype.type(end)), rounded)
