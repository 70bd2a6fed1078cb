"""The Runge-Kutta kernel: its order, its tolerance, its interpolant; and that it agrees with CVODES."""

import ctypes
import math
import subprocess
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from flows.test_flow_agreement import difference, horizon
from flows.test_flow_laws import FLOWS, starts
from generators.flow_library import Compiled, compiled
from generators.ir_builder import formula, term
from generators.random_odes import VARIABLES, Start, flows_model, random_flow
from oracles.flows import Singular, judge, moved
from selection import few_and_many

import dl2c
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.ir.model import Flow, Symbol
from dl2c.ir.printer import print_flow
from dl2c.native import cgen_dir

CONSTANTS = {"a": 1.0, "b": 2.0, "c": 0.3, "d": 2.0}


def pendulum(folder: Path, rtol: str, stop: str = "3", domain: str = "True") -> Callable[[], Any]:
    """A swing from a quarter turn; runs it."""
    inside = formula(domain)
    flow = Flow((("x", term("y")), ("y", term("-sin(x)"))), inside, inside, (), Fraction(stop))
    tolerances: dict[str, Any] = {"rtol": Fraction(rtol), "atol": Fraction(rtol)}
    library = compiled(flows_model("swing", (flow,)), folder, "dopri5", **tolerances)
    state = dict.fromkeys(VARIABLES, 0.0) | {"x": 1.5, "t": 0.0}
    return lambda: library.run(0, Start(state, CONSTANTS))


def test_errors_fall_with_the_tolerance(tmp_path: Path) -> None:
    best = pendulum(tmp_path / "best", "1e-13")().state["x"]
    errors = [abs(pendulum(tmp_path / rtol, rtol)().state["x"] - best) for rtol in ("1e-4", "1e-7", "1e-10")]
    assert all(error < 3 * float(rtol) for error, rtol in zip(errors, ("1e-4", "1e-7", "1e-10"), strict=True))
    assert errors[0] > 30 * errors[1] > 900 * errors[2] > 0


@pytest.mark.parametrize("tolerances", few_and_many(("1e-7",), ("1e-5", "1e-7", "1e-9", "1e-11")))
def test_events_lie_on_the_interpolant_as_exactly_as_steps(
    tolerances: tuple[str, ...], tmp_path: Path
) -> None:
    """The first time that y = -1/2: between two steps, whatever the tolerance."""
    true = pendulum(tmp_path / "true", "1e-13", domain="y >= -1/2")().duration
    for rtol in tolerances:
        arrival = pendulum(tmp_path / rtol, rtol, domain="y >= -1/2")()
        assert arrival.state["y"] == -0.5
        assert abs(arrival.duration - true) < 10 * float(rtol)


HOPPER = """
Definitions
  /* @const: bound=[0.5:2] */
  Real k;
  /* @safety: penalty=-1, on_failure=terminate:failure */
  Bool slow(Real y) <-> (y <= 2.5);
End.
ProgramVariables
  /* @var: bound=[-2:2] */
  Real x;
  /* @var: bound=[-3:3] */
  Real y;
  /* @var: bound=[-1:1] */
  Real u;
  Real t;
End.
Problem
  x >= -1 & x <= 1 & y >= -2 & y <= 2 & k > 0
    -> [{ { { u := *; ?(-1 <= u & u <= 1); } ++ { ?x > 0; u := 0; } } t := 0;
          {x' = y, y' = u - k * x^3, t' = 1 & t <= 1/2 & x >= -1}; }*] slow(y)
End.
"""


def buffers(
    library: Any, seeds: Any, inputs: Any, choices: Any, mode: str, action_map: str
) -> list[list[bytes]]:
    """All results of every step, for each environment: one batch of them."""
    batch = library.batch(len(seeds), autoreset=mode, action_map=action_map)
    batch.reset(seeds=seeds)
    seen: list[list[bytes]] = [[] for _ in seeds]
    for wanted, chosen in zip(inputs, choices, strict=True):
        batch.inputs[:, 0], batch.choices[:, 0] = wanted, chosen
        batch.step()
        for i, rows in enumerate(seen):
            rows.append(b"".join(array[i].tobytes() for array in batch.arrays()))
    ended = float(batch.duration.min()) < 0.5
    batch.close()
    assert ended or len(seeds) == 1
    return seen


UNEVEN = (
    HOPPER.replace("bound=[0.5:2]", "bound=[0.01:4000]")
    .replace("y <= 2.5", "y <= 60")
    .replace("t <= 1/2", "t <= 1/4 + k/16000")
)
"""Some environments need two steps, others more than a hundred."""


