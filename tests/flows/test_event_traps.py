"""Known traps of event location, one by one, for every kernel in which they can occur.

Every trap is a flow that starts somewhere, should last so long, and ends with some values to
the last bit. The kernel is chosen by the ODE: one more equation that does not matter makes it
linear, or CVODES is asked for.
"""

import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from generators.flow_library import Arrival, Compiled, compiled
from generators.ir_builder import formula, term
from generators.random_odes import Start, flows_model
from selection import quick_among

from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import Watch
from dl2c.ir.evaluate import truth
from dl2c.ir.logic import conjunction
from dl2c.ir.model import FALSE, ONE, TRUE, Compare, Flow, Horizon, Symbol

KERNELS = ("exact", "linear", "cvodes", "dopri5")
CONSTANTS = {"a": 1.0, "c": 0.3, "d": 2.0}


@dataclass(frozen=True)
class Trap:
    """`lasts` is the duration; `ends` are values to the last bit, `near` up to the kernel's accuracy."""

    name: str
    equations: str
    domain: str
    start: dict[str, float]
    lasts: float
    ends: dict[str, float] = field(default_factory=dict)
    near: dict[str, float] = field(default_factory=dict)
    clock: str = ""
    cap: int = 8
    slope: float = 1.0
    """Of the margin where it is left: errors of time are larger by its inverse."""
    kernels: tuple[str, ...] = KERNELS


FALLS = "x' = y, y' = -2"
TOUCHES = "x' = y, y' = 2"
"""From (1, -2): x = (tau - 1)^2."""

