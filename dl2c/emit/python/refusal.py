"""What environments in plain Python cannot do, each with its place in the model."""

from collections.abc import Iterator

from dl2c.diagnostics import Diagnostic, error
from dl2c.emit.plan import BuildPlan
from dl2c.emit.python.text import agent_decisions
from dl2c.ir.logic import atoms
from dl2c.ir.model import Formula
from dl2c.paths.path import END, Path
from dl2c.sampling.equalities.root_of import RootOf
from dl2c.sampling.tables import SamplingPlan
from dl2c.source import NOWHERE, Span


def refusals(build: BuildPlan) -> tuple[Diagnostic, ...]:
    """Why a model has no environment in plain Python; nothing where it has one."""
    found = (*_runs(build), *_inputs(build), *_flows(build), *_start(build))
    return tuple(dict.fromkeys((*found, *_options(build))))


def _refused(span: Span, label: str) -> Diagnostic:
    return error(
        "not-in-python",
        "this cannot be written in plain Python",
        span,
        label,
        "leave out --pure-python: `emit --stage gym` runs every model, by the compiled library",
    )


def _runs(build: BuildPlan) -> Iterator[Diagnostic]:
    """A step is one choice of a path, and one flow at its end."""
    paths = build.paths
    start = paths.paths[0].span
    if paths.prefix is not None:
        yield _refused(_span_at(paths.of(paths.prefix), start), "a program before the loop")
    if paths.lead is not None:
        yield _refused(_span_at(paths.of(paths.lead), start), "the environment decides before the agent")
    elif several := [p for p in paths.of(0) if p.target != END]:
        yield _refused(several[0].span, "a step with loops inside, or with more after a flow")
    if any(d.role == "env" for d in (*paths.decisions, *paths.inputs)) or (
        paths.sampled and build.model.duration == "max"
    ):
        yield _refused(start, "chance decides some of this step")


def _span_at(paths: tuple[Path, ...], otherwise: Span) -> Span:
    return next((p.span for p in paths if p.span != NOWHERE), otherwise)


def _inputs(build: BuildPlan) -> Iterator[Diagnostic]:
    for path in build.paths.paths:
        for admission in path.admissions:
            span = _place(admission.tests, path.span)
            if admission.following is not None:
                yield _refused(span, "a test that joins several inputs")
            elif admission.solved:
                yield _refused(span, "an equality that decides an input")


def _place(formula: Formula, otherwise: Span) -> Span:
    """Where the formula stands."""
    return next((a.span for a in atoms(formula) if a.span != NOWHERE), otherwise)


def _flows(build: BuildPlan) -> Iterator[Diagnostic]:
    for plan in build.flows:
        flow = plan.flow
        if flow.reach is not None:
            yield _refused(flow.span, "a flow without a clock that lasts to the end of its domain")
        for atom in (*flow.invariants, *atoms(flow.watched)):
            if atom.op in ("=", "!="):
                yield _refused(atom.span, f"a domain with `{atom.op}`")


def _start(build: BuildPlan) -> Iterator[Diagnostic]:
    plan = build.sampling
    span = _place(build.model.precondition, build.paths.paths[0].span)
    if plan is None:
        yield _refused(span, "initial states that cannot be drawn")
    elif plan.weighted or any(len(b.charts) != 1 for b in plan.blocks) or _has_root(plan):
        yield _refused(span, "initial states on a curve or surface")
    elif any(chart.between for chart in plan.charts):
        yield _refused(span, "initial states so rare that limits of names depend on others")


def _has_root(plan: SamplingPlan) -> bool:
    return any(isinstance(d, RootOf) for chart in plan.charts for _, d in chart.definitions)


def _options(build: BuildPlan) -> Iterator[Diagnostic]:
    options, model = build.options, build.model
    choices, inputs = agent_decisions(build)
    plain = "dict" if choices and inputs else "box" if inputs else "multidiscrete"
    formats = ("auto",) if len(choices) == 1 and not inputs else ("auto", plain)
    span = build.paths.paths[0].span
    if model.duration != "max":
        yield _refused(span, f"the option duration={model.duration}")
    if options.action_format not in formats:
        yield _refused(span, f"the option action_format={options.action_format}")
    if options.action_map != "project" and inputs:
        yield _refused(span, f"the option action_map={options.action_map}")
    if options.initial_distribution != "uniform":
        yield _refused(span, f"the option initial_distribution={options.initial_distribution}")