@pytest.mark.parametrize(
    ("model", "mode", "action_map"),
    [
        (HOPPER, "same_step", "project"),
        (HOPPER, "next_step", "project"),
        (HOPPER, "same_step", "squash"),
        (UNEVEN, "same_step", "project"),
    ],
)
def test_environments_abreast_move_as_alone(model: str, mode: str, action_map: str) -> None:
    """To the last bit, also where the domain or a violation ends a flow, and in a batch of any size."""
    library = dl2c.build(model, integrator="dopri5").library
    rng = np.random.default_rng(3)
    n, steps = 83, 25
    seeds = rng.integers(0, 2**63, n, np.uint64)
    inputs, choices = rng.uniform(-2, 2, (steps, n)), rng.integers(0, 2, (steps, n))
    together = buffers(library, seeds, inputs, choices, mode, action_map)
    for i in range(n):
        one = slice(i, i + 1)
        alone = buffers(library, seeds[one], inputs[:, one], choices[:, one], mode, action_map)
        assert alone == [together[i]]


def test_it_is_used_only_where_it_was_asked_for() -> None:
    flows = dl2c.build("example:dubins", integrator="dopri5").library.manifest.flows
    assert [(f.kernel, f.reason) for f in flows] == [("dopri5", "integrator=dopri5 was asked for")]


def test_a_car_drives_as_with_cvodes() -> None:
    batches = [
        dl2c.build("example:dubins", integrator=kind).library.batch(64, autoreset="same_step")
        for kind in ("dopri5", "cvodes")
    ]
    rng = np.random.default_rng(2)
    for batch in batches:
        batch.reset(seeds=np.arange(64, dtype=np.uint64))
    for _ in range(50):
        wanted = rng.uniform(-2, 2, batches[0].inputs.shape)
        for batch in batches:
            batch.inputs[:] = wanted
            batch.step()
        for i in range(64):
            batches[1].set_state(i, *batches[0].get_state(i))
        assert np.allclose(batches[0].obs, batches[1].obs, rtol=1e-6, atol=1e-6)


def agreement(seed: int, count: int, folder: Path) -> tuple[int, int]:
    """How many random flows were compared with CVODES at its tolerance, and how many met an event.

    Where they differ, a Taylor series at 32 digits decides.
    """
    rng = Random(f"dopri5 {seed}")
    flows: list[Flow] = []
    while len(flows) < FLOWS:
        flow = random_flow(rng, rng.choice(("nonlinear", "nonlinear", "linear", "polynomial")))
        if isinstance(plan_flow(flow, [], "dopri5"), FlowPlan):
            flows.append(flow)
    libraries: list[Compiled] = [
        compiled(flows_model(f"{kind}{seed}", tuple(flows)), folder, kind) for kind in ("dopri5", "cvodes")
    ]
    compared = ended = disputed = 0
    for k, start in starts(tuple(flows), seed, count):
        ours, theirs = (library.run(k, start) for library in libraries)
        if ours.reason or theirs.reason:
            continue
        state = {x: theirs.state[x] for x, _ in flows[k].equations}
        compared += 1
        ended += 0 < theirs.duration < horizon(flows[k], start)
        if difference(ours, theirs.duration, state) > 3e-8:
            try:
                told = judge(flows[k], start.environment)
            except Singular:
                continue
            true = {x: float(told.state[Symbol(x, "variable")]) for x, _ in flows[k].equations}
            size = moved(flows[k], start.environment, told)
            error = difference(ours, float(told.duration), true)
            assert error <= 3e-8 * size, f"{print_flow(flows[k])}\n{start}\n{ours}\n{theirs}"
            disputed += difference(theirs, float(told.duration), true) > 6e-8 * size
    assert disputed == 0
    return compared, ended


@pytest.mark.slow
def test_random_flows_end_as_with_cvodes(tmp_path: Path) -> None:
    compared, ended = agreement(0, 700, tmp_path)
    assert compared > 500 and ended > 100


@pytest.mark.slow
def test_ten_thousand_random_flows_end_as_with_cvodes(tmp_path: Path) -> None:
    counts = [agreement(seed, 1300, tmp_path) for seed in range(1, 11)]
    assert sum(c for c, _ in counts) >= 10_000 and sum(e for _, e in counts) > 1_500


def test_the_fifth_root_is_one(tmp_path: Path) -> None:
    """Step lengths follow from it: within a thousandth, over all magnitudes."""
    text = (cgen_dir() / "runtime" / "dopri5.h").read_text(encoding="utf-8")
    start = text.index("static inline real dl2c_fifth_root")
    body = text[start : text.index("\n}\n", start) + 3].replace("static inline real", "double")
    source = tmp_path / "root.c"
    source.write_text(f'#include "numbers.h"\n{body}')
    command = ["cc", "-O1", "-fPIC", "-shared", f"-I{cgen_dir() / 'runtime'}", str(source)]
    subprocess.run([*command, "-o", str(tmp_path / "root.so"), "-lm"], check=True)
    root: Any = ctypes.CDLL(str(tmp_path / "root.so")).dl2c_fifth_root
    root.restype, root.argtypes = ctypes.c_double, [ctypes.c_double]
    for k in range(-320, 308):
        for part in (1.0, 1.7, 3.3, 9.9):
            value = part * 10.0**k
            assert math.isclose(root(value), value**0.2, rel_tol=1e-3)
