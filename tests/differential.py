"""Run interpreter and compiled code side by side.

Random models are compiled at -O1 as plain shared libraries and stepped through the same `Batch`
that environments use. Every result of a step is compared to the last bit.
"""

import math
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from random import Random
from tempfile import mkdtemp
from typing import Any

import numpy as np
from generators.kyx_builder import lowered
from generators.random_models import random_model, random_state
from oracles.streams import Stream

from dl2c.code import cgen_dir
from dl2c.diagnostics import CompileError
from dl2c.emit.names import file_stem
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.model_c import model_sources
from dl2c.flows.exact import Motion
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import watches_along
from dl2c.interp.follow import follow
from dl2c.interp.step import Interpreter
from dl2c.interp.transition import Openings, Request, Settings, Start, Step
from dl2c.ir import model as ir
from dl2c.ir.evaluate import evaluate
from dl2c.ir.logic import operands
from dl2c.native.binding import Batch, Library, Sizes
from dl2c.native.compile import declarations
from dl2c.native.describe import manifest_of
from dl2c.native.errors import ResetFailed
from dl2c.options import Options
from dl2c.paths.enumerate import enumerate_paths

OUTCOMES = ("none", "success", "failure")
TRIES = 25
MAX_PATHS = 24
"""Models with more paths take too long to compile for a test."""
REASONS = ("", "blocked", "deadlock", "numerical", "solver", "stalled", "diverged", "time_limit", "end")


def environment_of(model: ir.Model) -> BuildPlan | None:
    """What code is generated from; None for a model outside the class of inputs or flows."""
    try:
        paths = enumerate_paths(model)
    except CompileError:
        return None
    plans = [plan_flow(f, watches_along(model, k), "exact") for k, f in enumerate(model.flows)]
    if not 0 < len(paths.paths) <= MAX_PATHS or not all(isinstance(p, FlowPlan) for p in plans):
        return None
    return BuildPlan(
        model, paths, tuple(p for p in plans if isinstance(p, FlowPlan)), None, Options(), "test"
    )


