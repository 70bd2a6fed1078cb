"""Flows compiled for tests by any kernel, and followed one at a time.

A process loads the library of each path once: give every model of one folder a name of its own.
"""

import subprocess
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from generators.random_odes import Start

from dl2c.code import cgen_dir
from dl2c.emit.names import file_stem
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.model_c import model_sources
from dl2c.flows.kernel import FlowPlan, plan_flow
from dl2c.flows.watch import watches_along
from dl2c.ir.model import Model
from dl2c.native.binding import Batch, Library, Sizes
from dl2c.native.compile import declarations
from dl2c.native.describe import manifest_of
from dl2c.native.sundials import load_solver
from dl2c.options import Integrator, Options
from dl2c.paths.enumerate import enumerate_paths

REASONS = ("", "blocked", "deadlock", "numerical", "solver", "stalled", "diverged", "time_limit", "end")


@dataclass(frozen=True)
class Arrival:
    """Where one compiled flow ended."""

    state: dict[str, float]
    duration: float
    reason: str
    blocked: bool


class Compiled:
    """A model of `flows_model`, or any whose one choice picks the flow."""

    def __init__(self, environment: BuildPlan, library: Library) -> None:
        self.environment = environment
        self.batch: Batch = library.batch(1, on_blocked="truncate", max_steps=0)

    @property
    def flows(self) -> tuple[FlowPlan, ...]:
        return self.environment.flows

    def run(self, flow: int, start: Start) -> Arrival:
        names = [v.name for v in self.environment.model.variables]
        constants = [c.name for c in self.environment.model.constants]
        self.batch.set_state(0, [start.state[x] for x in names], [start.constants[c] for c in constants])
        self.batch.choices[0, :] = flow
        self.batch.step()
        x, _ = self.batch.get_state(0)
        reason = int(self.batch.reason[0])
        return Arrival(
            dict(zip(names, x.tolist(), strict=True)),
            float(self.batch.duration[0]),
            self.environment.model.predicates[reason - 16].name if reason >= 16 else REASONS[reason],
            bool(self.batch.blocked[0]),
        )


def plans(model: Model, integrator: Integrator) -> list[FlowPlan | None]:
    found = [plan_flow(f, watches_along(model, k), integrator) for k, f in enumerate(model.flows)]
    return [p if isinstance(p, FlowPlan) else None for p in found]


def compiled(
    model: Model, folder: Path, integrator: Integrator = "auto", flags: tuple[str, ...] = (), **options: Any
) -> Compiled:
    """The model as a plain library, loaded."""
    chosen = plans(model, integrator)
    assert all(chosen), "a flow cannot be followed as asked"
    environment = BuildPlan(
        model,
        enumerate_paths(model),
        tuple(p for p in chosen if p is not None),
        None,
        replace(Options(), integrator=integrator, **options),
        "test",
    )
    return Compiled(environment, library_of(environment, folder, flags))


def library_of(environment: BuildPlan, folder: Path, flags: tuple[str, ...] = ()) -> Library:
    """The environment's code as a plain library, loaded."""
    name = file_stem(environment.model.name)
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in model_sources(environment).items():
        (folder / file).write_text(text, encoding="utf-8")
    target = folder / f"lib{name}.so"
    cgen = cgen_dir()
    command = ["cc", "-std=c11", "-O1", "-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"]
    command += ["-fPIC", "-shared", "-DDL2C_SHARED", "-DDL2C_NO_TARGET_CLONES", *flags]
    command += [f"-I{cgen / 'include'}", f"-I{cgen / 'runtime'}", str(folder / f"{name}.c")]
    done = subprocess.run(
        [*command, "-o", str(target), "-lm", "-ldl", "-pthread"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{name}: {done.stderr[:2000]}"
    ffi = declarations()
    lib: Any = ffi.dlopen(str(target))
    if any(p.kernel == "cvodes" for p in environment.flows):
        load_solver(ffi, lib, "casadi")
    raw = ffi.new("dl2c_sizes *")
    lib.dl2c_model_sizes(raw)
    sizes = Sizes(**{f.name: int(getattr(raw, f.name)) for f in fields(Sizes)})
    return Library(manifest_of(environment, "", {}), sizes, ffi, lib)
