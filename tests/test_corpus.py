"""Public models: what becomes of each, and that those that build do what the interpreter says."""

import ast
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY, shared
from corpus_table import BUILT, OPTIONS, expected, files, outcomes, table
from differential import same, uses_libm
from generators.flow_library import library_of
from oracles.flows import judge, moved
from oracles.taylor_series import Singular

from dl2c.diagnostics import CompileError
from dl2c.emit.plan import BuildPlan
from dl2c.flows.exact import Motion
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.interp.follow import follow
from dl2c.interp.step import Interpreter
from dl2c.interp.transition import Request, Settings, Start
from dl2c.ir.model import Symbol
from dl2c.native.binding import Batch
from dl2c.native.errors import ResetFailed
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import Compilation
from dl2c.source import Source

LEAST_BUILT = 856
"""May only rise."""

CVODES = 1e-5
"""Of states and durations after numeric flows at the default tolerances, relative to how much more than
the start they move."""


# What becomes of them ---------------------------------------------------------


def refusals() -> set[str]:
    """The codes of the documents' table of what is refused."""
    text = (REPOSITORY / "docs" / "reference" / "models.md").read_text(encoding="utf-8")
    _, _, rest = text.partition("## What is refused\n")
    section, _, _ = rest.partition("\n#")
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {code for row in rows for code in re.findall(r"`([a-z-]+)`", row)}


def diagnostic_codes() -> set[str]:
    """Every string in the package that can be a code."""
    trees = (ast.parse(p.read_text(encoding="utf-8")) for p in (REPOSITORY / "dl2c").rglob("*.py"))
    texts = [n.value for t in trees for n in ast.walk(t) if isinstance(n, ast.Constant)]
    undeclared = {f"undeclared-{kind}" for kind in ("variable", "function", "predicate", "program")}
    return {text for text in texts if isinstance(text, str)} | undeclared


def test_only_documented_reasons_refuse_public_models() -> None:
    reasons = {code for outcome in expected() if outcome != BUILT for code in outcome.split("+")}
    assert reasons <= refusals()
    assert expected()[BUILT] >= LEAST_BUILT


def test_documented_reasons_exist() -> None:
    assert len(refusals()) > 10
    assert refusals() <= diagnostic_codes()


@pytest.mark.slow
def test_public_models_come_to_the_expected_outcomes() -> None:
    assert outcomes(table(shared("corpus"))) == expected()


# What they do -----------------------------------------------------------------


class Ill(Exception):
    """An answer that depends on the last digits of the start, or that the oracle does not know."""


class Pair:
    """A model without predicates in both forms."""

    def __init__(self, environment: BuildPlan, name: str, folder: Path) -> None:
        model = replace(environment.model, name=name, predicates=(), postcondition=None)
        plans = [plan_flow(f, (), environment.options.integrator) for f in model.flows]
        flows = tuple(p for p in plans if isinstance(p, FlowPlan))
        self.environment = replace(environment, model=model, flows=flows)
        self.batch: Batch = library_of(self.environment, folder).batch(1, max_steps=0)
        self.rounding = 1e-12 if uses_libm(model) else 0.0
        self.tolerance = 0.0
        self.seen: Counter[str] = Counter()

    def play(self, rng: Random, steps: int) -> None:
        """Steps of both from where the compiled code begins and, after each step, is."""
        model = self.environment.model
        try:
            self.batch.reset(seeds=np.array([rng.getrandbits(64)], np.uint64))
        except ResetFailed:
            self.batch.set_state(
                0, *([rng.uniform(-10, 10) for _ in d] for d in (model.variables, model.constants))
            )
        for _ in range(steps):
            x, p = self.batch.get_state(0)
            state = dict(zip((v.name for v in model.variables), x.tolist(), strict=True))
            constants = dict(zip((c.name for c in model.constants), p.tolist(), strict=True))
            self._step(state, constants, rng)
            if self.batch.terminated[0] or self.batch.truncated[0]:
                return

    def _step(self, state: dict[str, float], constants: dict[str, float], rng: Random) -> None:
        paths = self.environment.paths
        limits = {i.key: (i.low, i.high) for i in paths.inputs}
        interpreter = Interpreter(
            self.environment.model, constants, self._flow, False, Settings(limits=limits)
        )
        choices = {d.key: rng.randrange(len(d.alternatives)) for d in paths.decisions}
        inputs = {i.key: rng.uniform(float(i.low), float(i.high)) for i in paths.inputs}
        self.tolerance = self.rounding
        self.batch.choices[0, :] = list(choices.values())
        self.batch.inputs[0, :] = list(inputs.values())
        self.batch.step()
        try:
            step = interpreter.step(Start(state), Request(choices, inputs))
        except Ill:
            self.seen["ill-conditioned"] += 1
            return
        x, _ = self.batch.get_state(0)
        want = [step.start.state[v.name] for v in self.environment.model.variables]
        got = [*x.tolist(), float(self.batch.duration[0]), bool(self.batch.blocked[0])]
        told = [*want, step.duration, step.blocked]
        assert _near(got, told, self.tolerance), (
            f"{self.environment.model.name}: {got}, should be {told}\n{state}"
        )
        self.seen["steps"] += 1
        self.seen["flows"] += step.duration != 0

    def _flow(self, k: int, env: Mapping[Symbol, Any], exact: bool, part: Any, waiting: Any) -> Motion:
        plan = self.environment.flows[k]
        if plan.kernel == "exact" and plan.curves is not None:
            return follow(plan, env, exact, part, waiting)
        if plan.flow.reach is not None:
            raise Ill
        start = {s: float(v) for s, v in env.items() if v is not None}
        try:
            verdict = judge(plan.flow, start)
            size = moved(plan.flow, start, verdict)
        except Singular as singular:
            raise Ill from singular
        if not math.isfinite(size):
            raise Ill
        self.tolerance += CVODES * size
        values = {x: float(verdict.state[Symbol(x, "variable")]) for x, _ in plan.flow.equations}
        return Motion(values, float(verdict.duration))


def _near(got: list[Any], told: list[Any], tolerance: float) -> bool:
    if tolerance == 0:
        return same(got, told, 0.0)
    return all(
        math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance) for a, b in zip(got, told, strict=True)
    )


def built(rng: Random, count: int) -> Iterator[tuple[str, BuildPlan]]:
    """Random entries that build and leave nothing to chance, from as many files as there are, with names."""
    paths = files(shared("corpus"))
    found = 0
    while found < count:
        path = rng.choice(paths)
        try:
            archive, _ = parse_archive(Source.read(path))
            environment = Compilation(rng.choice(archive.entries), OPTIONS).planned.build
        except CompileError:
            continue
        if not (environment.paths.draws or environment.paths.reset_draws):
            yield f"m{found}", environment
            found += 1


@pytest.mark.slow
def test_public_models_step_as_the_interpreter_says(tmp_path: Path) -> None:
    seen: Counter[str] = Counter()
    rng = Random(50)
    for name, environment in built(rng, 50):
        pair = Pair(environment, name, tmp_path)
        for _ in range(4):
            pair.play(rng, 4)
        seen += pair.seen
    assert seen["steps"] >= 200 and seen["flows"] >= 100
    assert seen["ill-conditioned"] <= 0.2 * seen["steps"]
