"""The paper's model: proved invariants hold, and exact arithmetic agrees with the compiled code."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selection import few_and_many

from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import watches_of
from dl2c.interp.follow import follow
from dl2c.interp.step import Interpreter
from dl2c.interp.transition import Request, Start
from dl2c.ir.evaluate import evaluate
from dl2c.ir.logic import atoms
from dl2c.ir.model import Model
from dl2c.lower.problem import lower
from dl2c.native.binding import Batch, Library
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.paths.enumerate import enumerate_paths
from dl2c.pipeline import compile_model
from dl2c.resolve.problem import resolve
from dl2c.source import Source

WAYPOINT = Path(__file__).resolve().parents[2] / "examples" / "waypoint.kyx"


@pytest.fixture(scope="module")
def library() -> Library:
    return compile_model(Source.read(WAYPOINT), Options()).library


@pytest.fixture(scope="module")
def model() -> Model:
    archive, _ = parse_archive(Source.read(WAYPOINT))
    return lower(resolve(archive.entries[0]), Options())


def masked(batch: Batch, rng: np.random.Generator) -> None:
    """Choose uniformly among the enabled alternatives of each environment."""
    weights = rng.random(batch.mask.shape) * batch.mask
    batch.choices[:, 0] = weights.argmax(axis=1)


def test_a_random_masked_policy_never_violates_the_invariant(library: Library) -> None:
    batch = library.batch(250, autoreset="same_step")
    batch.reset(seeds=np.arange(250, dtype=np.uint64))
    rng = np.random.default_rng(0)
    episodes = successes = 0
    for _ in range(400):
        masked(batch, rng)
        batch.step()
        assert not batch.blocked.any()
        assert not batch.cost.any()
        ended = (batch.terminated | batch.truncated).astype(bool)
        episodes += int(ended.sum())
        successes += int((batch.status[ended] == 1).sum())
        assert not (batch.status == 2).any()
    assert episodes > 1000
    assert successes >= 0.99 * episodes


@pytest.mark.parametrize("count", few_and_many(200, 1500))
def test_exact_arithmetic_agrees_with_the_compiled_code(count: int, library: Library, model: Model) -> None:
    """Every decision of a step: the mask, the run, how the flow ends, what ends the episode."""
    plans = [p for f in model.flows if isinstance(p := plan_flow(f, watches_of(model)), FlowPlan)]

    def flow(k: int, env: Any, exact: bool, part: Any, waiting: Any) -> Any:
        return follow(plans[k], env, exact, part, waiting)

    batch = library.batch(1, autoreset="same_step")
    rng = np.random.default_rng(1)
    names = [c.name for c in model.constants]
    knife_edges = 0
    batch.reset(seeds=np.array([7], dtype=np.uint64))
    for _ in range(count):
        x, p = batch.get_state(0)
        state = {v.name: Fraction(float(a)) for v, a in zip(model.variables, x, strict=True)}
        constants = {n: Fraction(float(a)) for n, a in zip(names, p, strict=True)}
        exact = Interpreter(model, constants, flow, exact=True)
        mask = batch.mask[0].tolist()
        masked(batch, rng)
        choice = int(batch.choices[0, 0])
        batch.step()
        if not agrees(exact, batch, model, state, mask, choice):
            assert near_a_branch(exact, model, state, choice), f"{state} {constants}"
            knife_edges += 1
    assert knife_edges <= 0.02 * count


def agrees(
    exact: Interpreter, batch: Batch, model: Model, state: dict[str, Any], mask: list[int], choice: int
) -> bool:
    start = Start(state)
    if [int(m) for m in exact.openings(start).mask["choice_0"]] != mask:
        return False
    step = exact.step(start, Request({"choice_0": choice}))
    reason = int(batch.reason[0])
    told = model.predicates[reason - 16].name if reason >= 16 else {0: "", 2: "deadlock"}.get(reason, "?")
    same = step.decisions["choice_0"] == int(batch.executed_choices[0, 0])
    same &= (step.reason, step.cost) == (told, int(batch.cost[0]))
    return same and abs(float(step.duration) - float(batch.duration[0])) <= 1e-9


def near_a_branch(exact: Interpreter, model: Model, state: dict[str, Any], choice: int) -> bool:
    """Whether some condition is within 1e-9 of its boundary, before or after the step."""
    after = exact.step(Start(state), Request({"choice_0": choice})).state
    formulas = [p.guard for p in enumerate_paths(model).paths] + [q.formula for q in model.predicates]
    for values in (state, after):
        env = exact.environment(values)
        for formula in formulas:
            for atom in atoms(formula):
                left, right = evaluate(atom.left, env, True), evaluate(atom.right, env, True)
                if abs(left - right) <= Fraction(1, 10**9) * (1 + abs(left) + abs(right)):
                    return True
    return False


def test_braking_at_rest_and_coasting_at_rest(library: Library) -> None:
    batch = library.batch(1)
    constants = [0.25, 2.0, 2.0, 9.0, 5.0]
    inside_area = [95.0, 0.0, 0.0, 100.0, 0.0, 500.0]
    for choice, duration in ((0, 0.0), (1, 0.25)):
        batch.set_state(0, inside_area, constants)
        batch.choices[0, 0] = choice
        batch.step()
        x, _ = batch.get_state(0)
        assert batch.duration[0] == duration
        assert (x[0], x[1]) == (95.0, 0.0)
