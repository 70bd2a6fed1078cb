"""A policy as it acts: what its network observes, and what its outputs mean."""

from dataclasses import dataclass

from dl2c.policy.network import Interface, Network


@dataclass(frozen=True, slots=True)
class Acting:
    """A policy as it acts. Its observations are names with limits; `choices` are how many alternatives each
    group of outputs decides between, `runs` the decision vectors that outputs stand for. Otherwise outputs
    are requests: keys of inputs, names of variables (`variables`), then choices that are rounded. With
    `squash` each is between -1 and 1: a share of what is admissible, a place among the alternatives.
    """

    observations: tuple[tuple[str, float, float], ...]
    narrowed: bool
    network: Network
    choices: tuple[int, ...] = ()
    runs: tuple[tuple[int, ...], ...] = ()
    inputs: tuple[str, ...] = ()
    variables: tuple[str, ...] = ()
    rounded: tuple[int, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    squash: bool = False


def acting(interface: Interface, network: Network) -> Acting:
    """A policy that acts as its interface says."""
    io = interface
    choices = io.counts if io.kind in ("choice", "choices") else ()
    rounded = io.counts if io.kind == "box" else ()
    runs = io.runs if io.kind == "runs" else ()
    narrowed = io.dtype == "float32"
    inputs, low, high, squash = io.inputs, io.low, io.high, io.squash
    return Acting(io.observations, narrowed, network, choices, runs, inputs, (), rounded, low, high, squash)
