"""What a page is made of: a model compiled to WebAssembly, under options that a page can keep."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dl2c.diagnostics import CompileError, error
from dl2c.emit.cexpr import INEXACT
from dl2c.emit.names import file_stem
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.conditions import Conditions, conditions_of
from dl2c.emit.simulator.conditions_c import conditions_c
from dl2c.env.opening import compilation_of
from dl2c.native.manifest import Manifest
from dl2c.pipeline import Compilation
from dl2c.play.wasm import compile_wasm, require_zig
from dl2c.policy.network import NetworkPolicy
from dl2c.progress import Progress, silent
from dl2c.source import Source

DOPRI5 = "Its motion is integrated by dopri5 here: CVODES, which dl2c uses otherwise, cannot run in a page."
DRAWN = (
    "Initial states are drawn uniformly here: solvers, which draw them near targets, cannot run in a page."
)


@dataclass(frozen=True, slots=True)
class Playable:
    """A model for a page. `notes` say what differs from the environment that the user's options give. A page
    may round otherwise than other machines where it is `approximate`: it calls functions such as sin.
    """

    source: Source
    build: BuildPlan
    manifest: Manifest
    conditions: Conditions
    wasm: bytes
    notes: tuple[str, ...]
    approximate: bool
    policy: NetworkPolicy | None = None


def playable(
    source: Source,
    options: Mapping[str, Any],
    policy: NetworkPolicy | None = None,
    progress: Progress = silent,
) -> Playable:
    """Compile a model, and a policy that acts in environments with these options.

    Raises `CompileError` for the model's mistakes and for what is stiff, `NativeError`.
    """
    require_zig()
    found, notes = _compilation(source, options, progress)
    build, claim = found.planned.build, found.claim()
    conditions = conditions_of(build)
    main = f"{file_stem(build.model.name)}_page.c"
    sources = found.emitted(claim) | {main: conditions_c(build.claiming(claim), conditions, policy)}
    approximate = any(INEXACT.search(text) for name, text in sources.items() if name != main)
    wasm = compile_wasm(sources, main, progress)
    return Playable(source, build, found.manifest(), conditions, wasm, notes, approximate, policy)


def _compilation(
    source: Source, options: Mapping[str, Any], progress: Progress
) -> tuple[Compilation, tuple[str, ...]]:
    """The model under these options but for what a page cannot do, and what is said of that."""
    chosen, notes = dict(options) | {"action_format": "dict"}, list[str]()
    found = compilation_of(source, chosen)
    found.progress = progress
    if found.resolved.options.initial_distribution == "z3":
        chosen, notes = chosen | {"initial_distribution": "uniform"}, [DRAWN]
        found = compilation_of(source, chosen)
    _refuse_stiff(found)
    if any(plan.kernel == "cvodes" for plan in found.flows):
        found, notes = compilation_of(source, chosen | {"integrator": "dopri5"}), [*notes, DOPRI5]
    return found, tuple(notes)


def _refuse_stiff(found: Compilation) -> None:
    """Raises `CompileError` for flows that need a solver for stiff equations."""
    asked = found.resolved.options.stiff == "true"
    stiff = [plan for plan in found.flows if plan.stiff or (asked and plan.kernel == "cvodes")]
    if stiff:
        title = "this differential equation is too stiff for a page"
        label = "needs CVODES, which is not part of a page"
        advice = "shorten the time between decisions or narrow the constants; `dl2c rollout` runs the model"
        raise CompileError([error("play-stiff", title, plan.flow.span, label, advice) for plan in stiff])
