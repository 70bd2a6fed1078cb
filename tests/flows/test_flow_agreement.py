"""Flows of every kernel against solutions at 32 digits, and kernels against each other."""

import math
from collections import Counter
from itertools import combinations
from pathlib import Path
from random import Random

import pytest
from flows.test_flow_laws import FLOWS, KERNELS, integrator, library, starts
from generators.flow_library import Arrival, compiled
from generators.random_odes import VARIABLES, Start, flows_model, random_flow
from oracles.flows import Singular, Verdict, atoms_of, judge, moved, value
from selection import few_and_many, quick_among, quick_rows

from dl2c.flows.kernel import FlowPlan, Kernel, plan_flow
from dl2c.ir.logic import operands
from dl2c.ir.model import Call, Compare, Flow, Neg, Symbol, Term
from dl2c.ir.printer import print_flow

ACCURACY: dict[Kernel, float] = {"exact": 1e-12, "linear": 1e-11, "cvodes": 3e-8, "dopri5": 3e-8}
"""Of states and durations, relative to how much more than the start they move (`moved`)."""

AT_A_BOUND = 1e-9


def difference(arrival: Arrival, duration: float, state: dict[str, float]) -> float:
    """The largest one of the duration and of some variables."""
    return max(abs(arrival.duration - duration), *(abs(arrival.state[x] - state[x]) for x in state))


# Against the oracle -----------------------------------------------------------


def kinked(term: Term) -> bool:
    own = isinstance(term, Call) and term.function in ("abs", "min", "max")
    return own or any(map(kinked, operands(term)))


def side(atom: Compare, told: Verdict) -> int | None:
    """The sign of left minus right where a flow ends, 0 near the boundary; None where it is undefined."""
    left, right = value(atom.left, told.state), value(atom.right, told.state)
    if left is None or right is None:
        return None
    return 0 if abs(left - right) < AT_A_BOUND else int(math.copysign(1, left - right))


def happened(flow: Flow, told: Verdict) -> set[str]:
    """What the end of a flow was like."""
    sides = {a: side(a, told) for a in atoms_of(flow.watched)}
    if not told.event:
        fails = any(s == 1 if a.op in ("<", "<=") else s == -1 for a, s in sides.items() if a.op[0] in "<>")
        return {"time", "another alternative"} if fails else {"time"}
    found = {"at once" if told.duration == 0 else "later"}
    for atom, sign in sides.items():
        if sign == 0:
            found.add({"=": "equal", "!=": "apart", "<": "open", ">": "open"}.get(atom.op, "closed"))
            found |= {"kink"} if kinked(atom.left) else set()
    return found


def told_right(kernel: Kernel, flow: Flow, start: Start, arrival: Arrival, told: Verdict) -> bool:
    """Whether a flow ends as the oracle says; False where that is ill-conditioned."""
    state = {x: float(told.state[Symbol(x, "variable")]) for x, _ in flow.equations}
    error = difference(arrival, float(told.duration), state)
    if error <= ACCURACY[kernel]:
        return True
    size = moved(flow, start.environment, told)
    assert error <= ACCURACY[kernel] * size, f"{print_flow(flow)}\n{start}\n{arrival}\n{told}"
    return math.isfinite(size)


def agreement(kernel: Kernel, seed: int, count: int, folder: Path) -> Counter[str]:
    """How many flows were compared, and how many of each kind."""
    found: Counter[str] = Counter()
    tested = library(kernel, seed, folder)
    for k, start in starts(tuple(p.flow for p in tested.flows), seed, count):
        flow = tested.flows[k].flow
        arrival = tested.run(k, start)
        try:
            told = judge(flow, start.environment)
        except Singular:
            found["singular"] += 1
            continue
        if arrival.reason:
            found[arrival.reason] += 1
        elif told_right(kernel, flow, start, arrival, told):
            found.update(happened(flow, told) | {"compared"})
        else:
            found["ill-conditioned"] += 1
    return found


EVENTS = ("time", "another alternative", "at once", "later", "closed", "open", "kink")


@pytest.mark.parametrize("kernel", quick_among(KERNELS, ("exact", "cvodes")))
def test_flows_end_where_and_when_their_solutions_do(kernel: Kernel, tmp_path: Path) -> None:
    found = agreement(kernel, 100, 100, tmp_path)
    assert found["compared"] > 75 and found["ill-conditioned"] < 10
    assert all(found[kind] >= 3 for kind in EVENTS)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", KERNELS)
def test_many_flows_end_where_and_when_their_solutions_do(kernel: Kernel, tmp_path: Path) -> None:
    found = sum((agreement(kernel, seed, 400, tmp_path) for seed in range(101, 105)), Counter[str]())
    assert found["compared"] > 1300 and found["ill-conditioned"] < 0.05 * found["compared"]
    assert all(found[kind] >= 80 for kind in EVENTS)
    assert all(found[kind] >= 5 for kind in ("apart", "equal"))


# Against each other -----------------------------------------------------------

W = Symbol("w", "variable")


def horizon(flow: Flow, start: Start) -> float:
    """How long a flow may last."""
    limits = [float(value(h.bound, start.environment)) - start.state[h.clock] for h in flow.horizons]
    return min(limits) if flow.cap is None else float(flow.cap)


def followed_by(kernel: Kernel, flow: Flow) -> Flow | None:
    """The flow, with one more equation where that makes it one of the kernel."""
    beside = Flow((*flow.equations, ("w", Neg(W))), flow.domain, flow.watched, flow.horizons, flow.cap)
    for tried in (flow, beside):
        plan = plan_flow(tried, [], integrator(kernel))
        if isinstance(plan, FlowPlan) and plan.kernel == kernel:
            return tried
    return None


PAIRS = quick_rows(combinations(KERNELS, 2), (("linear", "cvodes"), ("cvodes", "dopri5")))
"""In the quick ones, and in those against the oracle, each kernel is compared."""


@pytest.mark.parametrize("count", few_and_many(200, 1500))
@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_kernels_agree(count: int, one: Kernel, other: Kernel, tmp_path: Path) -> None:
    rng = Random(f"{one} {other}")
    flows: list[Flow] = []
    pairs: list[tuple[Flow, Flow]] = []
    while len(pairs) < FLOWS:
        flow = random_flow(rng, "linear" if one == "linear" and rng.random() < 0.5 else "polynomial")
        first, second = followed_by(one, flow), followed_by(other, flow)
        if first is not None and second is not None:
            flows.append(flow)
            pairs.append((first, second))
    libraries = [
        compiled(flows_model(f"{one}_{other}_{kernel}", own, (*VARIABLES, "w")), tmp_path, integrator(kernel))
        for kernel, own in zip((one, other), zip(*pairs, strict=True), strict=True)
    ]
    compared, ended, ill = 0, 0, 0
    for k, start in starts(tuple(flows), 7, count):
        both = [m.run(k, Start({**start.state, "w": 1.0}, start.constants)) for m in libraries]
        state = {x: both[1].state[x] for x, _ in flows[k].equations}
        error = difference(both[0], both[1].duration, state)
        compared += 1
        ended += 0 < both[0].duration < horizon(flows[k], start)
        if error > ACCURACY[other]:
            told = judge(flows[k], start.environment)
            size = moved(flows[k], start.environment, told)
            assert error <= ACCURACY[other] * size, f"{print_flow(flows[k])}\n{start}\n{both}\n{told}"
            ill += math.isinf(size)
    assert compared > 4 / 5 * count and ended > 2 / 15 * count and ill < 0.05 * compared