TRAPS = (
    Trap(
        "a root ends whose value does not decide",
        "x' = -1",
        "max(-1, sqrt(x)) >= -2",
        {"x": 1},
        1,
        {},
        {"x": 0},
    ),
    Trap("a root that is zero at the start", FALLS, "y >= 0", {"x": 1, "y": 0}, 0, {"x": 1, "y": 0}),
    Trap("braking to a stop", FALLS, "y >= 0", {"x": 1, "y": 0.5}, 0.25, {"y": 0}, {"x": 1.0625}),
    Trap("coasting at rest", "x' = y, y' = 0", "y >= 0", {"x": 1, "y": 0}, 8, {"x": 1, "y": 0}),
    Trap("a boundary left inwards", "x' = y, y' = 1", "x >= 0", {"x": 0, "y": 0}, 8, {}, {"x": 32}),
    Trap("a boundary left outwards", "x' = y, y' = -1", "x >= 0", {"x": 0, "y": 0}, 0, {"x": 0, "y": 0}),
    Trap(
        "a boundary left inwards by the third derivative",
        "x' = y, y' = z, z' = 1",
        "x >= 0",
        {},
        8,
        {},
        {"z": 8},
    ),
    Trap("a boundary left outwards by the third derivative", "x' = y, y' = z, z' = -1", "x >= 0", {}, 0),
    Trap("a boundary that is not at zero", "x' = y, y' = -1", "x >= 1/10", {"x": 0.1}, 0, {"x": 0.1}),
    Trap("in and out in one step", TOUCHES, "x >= 0", {"x": 2, "y": -3}, 1, {"x": 0}, {"y": -1}),
    Trap(
        "a dip of a thousandth of a step",
        TOUCHES,
        "x >= 1/1000000",
        {"x": 1, "y": -2},
        0.999,
        {"x": 1e-6},
        {"y": -2e-3},
        slope=2e-3,
    ),
    Trap(
        "a dip into the forbidden middle",
        TOUCHES,
        "(x - 1/4) * (x - 1/4) >= 1/1000000",
        {"x": 1, "y": -2},
        1 - math.sqrt(0.251),
        {},
        {"x": 0.251},
    ),
    Trap(
        "grazing a closed bound", TOUCHES, "x >= 0", {"x": 1, "y": -2}, 8, {}, {"x": 49}, kernels=KERNELS[:2]
    ),
    Trap("the clock", "x' = y", "true", {"x": 1, "y": 1, "t": 0.1}, 0.3 - 0.1, {"t": 0.3}, clock="c"),
    Trap(
        "a clock that has an instant left",
        "x' = y",
        "true",
        {"y": 1, "t": math.nextafter(0.3, 0)},
        0.3 - math.nextafter(0.3, 0),
        {"t": 0.3},
        clock="c",
    ),
    Trap("a clock that has run out", "x' = y", "true", {"y": 1, "t": 0.3}, 0, {"t": 0.3, "x": 0}, clock="c"),
    Trap(
        "a tie of clock and bound",
        "x' = y, y' = -1",
        "y >= 0",
        {"y": 2},
        2,
        {"t": 2, "y": 0},
        {"x": 2},
        clock="d",
        kernels=KERNELS[:2],
    ),
    Trap(
        "a tie of two bounds",
        "x' = 1, y' = -1",
        "x <= 3 and y >= 1",
        {"y": 4},
        3,
        {"x": 3, "y": 1},
        kernels=KERNELS[:3],
    ),
    Trap("a bound beside a strict one", "x' = 1, y' = -1", "x <= 3 and y > 0", {"y": 5}, 3, {"x": 3}),
    Trap("an equality that motion breaks", "x' = 1", "x == 7", {"x": 7}, 0, {"x": 7}),
    Trap("an equality that motion keeps", "x' = 1", "y == 1", {"y": 1}, 8, {}, {"x": 8}),
    Trap("one alternative hands over to another", "x' = 1", "x <= 1 or x >= 1", {}, 8, {}, {"x": 8}),
    Trap("a jump to another alternative", "x' = 1", "x <= 1 or y >= 1 and x >= 2", {"y": 2}, 1, {}, {"x": 1}),
    Trap("the larger of two", "x' = 1, y' = -1", "max(x, y) >= 1/2", {"y": 1.5}, 8, {}, {"x": 8}),
    Trap("the smaller of two", "x' = 1, y' = -1", "min(x, y) >= -1", {"y": 1.5}, 2.5, {}, {"y": -1}),
    Trap("a sum of sizes", "x' = 1, y' = -1", "abs(x) + abs(y) <= 3", {"y": 2}, 2.5, {}, {"x": 2.5}),
    Trap(
        "the root of a negative number",
        "x' = -1",
        "sqrt(x) >= 0",
        {"x": 1},
        1,
        {},
        {"x": 0},
        kernels=KERNELS[1:],
    ),
    Trap("division by zero", "x' = -1", "1 / x >= 1 / 2", {"x": 1}, 1, {}, {"x": 0}),
    Trap("a constant divisor of zero", "x' = 1", "x / z >= 1 or x <= 1", {}, 1, {}, {"x": 1}),
    Trap(
        "a constant root of a negative number",
        "x' = 1",
        "sqrt(z) >= -1 or x <= 1",
        {"z": -1},
        1,
        {},
        {"x": 1},
    ),
    Trap(
        "a pole",
        "x' = 1",
        "tan(x) >= -1",
        {"x": 1},
        math.pi / 2 - 1,
        {},
        {"x": math.pi / 2},
        kernels=KERNELS[1:],
    ),
    Trap("not a polynomial", "x' = y", "sin(x) <= 1/2", {"y": 1}, math.pi / 6, {}, {}, kernels=KERNELS[1:]),
    Trap("many periods", "x' = y", "cos(x) >= -2", {"y": 9}, 8, {}, {"x": 72}, kernels=KERNELS[1:]),
)

STRICT = (
    Trap("a strict bound", "x' = 1", "x < 7", {"x": 6}, 1, {}, {"x": 7}),
    Trap("a point to avoid, from below", "x' = 1", "x != 7", {"x": 6}, 1, {}, {"x": 7}),
    Trap("a point to avoid, from above", "x' = -1", "x != 7", {"x": 8}, 1, {}, {"x": 7}),
    Trap("a gap of one point", "x' = 1", "x < 1 or x > 1", {}, 1, {}, {"x": 1}),
    Trap("grazing an open bound", TOUCHES, "x > 0", {"x": 1, "y": -2}, 1, {}, {"x": 0}, kernels=KERNELS[:2]),
    Trap(
        "grazing a point to avoid", TOUCHES, "x != 0", {"x": 1, "y": -2}, 1, {}, {"x": 0}, kernels=KERNELS[:2]
    ),
)
"""These end just before a bound, at a state in the domain. Rounding decides where a graze is noticed."""


def flow_of(trap: Trap, kernel: str) -> Flow:
    """The flow, with one more equation where that decides on the kernel."""
    pairs = (part.split("' = ") for part in trap.equations.split(", "))
    equations = tuple((name, term(rate)) for name, rate in pairs)
    if kernel == "linear":
        equations = (*equations, ("w", term("-w")))
    watched = formula(trap.domain.replace("true", "True"))
    if not trap.clock:
        return Flow(equations, watched, watched, (), Fraction(trap.cap))
    bound = Symbol(trap.clock, "constant")
    domain = conjunction((Compare("<=", Symbol("t", "variable"), bound), watched))
    return Flow((*equations, ("t", ONE)), domain, watched, (Horizon("t", bound),), None)