def compiled(environments: list[BuildPlan], folder: Path, level: str = "-O1") -> list[Library]:
    """Libraries of all environments, compiled two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda e: _compiled(e, folder, level), environments))


def _compiled(environment: BuildPlan, folder: Path, level: str) -> Library:
    name = file_stem(environment.model.name)
    source, target = folder / f"{name}.c", folder / f"lib{name}.so"
    for file, text in model_sources(environment).items():
        (folder / file).write_text(text, encoding="utf-8")
    cgen = cgen_dir()
    command = ["cc", "-std=c11", level, "-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"]
    command += [
        "-fPIC",
        "-shared",
        "-DDL2C_SHARED",
        "-DDL2C_NO_TARGET_CLONES",
        f"-I{cgen / 'include'}",
        f"-I{cgen / 'runtime'}",
    ]
    done = subprocess.run(
        [*command, str(source), "-o", str(target), "-lm"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{name}: {done.stderr[:2000]}"
    ffi = declarations()
    lib: Any = ffi.dlopen(str(target))
    raw = ffi.new("dl2c_sizes *")
    lib.dl2c_model_sizes(raw)
    sizes = Sizes(**{f.name: int(getattr(raw, f.name)) for f in fields(Sizes)})
    return Library(manifest_of(environment, "", {}), sizes, ffi, lib)


class Pair:
    """One model in both forms."""

    def __init__(self, environment: BuildPlan, library: Library, settings: str, penalty: float) -> None:
        self.environment, self.library = environment, library
        self.model = environment.model
        limits = {i.key: (i.low, i.high) for i in environment.paths.inputs}
        self.settings = Settings(settings, penalty, limits)
        self.batch: Batch = library.batch(1, on_blocked=settings, blocked_penalty=penalty, max_steps=0)
        self.rounding = 1e-12 if uses_libm(self.model) else 0.0
        self.seen: Counter[str] = Counter()

    def interpreter(self, constants: dict[str, Any], exact: bool = False) -> Interpreter:
        return Interpreter(self.model, constants, self._flow, exact, self.settings)

    def _flow(self, k: int, env: Any, exact: bool, part: Any, waiting: Any) -> Motion:
        """The exact kernel; counts the flows that an event ended."""
        flow = self.environment.flows[k]
        motion = follow(flow, env, exact, part, waiting)
        self.seen["failed"] += bool(motion.failed)
        self.seen["met"] += bool(motion.met)
        limits = [evaluate(h.bound, env) - env[ir.Symbol(h.clock, "variable")] for h in flow.flow.horizons]
        limits += [] if flow.flow.cap is None else [float(flow.flow.cap)]
        self.seen["flows"] += 1
        self.seen["events"] += motion.duration < min(limits)
        return motion

    def compare_episode(self, rng: Random, steps: int = 4) -> None:
        """A random initial state, and random actions until the episode ends."""
        state, constants = random_state(rng)
        seed = rng.getrandbits(64)
        interpreter = self.interpreter(constants)
        stream = Stream.of(seed, 0)
        begun = self._begun(interpreter, state, stream)
        try:
            self.batch.reset_to(0, seed, list(state.values()), list(constants.values()))
        except ResetFailed:
            assert begun is None
            self.seen["refused"] += 1
            return
        if begun is None:
            assert self.environment.paths.draws or self.environment.paths.reset_draws
            return
        start, draws = begun
        self._check_state(start)
        self._check_mask(interpreter.openings(start), final=False)
        for _ in range(steps):
            choices, inputs = self.actions(rng)
            ahead = stream.copy()
            following = ahead.draws(self.environment.paths.draws)
            self._step(choices, inputs)
            step = interpreter.step(start, Request(choices, inputs, draws), following)
            self._check(step, interpreter, (state, constants, start, choices, inputs))
            self._count(step)
            if step.terminated or step.truncated:
                return
            stream, start, draws = ahead, step.start, following

    def _begun(
        self, interpreter: Interpreter, state: dict[str, float], stream: Stream
    ) -> tuple[Start, dict[str, list[float]]] | None:
        """Where the first step starts, and its draws; None after a few tries; C makes more."""
        paths = self.environment.paths
        for _ in range(TRIES if paths.draws or paths.reset_draws else 1):
            here: Any = state
            if self.model.prefix:
                here = interpreter.prefix(state, stream.draws(paths.reset_draws))
            if here is None:
                continue
            draws = stream.draws(paths.draws)
            start = interpreter.lead(here, draws)
            if start is not None and interpreter.openings(start).open:
                return start, draws
        return None

    def compare(self, rng: Random) -> None:
        """One random state and action."""
        state, constants = random_state(rng)
        self.step_from(state, constants, *self.actions(rng))

    def step_from(
        self,
        state: dict[str, float],
        constants: dict[str, float],
        choices: dict[str, int],
        inputs: dict[str, float],
    ) -> Step:
        """One step of both from a state; what it did."""
        interpreter, start = self.interpreter(constants), Start(state)
        self.batch.set_state(0, list(state.values()), list(constants.values()))
        self._check_mask(interpreter.openings(start), final=False)
        step = interpreter.step(start, Request(choices, inputs))
        self._step(choices, inputs)
        self._check(step, interpreter, (state, constants, choices, inputs))
        self._count(step)
        return step

    def actions(self, rng: Random) -> tuple[dict[str, int], dict[str, float]]:
        """A random action."""
        paths = self.environment.paths
        choices = {d.key: rng.randrange(len(d.alternatives)) for d in paths.decisions if d.role == "agent"}
        own = [i for i in paths.inputs if i.role == "agent"]
        return choices, {i.key: rng.uniform(float(i.low) - 1, float(i.high) + 1) for i in own}

    def _step(self, choices: dict[str, int], inputs: dict[str, float]) -> None:
        """One step of the compiled code. Where the agent decides nothing, another request does the same."""
        other: list[bytes] = []
        if not self.batch.decides()[0]:
            kept = self.batch.save(0)
            self._request([0 for _ in choices], [0.0 for _ in inputs])
            other = self._results()
            self.batch.restore(0, kept)
            self.seen["undecided"] += bool(choices or inputs)
        self._request(list(choices.values()), list(inputs.values()))
        assert not other or other == self._results(), f"{self.model.name}: the request made a difference"

    def _request(self, choices: list[int], inputs: list[float]) -> None:
        self.batch.choices[0, :] = choices
        self.batch.inputs[0, :] = inputs
        self.batch.step()

    def _results(self) -> list[bytes]:
        """All that a step wrote but what repeats the request."""
        b = self.batch
        requested = [b.choices, b.inputs, b.executed_choices, b.executed_inputs]
        return [a.tobytes() for a in b.arrays() if not any(a is r for r in requested)]

    def _check(self, step: Step, interpreter: Interpreter, context: object) -> None:
        b, model = self.batch, self.model
        self._check_state(step.start)
        predicates = [p.name for p in model.predicates]
        reason = int(b.reason[0])
        got = {
            "decisions": b.executed_choices[0].tolist(),
            "values": b.executed_inputs[0].tolist(),
            "drawn_choices": b.drawn_choices[0].tolist(),
            "drawn_inputs": b.drawn_inputs[0].tolist(),
            "blocked": bool(b.blocked[0]),
            "duration": float(b.duration[0]),
            "reward": float(b.rewards[0]),
            "cost": int(b.cost[0]),
            "terminated": bool(b.terminated[0]),
            "truncated": bool(b.truncated[0]),
            "status": OUTCOMES[int(b.status[0])],
            "reason": predicates[reason - 16] if reason >= 16 else REASONS[reason],
        }
        want = {
            "decisions": self._decided(step, "agent"),
            "values": self._given(step, "agent"),
            "drawn_choices": self._decided(step, "env"),
            "drawn_inputs": self._given(step, "env"),
            **{name: getattr(step, name) for name in list(got)[4:]},
        }
        for name, value in got.items():
            assert same(value, want[name], self.rounding), (
                f"{model.name}: {name} is {value!r}, should be {want[name]!r}\n{context}"
            )
        if model.postcondition is not None:
            assert bool(b.postcondition[0]) == step.postcondition
        self._check_mask(step.openings, final=step.terminated or step.truncated)

    def _decided(self, step: Step, role: str) -> list[int]:
        return [step.decisions.get(d.key, -1) for d in self.environment.paths.decisions if d.role == role]

    def _given(self, step: Step, role: str) -> list[Any]:
        return [step.values.get(i.key, math.nan) for i in self.environment.paths.inputs if i.role == role]

    def _check_state(self, start: Start) -> None:
        x, _ = self.batch.get_state(0)
        want = [start.state[v.name] for v in self.model.variables]
        assert same(x.tolist(), want, self.rounding), f"{self.model.name}: state is {x}, should be {want}"

    def _check_mask(self, openings: Openings, final: bool) -> None:
        got = self.batch.mask[0].tolist()
        want = [
            int(final or not openings.mask or openings.mask[d.key][k])
            for d in self.environment.paths.decisions
            if d.role == "agent"
            for k in range(len(d.alternatives))
        ]
        assert got == want, f"{self.model.name}: mask {got}, should be {want}"

    def _count(self, step: Step) -> None:
        self.seen["steps"] += 1
        self.seen["blocked"] += step.blocked
        self.seen["deadlock"] += step.reason == "deadlock"
        self.seen["diverged"] += step.reason == "diverged"
        self.seen["numerical"] += step.reason == "numerical"
        self.seen["ended"] += bool(step.reason)


def same(a: Any, b: Any, rounding: float = 0.0) -> bool:
    """Equal to the last bit, but for the sign of zero; or up to a relative `rounding`."""
    if isinstance(a, list):
        return len(a) == len(b) and all(same(p, q, rounding) for p, q in zip(a, b, strict=True))
    if isinstance(a, float) and math.isnan(a):
        return math.isnan(b)
    return a == b or (rounding > 0 and isinstance(a, float) and math.isclose(a, b, rel_tol=rounding))


LIBM = {"exp", "sin", "cos", "tan", "arcsin", "arctan", "tanh", "pow"}
"""Functions that a compiler may evaluate better than the library does."""


def uses_libm(model: ir.Model) -> bool:
    """Whether a reward calls the mathematical library."""
    stack = [t for p in model.predicates for t in (p.reward, p.penalty, p.shape) if t is not None]
    while stack:
        term = stack.pop()
        if isinstance(term, ir.Call) and term.function in LIBM:
            return True
        stack += operands(term)
    return False


def run_models(
    seeds: Iterable[int],
    pairs_each: int,
    folder: Path,
    make: Callable[[int], ir.Model] = random_model,
    episodes: bool = False,
) -> tuple[list[Pair], Counter[str]]:
    """Compare all models that the seeds give, each on `pairs_each` states and actions, or on
    so many episodes.
    """
    environments = [e for s in seeds if (e := environment_of(make(s))) is not None]
    libraries = compiled(environments, folder)
    total: Counter[str] = Counter()
    pairs: list[Pair] = []
    for k, (environment, library) in enumerate(zip(environments, libraries, strict=True)):
        settings = ("fallback", "fallback", "truncate", "terminate")[k % 4]
        pair = Pair(environment, library, settings, -0.25 if k % 3 == 0 else 0.0)
        rng = Random(1000 + k)
        compare = pair.compare_episode if episodes else pair.compare
        with np.errstate(all="ignore"):
            for _ in range(pairs_each):
                compare(rng)
        total += pair.seen
        pairs.append(pair)
    return pairs, total


def pair_of(
    program: str, folder: Path, variables: str = "Real x; Real v;", options: Mapping[str, Any] | None = None
) -> Pair:
    """Both forms of a model whose step is the program; the compiler does not optimise."""
    environment = environment_of(lowered(f"true -> [{{{program}}}*] x > -99", "", variables, options=options))
    assert environment is not None
    (library,) = compiled([environment], Path(mkdtemp(dir=folder)), "-O0")
    return Pair(environment, library, "fallback", 0.0)
