"""A policy that acts deterministically: a fully connected network between observations and actions.

`act` is the reference of what is exported as C, in numpy. Nothing here knows how policies are trained.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from dl2c.diagnostics import Mistake

LARGEST_FLOAT = float(np.finfo(np.float32).max)
"""To which observations in float32 are clipped at most."""

Floats: TypeAlias = NDArray[np.float64]
Activation: TypeAlias = Literal["identity", "tanh", "relu", "elu", "sigmoid"]
ActionKind: TypeAlias = Literal["none", "choice", "choices", "runs", "box"]

ACTIVATIONS: tuple[Activation, ...] = get_args(Activation)


class PolicyError(Mistake):
    """A policy that cannot act in an environment, or cannot be read; the message says why."""


@dataclass(frozen=True, slots=True)
class Interface:
    """What a policy observes and how its actions are written.

    `observations` are names with the limits that values are clipped to, `dtype` is what they are rounded
    to. `kind` says what an action is: nothing, one of `counts` alternatives, one of each, one of `runs`
    (alternatives of each decision, -1 where it is not met), or numbers between `low` and `high`: first
    those of `inputs`, then one for each choice. With `squash` these are all between -1 and 1.
    """

    observations: tuple[tuple[str, float, float], ...]
    dtype: Literal["float32", "float64"]
    kind: ActionKind
    counts: tuple[int, ...] = ()
    runs: tuple[tuple[int, ...], ...] = ()
    inputs: tuple[str, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    squash: bool = False

    @property
    def outputs(self) -> int:
        """How many numbers the network ends with."""
        match self.kind:
            case "none":
                return 1
            case "choice" | "choices":
                return sum(self.counts)
            case "runs":
                return len(self.runs)
            case "box":
                return len(self.low)


@dataclass(frozen=True, slots=True, eq=False)
class Scaling:
    """`(x - center) / scale`, then clipped to `-clip` and `clip`."""

    center: Floats
    scale: Floats
    clip: float

    def of(self, x: NDArray[Any]) -> Floats:
        """What becomes of observations (n, nobs)."""
        return ((x - self.center) / self.scale).clip(-self.clip, self.clip)


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """`activation(weight @ x + bias)`."""

    weight: Floats
    bias: Floats
    activation: Activation


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Scalings and layers, one after the other. `bounded` where actions between -1 and 1 come out of it,
    which are then stretched over the limits of the action space.
    """

    scalings: tuple[Scaling, ...]
    layers: tuple[Layer, ...]
    bounded: bool = False

    def outputs(self, observations: NDArray[Any]) -> Floats:
        """Logits or action values for observations (n, nobs)."""
        x = observations.astype(np.float64)
        for s in self.scalings:
            x = s.of(x)
        for layer in self.layers:
            x = FUNCTIONS[layer.activation](x @ layer.weight.T + layer.bias)
        return np.tanh(x) if self.bounded else x


FUNCTIONS: dict[Activation, Callable[[Floats], Floats]] = {
    "identity": lambda x: x,
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
}


@dataclass(frozen=True, slots=True, eq=False)
class NetworkPolicy:
    """A network and what surrounds it. `masked` where it acts on what the mask allows only."""

    model: str
    interface: Interface
    network: Network
    masked: bool
    options: dict[str, Any]
    """Options of the environment that it was trained in, by name."""

    def act(self, observations: NDArray[Any], masks: NDArray[np.bool_]) -> NDArray[Any]:
        """Actions for observations (n, nobs) and masks (n, columns)."""
        values, io = self.network.outputs(observations), self.interface
        if self.masked and io.kind in ("choice", "choices", "runs"):
            values = np.where(masks, values, -np.inf)
        match io.kind:
            case "none":
                return np.zeros(len(values), np.int64)
            case "choice" | "runs":
                return values.argmax(axis=1)
            case "choices":
                parts = np.split(values, np.cumsum(io.counts)[:-1], axis=1)
                return np.stack([p.argmax(axis=1) for p in parts], axis=1)
            case "box":
                low, high = np.array(io.low), np.array(io.high)
                stretched = low + (values + 1) / 2 * (high - low) if self.network.bounded else values
                return stretched.clip(low, high).astype(io.dtype)


def checked(policy: NetworkPolicy) -> NetworkPolicy:
    """The policy, if all its parts fit each other. Raises `PolicyError`."""
    size = len(policy.interface.observations)
    for k, scaling in enumerate(policy.network.scalings):
        if scaling.center.shape != (size,) or scaling.scale.shape != (size,):
            raise PolicyError(f"scaling {k} does not fit {size} observations")
        if not (scaling.scale > 0).all() or not scaling.clip > 0:
            raise PolicyError(f"scaling {k} divides by what is not positive")
    for k, layer in enumerate(policy.network.layers):
        rows, columns = layer.weight.shape if layer.weight.ndim == 2 else (0, 0)
        if columns != size or layer.bias.shape != (rows,) or rows == 0:
            raise PolicyError(f"layer {k} has weights {layer.weight.shape}, but gets {size} numbers")
        size = rows
    if size != policy.interface.outputs:
        raise PolicyError(f"the network gives {size} numbers, its actions take {policy.interface.outputs}")
    arrays = [a for s in policy.network.scalings for a in (s.center, s.scale)]
    arrays += [a for layer in policy.network.layers for a in (layer.weight, layer.bias)]
    if not all(np.isfinite(a).all() for a in arrays):
        raise PolicyError("a number of the network is not finite")
    return policy


def mismatch(policy: NetworkPolicy, model: str, wanted: Interface) -> str | None:
    """Why a policy cannot act in an environment of this model; None where it can."""
    if policy.model != model:
        return f"the policy was trained on {policy.model!r}, not on {model!r}"
    ours, theirs = [[n for n, *_ in i.observations] for i in (wanted, policy.interface)]
    if ours != theirs:
        return f"the policy observes {', '.join(theirs)}; the model shows {', '.join(ours)}"
    for name in ("observations", "dtype", "kind", "counts", "runs", "inputs", "low", "high", "squash"):
        own, others = getattr(wanted, name), getattr(policy.interface, name)
        if own != others:
            return f"the policy was trained with other {name} ({others}) than the model has ({own})"
    return None