@pytest.fixture(scope="module", params=KERNELS)
def kernel(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture(scope="module")
def library(kernel: str, tmp_path_factory: Any) -> Compiled:
    """All traps as one model."""
    flows = tuple(flow_of(t, kernel) for t in (*TRAPS, *STRICT) if kernel in t.kernels)
    model = flows_model(f"traps_{kernel}", flows, ("x", "y", "z", "w"))
    folder: Path = tmp_path_factory.mktemp(kernel)
    return compiled(model, folder, kernel if kernel in ("cvodes", "dopri5") else "auto")


def sprung(library: Compiled, kernel: str, trap: Trap) -> tuple[Arrival, Start]:
    """The trap's flow, followed."""
    mine = [t for t in (*TRAPS, *STRICT) if kernel in t.kernels]
    state = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0, "t": 0.0} | {x: float(v) for x, v in trap.start.items()}
    start = Start(state, CONSTANTS)
    assert library.flows[mine.index(trap)].kernel == kernel
    return library.run(mine.index(trap), start), start


@pytest.mark.parametrize("trap", (*TRAPS, *STRICT), ids=lambda t: t.name)
def test_traps(trap: Trap, kernel: str, library: Compiled) -> None:
    if kernel not in trap.kernels:
        pytest.skip("cannot occur, or rounding decides")
    arrival, start = sprung(library, kernel, trap)
    assert not arrival.blocked and arrival.reason == ""
    accuracy = {"exact": 1e-14, "linear": 1e-12, "cvodes": 1e-9, "dopri5": 1e-9}[kernel] * 10 / trap.slope
    if trap in STRICT and trap.equations == TOUCHES:
        accuracy = 1e-6
    exactly = trap.lasts == 0 or trap.clock
    assert arrival.duration == (trap.lasts if exactly else pytest.approx(trap.lasts, rel=accuracy))
    assert {x: arrival.state[x] for x in trap.ends} == trap.ends
    for x, value in trap.near.items():
        assert arrival.state[x] == pytest.approx(value, rel=accuracy, abs=accuracy)
    end = Start(arrival.state, start.constants)
    flow = library.flows[[f.flow for f in library.flows].index(flow_of(trap, kernel))].flow
    assert truth(flow.domain, end.environment)


UNSOLVED = (
    ("a coefficient of the solution divides by zero", "x' = 1 / y", {}),
    ("the solution escapes to infinity", "x' = x * x", {"x": 1.0}),
    ("a rate divides by zero", "x' = 1 / y, y' = -1", {"y": 1.0}),
    ("a rate has no value at the start", "x' = 1 / (x - y)", {}),
    ("a rate is the root of a negative number", "x' = sqrt(x - 2)", {"x": 1.0}),
    ("a linear solution grows beyond the numbers", "x' = 400 * x", {"x": 1.0}),
    ("a linear solution turns too often", "x' = 100000000 * y, y' = -100000000 * x", {"x": 1.0}),
)


@pytest.mark.parametrize(
    ("integrator", "kernels"), [("auto", {"exact", "linear", "cvodes"}), ("dopri5", {"dopri5"})]
)
def test_where_there_is_no_solution_the_state_is_kept(
    integrator: Any, kernels: set[str], tmp_path: Path
) -> None:
    traps = [Trap(name, equations, "true", start, 0) for name, equations, start in UNSOLVED]
    library = compiled(
        flows_model("unsolved", tuple(flow_of(t, "") for t in traps), ("x", "y", "z", "w")),
        tmp_path,
        integrator,
    )
    assert {f.kernel for f in library.flows} == kernels
    for k, trap in enumerate(traps):
        state = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0, "t": 0.0} | trap.start
        arrival = library.run(k, Start(state, CONSTANTS))
        reason = "numerical" if library.flows[k].kernel == "exact" else "solver"
        assert (arrival.reason, arrival.duration, arrival.state) == (reason, 0.0, state), trap.name
        assert library.batch.truncated[0] and not library.batch.terminated[0]


