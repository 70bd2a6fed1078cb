"""What a library says of itself, from the environment it was generated from."""

import math
from dataclasses import fields
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dl2c.emit.cfile import place
from dl2c.emit.plan import BuildPlan
from dl2c.flows.certainty import certainties
from dl2c.ir.doubles import rounded_down, rounded_up
from dl2c.ir.model import Bound, Constant, Role, Variable
from dl2c.ir.printer import print_flow, print_number
from dl2c.lower.observations import observation_limits, observed
from dl2c.native.manifest import (
    ChoiceSpec,
    ConditionSpec,
    FlowSpec,
    InputSpec,
    Manifest,
    PredicateSpec,
    Quantity,
    TheoremSpec,
)
from dl2c.native.scenes import scene_spec
from dl2c.options import Options
from dl2c.paths.path import END
from dl2c.sampling.tables import SamplingPlan

if TYPE_CHECKING:
    from dl2c.emit.monitor.monitor_h import Unit

ABI_VERSION = 6
STREAM_VERSION = 4
"""Of cgen/include/dl2c.h; a test holds them together."""


def manifest_of(build: BuildPlan, key: str, platform: dict[str, str]) -> Manifest:
    """The manifest of an environment; `key` names the build, `platform` where it was made."""
    model, paths, plan = build.model, build.paths, build.sampling
    return Manifest(
        name=model.name,
        source=model.source,
        dl2c_version=build.version,
        abi_version=ABI_VERSION,
        stream_version=STREAM_VERSION,
        key=key,
        variables=tuple(_quantity(v, _declared(v.bound)) for v in model.variables),
        constants=tuple(_quantity(c, _declared(c.bound)) for c in model.constants),
        observations=_observations(build),
        choices=_choices(build, "agent"),
        inputs=_inputs(build, "agent"),
        drawn_choices=_choices(build, "env"),
        drawn_inputs=_inputs(build, "env"),
        runs=paths.runs,
        run_texts=tuple(_run_text(build, run) for run in paths.runs),
        predicates=tuple(PredicateSpec(p.name, p.category) for p in model.predicates),
        flows=tuple(
            FlowSpec(
                f"{place(f.flow.span)}  {print_flow(f.flow)}",
                f.kernel,
                f.reason,
                tuple(certainties(f, model)),
            )
            for f in build.flows
        ),
        certificate="none" if plan is None else plan.certificate,
        sampler={} if plan is None else _sampler(plan),
        options=options_as_data(build.options),
        notes=_notes(build),
        platform=platform,
        conditions=() if build.monitor is None else _conditions(build.monitor),
        theorem=TheoremSpec(build.claim.theorem or model.name, build.claim.invariant, build.claim.known),
        scene=scene_spec(model),
    )


def _conditions(unit: "Unit") -> tuple[ConditionSpec, ...]:
    """What the numbers of a monitor mean."""
    from dl2c.monitor.check import OUT_OF_RANGE

    out_of_range = ConditionSpec(OUT_OF_RANGE, "any", "a number is out of range")
    listed = [(check, c) for check, _, c in unit.monitor.conditions if check.transition]
    return (
        out_of_range,
        *(ConditionSpec(c.number, check.kind, f"{c.about} ({place(c.span)})") for check, c in listed),
    )


def _choices(build: BuildPlan, role: Role) -> tuple[ChoiceSpec, ...]:
    made = [d for d in build.paths.decisions if d.role == role]
    return tuple(ChoiceSpec(d.key, d.alternatives, d.name) for d in made)


def _inputs(build: BuildPlan, role: Role) -> tuple[InputSpec, ...]:
    given = [i for i in build.paths.inputs if i.role == role]
    return tuple(InputSpec(i.key, i.variable, rounded_up(i.low), rounded_down(i.high)) for i in given)


def _observations(build: BuildPlan) -> tuple[Quantity, ...]:
    model, options = build.model, build.options
    items: dict[str, Variable | Constant] = {v.name: v for v in (*model.variables, *model.constants)}
    return tuple(
        _quantity(items[name], observation_limits(bound, options))
        for name, _, bound in observed(model, options)
    )


def _sampler(plan: SamplingPlan) -> dict[str, Any]:
    return {
        "blocks": len(plan.blocks),
        "boxes": len(plan.boxes),
        "charts": len(plan.charts),
        "acceptance": plan.estimated_acceptance,
        "error_bound": plan.error_bound,
    }


def _declared(bound: Bound) -> tuple[float, float]:
    low = -math.inf if bound.low is None else float(bound.low)
    return low, math.inf if bound.high is None else float(bound.high)


def _quantity(item: Variable | Constant, limits: tuple[float, float]) -> Quantity:
    value = item.value if isinstance(item, Constant) else None
    return Quantity(
        name=item.name,
        low=limits[0],
        high=limits[1],
        description=item.description,
        unit=item.unit,
        plot=item.plot,
        value=None if value is None else float(value),
    )


def _run_text(build: BuildPlan, run: tuple[int, ...]) -> str:
    decisions = build.paths.decisions
    taken = [d.alternatives[k] for d, k in zip(decisions, run, strict=False) if k >= 0]
    return " ".join(taken) or "the only run"


def options_as_data(options: Options) -> dict[str, Any]:
    """Effective options as JSON values; exact numbers as text."""
    values: dict[str, Any] = {}
    for option in fields(options):
        value: Any = getattr(options, option.name)
        match value:
            case frozenset():
                continue
            case Fraction():
                values[option.name] = print_number(value)
            case (Fraction() as low, Fraction() as high):
                values[option.name] = f"{print_number(low)}:{print_number(high)}"
            case tuple():
                values[option.name] = {name: print_number(number) for name, number in options.constants}
            case _:
                values[option.name] = value
    return values


def _notes(build: BuildPlan) -> tuple[str, ...]:
    """What a user should know about this environment."""
    notes: list[str] = []
    paths = build.paths
    step = [
        p for p in paths.paths if p.target != END and p.point < (paths.lead or paths.prefix or paths.points)
    ]
    if paths.deep and any(p.flow is not None for p in step):
        notes.append(
            "the action mask follows runs to their end, but not beyond inputs, nor beyond flows after chance"
        )
    elif any(p.flow is not None for p in step):
        notes.append(
            "tests after the first flow are not part of the action mask: a run it allows may still block; "
            "mask_depth=step follows runs that need neither inputs nor chance to their end"
        )
    if any(p.flow is None and p.admissions for p in step):
        notes.append(
            "the action mask does not see beyond a while loop that an input of the same step may decide"
        )
    if any(a.solved for p in paths.paths for a in p.admissions):
        notes.append(
            "an equality that decides an input is solved: it counts as true at its root, which is rounded"
        )
    if build.sampling is not None and build.options.initial_distribution == "target":
        notes.append("initial states lie near random targets, often on the boundary of the precondition")
    if build.sampling is None:
        notes.append('initial states cannot be drawn: give one, reset(options={"state": {...}})')
    return tuple(notes)
