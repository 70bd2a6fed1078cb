"""Laws of flows, on random ODEs, domains and starts, for every kernel (semantics 4)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from generators.flow_library import Arrival, Compiled, compiled
from generators.random_odes import Kind, Start, flows_model, random_flow, random_start
from oracles.flows import inside
from selection import few_and_many, quick_among

from dl2c.flows.kernel import FlowPlan, Kernel, plan_flow
from dl2c.ir.model import Flow
from dl2c.ir.printer import print_flow
from dl2c.options import Integrator

KERNELS: tuple[Kernel, ...] = ("exact", "linear", "cvodes", "dopri5")
KINDS: dict[Kernel, tuple[Kind, ...]] = {
    "exact": ("polynomial",),
    "linear": ("linear", "linear", "polynomial"),
    "cvodes": ("nonlinear", "nonlinear", "linear", "polynomial"),
    "dopri5": ("nonlinear", "nonlinear", "linear", "polynomial"),
}
FLOWS = 30
"""In one library."""


def integrator(kernel: Kernel) -> Integrator:
    match kernel:
        case "cvodes" | "dopri5":
            return kernel
        case "exact" | "linear":
            return "auto"


def random_flows(kernel: Kernel, seed: int) -> tuple[Flow, ...]:
    """Flows that a kernel follows."""
    rng = Random(f"{kernel} {seed}")
    found: list[Flow] = []
    while len(found) < FLOWS:
        flow = random_flow(rng, rng.choice(KINDS[kernel]))
        plan = plan_flow(flow, [], integrator(kernel))
        if isinstance(plan, FlowPlan) and plan.kernel == kernel:
            found.append(flow)
    return tuple(found)


def library(kernel: Kernel, seed: int, folder: Path, duration: str = "max") -> Compiled:
    model = flows_model(f"{kernel}_{seed}_{duration}", random_flows(kernel, seed))
    return compiled(replace(model, duration=duration), folder, integrator(kernel))


def starts(flows: tuple[Flow, ...], seed: int, count: int) -> Iterator[tuple[int, Start]]:
    """Starts in the domains of the flows by turns."""
    rng = Random(f"starts {seed}")
    for k in range(count):
        start = random_start(rng, flows[k % FLOWS])
        if start is not None:
            yield k % FLOWS, start


# The domain law ---------------------------------------------------------------


def check_domain(flow: Flow, start: Start, arrival: Arrival) -> None:
    """What holds after a flow whatever its equations are."""
    end = Start(arrival.state, start.constants)
    assert inside(flow.domain, start.environment)
    assert inside(flow.domain, end.environment), f"{print_flow(flow)}\n{start}\n{arrival}"
    still = arrival.state.keys() - ({x for x, _ in flow.equations} if arrival.duration > 0 else set[str]())
    assert all(arrival.state[x] == start.state[x] for x in still)
    if flow.cap is not None:
        assert 0 <= arrival.duration <= flow.cap
    elif arrival.duration > 0:
        assert arrival.state["t"] == pytest.approx(start.state["t"] + arrival.duration, rel=1e-12)


def domain_law(kernel: Kernel, seed: int, count: int, folder: Path) -> tuple[int, int]:
    """How many flows were followed, and how many of them ended after some time."""
    followed = lasted = 0
    duration = "sample" if seed % 2 else "max"
    tested = library(kernel, seed, folder, duration)
    for k, start in starts(tuple(p.flow for p in tested.flows), seed, count):
        arrival = tested.run(k, start)
        check_domain(tested.flows[k].flow, start, arrival)
        followed += not arrival.blocked and arrival.reason == ""
        lasted += arrival.duration > 0
    return followed, lasted


@pytest.mark.parametrize("count", few_and_many(170, 1700))
@pytest.mark.parametrize("kernel", quick_among(KERNELS, ("linear", "dopri5")))
def test_no_state_after_a_flow_violates_its_domain(count: int, kernel: Kernel, tmp_path: Path) -> None:
    followed, lasted = (
        sum(n) for n in zip(*(domain_law(kernel, s, count, tmp_path) for s in (0, 1)), strict=True)
    )
    assert followed > 28 / 17 * count and lasted > 15 / 17 * count


@pytest.mark.slow
@pytest.mark.parametrize("kernel", KERNELS)
def test_no_state_after_any_of_many_flows_violates_its_domain(kernel: Kernel, tmp_path: Path) -> None:
    followed = sum(domain_law(kernel, seed, 3200, tmp_path)[0] for seed in range(2, 14))
    assert followed > 33_334