def test_a_solver_that_failed_can_be_used_again(tmp_path: Path) -> None:
    fails, works = (Trap("", "x' = x * x", "true", {}, 0), Trap("", "x' = -x * x", "true", {}, 0))
    library = compiled(
        flows_model("again", (flow_of(fails, ""), flow_of(works, "")), ("x", "y", "z", "w")), tmp_path
    )
    start = Start({"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0, "t": 0.0}, CONSTANTS)
    before = library.run(1, start)
    assert library.run(0, start).reason == "solver"
    assert library.run(1, start) == before
    assert before.state["x"] == pytest.approx(1 / 9, rel=1e-8)


@pytest.mark.parametrize("integrator", ["auto", "dopri5"])
@pytest.mark.parametrize(
    "bound", quick_among(("5e-324", "1e-300", "1e-101", "1e-99", "1e-30", "1e-16"), ("5e-324", "1e-101"))
)
def test_flows_may_be_as_short_as_any_number(bound: str, integrator: Any, tmp_path: Path) -> None:
    limit = term(bound)
    domain = Compare("<=", Symbol("t", "variable"), limit)
    equations = (("x", term("-x*x")), ("t", ONE))
    flow = Flow(equations, domain, formula("True"), (Horizon("t", limit),), None)
    library = compiled(flows_model("short" + bound.replace("-", "_"), (flow,)), tmp_path, integrator)
    arrival = library.run(0, Start({"x": 1.0, "y": 0.0, "z": 0.0, "t": 0.0}, CONSTANTS))
    assert arrival.state == {"x": 1.0 - float(bound), "y": 0.0, "z": 0.0, "t": float(bound)}
    assert (arrival.duration, arrival.reason) == (float(bound), "")


@pytest.mark.parametrize("integrator", quick_among(("auto", "dopri5"), ("auto",)))
def test_margins_that_touch_zero_by_rounding_end_nothing(integrator: Any, tmp_path: Path) -> None:
    """Starts on a boundary that a tiny first step leaves inwards, where rounding is larger than the step."""
    trap = Trap("", "x' = exp(-x*x), y' = sin(t), t' = 1", "x + y >= d", {}, 0, cap=2)
    flow = replace(
        flow_of(trap, ""), watched=(on := Compare(">=", term("x + y"), Symbol("d", "constant"))), domain=on
    )
    library = compiled(flows_model("edge", (flow,)), tmp_path, integrator)
    for x, y, t in ((-0.5, 3.0, 0.0), (1.0, 0.0, 0.9), (3.0, 0.0, 0.9), (0.1, 0.2, 0.3), (-1e3, 1e3, 0.5)):
        start = Start({"x": x, "y": y, "z": 0.0, "t": t}, {**CONSTANTS, "d": x + y})
        assert library.run(0, start).duration == 2.0


@pytest.mark.parametrize("integrator", quick_among(("auto", "dopri5"), ("auto",)))
def test_a_root_that_is_small_where_it_ends_a_flow_and_large_after(integrator: Any, tmp_path: Path) -> None:
    """A long internal step leads to where the margin's rounding is much larger than at its event."""
    limit = Compare("<=", Symbol("t", "variable"), term("4"))
    root = formula("sqrt(1 + x*x) < 3")
    equations = (("x", term("y*y*y*y*y")), ("y", term("-1")), ("t", ONE))
    flow = Flow(equations, conjunction((limit, root)), root, (Horizon("t", limit.right),), None)
    library = compiled(flows_model("root", (flow,)), tmp_path, integrator)
    state = {"x": -1.2518697452551033, "y": 0.1186483770859299, "z": 0.0, "t": 0.25}
    arrival = library.run(0, Start(state, CONSTANTS))
    assert arrival.duration == pytest.approx(1.5729132922895832, rel=1e-9)
    assert arrival.state["x"] == pytest.approx(-math.sqrt(8), rel=1e-10)


def test_the_kernel_is_chosen_by_motion_alone() -> None:
    """Conditions of any form are watched along motion that is solved."""
    flow = Flow((("x", term("y")), ("y", ONE)), d := formula("x <= 1 or y >= 0"), d, (), Fraction(1))
    watch = Watch(0, "safety", w := formula("sin(x) >= -1/2"), TRUE, FALSE, w, TRUE, True)
    plan = plan_flow(flow, [watch])
    assert isinstance(plan, FlowPlan)
    assert (plan.kernel, plan.quick, plan.curves) == ("exact", None, None)
    straight = replace(flow, watched=(d := formula("x <= 1")), domain=d)
    plan = plan_flow(straight, [watch])
    assert isinstance(plan, FlowPlan)
    assert plan.kernel == "exact" and plan.quick is not None
