"""A policy as it acts: what its network observes, and what its outputs mean."""

from dataclasses import dataclass

from dl2c.policy.network import Interface, Network
from dl2c.policy_proof.question import NotCovered


@dataclass(frozen=True, slots=True)
class Acting:
    """A policy as it acts. Its observations are names with limits; `choices` are how many alternatives each
    group of outputs decides between, `runs` the decision vectors that outputs stand for. Otherwise outputs
    are requests: keys of inputs, names of variables (`variables`), then choices that are rounded.
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


def acting(interface: Interface, network: Network) -> Acting:
    """A policy that acts as its interface says. Raises `NotCovered`."""
    io = interface
    if io.squash:
        why = "the values it asks for are shares of what is admissible (action_map=squash)"
        why += "; whether its alternatives are enabled is not covered" if io.counts else ", where anything is"
        raise NotCovered(why, advice="verify a policy that was trained with action_map=project")
    choices = io.counts if io.kind in ("choice", "choices") else ()
    rounded = io.counts if io.kind == "box" else ()
    runs = io.runs if io.kind == "runs" else ()
    narrowed = io.dtype == "float32"
    return Acting(io.observations, narrowed, network, choices, runs, io.inputs, (), rounded, io.low, io.high)
