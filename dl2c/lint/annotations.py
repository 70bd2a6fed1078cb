"""Doubts about what annotations ask for: rewards, ends of episodes, observations, durations."""

from collections.abc import Iterator

from dl2c.diagnostics import Diagnostic, warning
from dl2c.flows.kernel import constant_along
from dl2c.interval.arithmetic import WHOLE, Interval, evaluate
from dl2c.interval.bounded import initial_box, interval_of
from dl2c.ir.liveness import read_first
from dl2c.ir.logic import conjuncts, symbols
from dl2c.ir.model import ONE, ZERO, Compare, Flow, Formula, Model, Number, Predicate, Symbol, Term
from dl2c.lint.world import bounds_of, changing, rigid_facts
from dl2c.lower.observations import observed
from dl2c.options import DEFAULT_DT, Options
from dl2c.paths.path import END, Paths
from dl2c.resolve.predicates import AnnotatedPredicate
from dl2c.resolve.problem import Problem
from dl2c.smt.query import Oracle
from dl2c.source import Span


def ends_of_episodes(problem: Problem) -> Iterator[Diagnostic]:
    """`truncate-on-failure`."""
    for predicate in problem.predicates:
        trigger = predicate.annotation.on_failure
        if trigger is not None and trigger.action == "truncate":
            yield warning(
                "truncate-on-failure",
                f"the failure of `{predicate.declaration.name}` truncates",
                trigger.span,
                "a learner adds the value of what would come next, as if the episode went on",
                "write `on_failure=terminate:failure`",
            )


def penalties(model: Model, problem: Problem) -> Iterator[Diagnostic]:
    """`positive-penalty`."""
    for predicate, annotated in _pairs(model, problem):
        if isinstance(predicate.penalty, Number) and predicate.penalty.value > 0:
            yield warning(
                "positive-penalty",
                f"the penalty of `{predicate.name}` is positive",
                _span(annotated.annotation.penalty, annotated),
                "it is added to the reward wherever the predicate fails",
                "give it a minus sign",
            )


def shapes(model: Model, problem: Problem, oracle: Oracle) -> Iterator[Diagnostic]:
    """`non-potential-shaping`: where success ends an episode, a positive shape delays it."""
    ends = [
        p.name
        for p in model.predicates
        if p.on_success and p.on_success.action != "continue" and p.on_success.status == "success"
    ]
    if not ends:
        return
    safe = [p.formula for p in model.predicates if p.category == "safety"]
    known = (*rigid_facts(model), *bounds_of(model), *safe)
    for predicate, annotated in _pairs(model, problem):
        if predicate.shape is not None and _may_be_positive(predicate.shape, model, known, oracle):
            yield warning(
                "non-potential-shaping",
                f"the shape of `{predicate.name}` can be positive",
                _span(annotated.annotation.shape, annotated),
                f"every step without `{ends[0]}` earns more, so success is put off",
                "subtract what it can at most be, e.g. `shape={-abs(x - goal)}`",
                ("shaping leaves alone what is best if it is a difference of potentials before and after",),
            )


def _may_be_positive(shape: Term, model: Model, known: tuple[Formula, ...], oracle: Oracle) -> bool:
    """Whether some state inside all bounds that is safe is known to have a positive shape."""
    box = dict.fromkeys(symbols(shape), WHOLE)
    for item in (*model.variables, *model.constants):
        if item.symbol in box:
            box[item.symbol] = interval_of(item.bound)
    if evaluate(shape, box).high <= 0:
        return False
    question = (*known, Compare(">", shape, ZERO))
    return oracle.exists(question).verdict == "yes"


def safety_checks(model: Model, paths: Paths, options: Options) -> Iterator[Diagnostic]:
    """`safety-after-steps`: once, at the first flow along which nothing is watched."""
    safe = [p for p in model.predicates if p.category == "safety"]
    onward = [
        p.flow for p in paths.paths if p.flow is not None and p.target != END and p.point < paths.own_points
    ]
    if options.safety_check != "continuous" or not onward or not safe:
        return
    others = sorted({model.flows[k].span.line for k in onward} - {model.flows[min(onward)].span.line})
    yield warning(
        "safety-after-steps",
        f"`{safe[0].name}` is not watched along this flow",
        model.flows[min(onward)].span,
        "a step goes on after it, so safety is judged where the step ends",
        "silence this with `safety_check=step` or `allow=safety-after-steps`, or see `safety_check=flows`",
        (f"nor along flows on line{'s' * (len(others) > 1)} {', '.join(map(str, others))}",)
        if others
        else (),
    )


def limits(model: Model, options: Options, problem: Problem) -> Iterator[Diagnostic]:
    """`unbounded` and `no-annotations`."""
    if options.observation_bounds == "unbounded":
        return
    if not problem.annotated:
        span = problem.entry.problem.span
        yield warning(
            "no-annotations",
            "the model says nothing about learning",
            Span(span.source, span.start, span.start + 1),
            "every variable is observed without limits, the postcondition is the only reward",
            "`dl2c annotate` writes a copy with suggested annotations",
        )
        return
    spans = {item.name: item.span for item in (*model.variables, *model.constants)}
    for name, _, bound in observed(model, options):
        if bound.low is None or bound.high is None:
            yield warning(
                "unbounded",
                f"`{name}` is observed without limits",
                spans[name],
                "observations cannot be scaled",
                "give it `bound=[lo:hi]`, or `observe=false`",
            )


def unobserved(model: Model, problem: Problem) -> Iterator[Diagnostic]:
    """`unobserved-variable`: without an annotation, yet a step depends on its value."""
    if not problem.annotated:
        return
    silent = {d.name for d, annotation in problem.variables if annotation is None}
    moving, box = changing(model), initial_box(model) or {}
    for variable in model.variables:
        symbol = variable.symbol
        start = box.get(symbol, WHOLE)
        fixed = variable.name not in moving and _is_point(start)
        if variable.name in silent and not fixed and _matters(symbol, model):
            yield warning(
                "unobserved-variable",
                f"a step depends on `{variable.name}`, which is not observed",
                variable.span,
                "states that differ in it look the same",
                "annotate it with `@var: bound=[lo:hi]`, or say so with `@var: observe=false`",
            )


def _matters(symbol: Symbol, model: Model) -> bool:
    return read_first((*model.lead, *model.body), symbol.name, model.flows)


def durations(model: Model, options: Options) -> Iterator[Diagnostic]:
    """`default-dt`, and `strict-clock` where a clock was probably meant to limit it."""
    for flow in model.flows:
        if options.dt is not None or flow.horizons:
            continue
        strict = [atom for atom in conjuncts(flow.watched) if _is_strict_clock(atom, flow)]
        for atom in strict:
            yield warning(
                "strict-clock",
                "a strict bound of a clock does not set how long this flow lasts",
                atom.span if isinstance(atom, Compare) else flow.span,
                f"it lasts {float(DEFAULT_DT):g} s, the default: an open end has no last instant",
                "write `<=`, or say `@episode: dt=...`",
            )
        if not strict:
            default = f"{float(DEFAULT_DT):g} s, the default"
            lasts = f"it lasts {default}, or until its domain ends it"
            if flow.reach is not None:
                lasts = f"it lasts {default}, unless its domain ends it within {float(flow.reach):g} s"
            yield warning(
                "default-dt",
                "nothing limits how long this flow lasts",
                flow.span,
                lasts,
                "add a clock, `t' = 1 & t <= ep`, or say `@episode: dt=...`",
            )


def _is_strict_clock(atom: Formula, flow: Flow) -> bool:
    """`t < e` or `e > t` with t' = 1 and e constant along the flow."""
    match atom:
        case Compare("<", Symbol(clock, "variable"), bound) | Compare(">", bound, Symbol(clock, "variable")):
            return dict(flow.equations).get(clock) == ONE and constant_along(bound, flow)
        case _:
            return False


def _is_point(interval: Interval) -> bool:
    return interval.high - interval.low <= 1e-9 * (1 + abs(interval.low))


def _pairs(model: Model, problem: Problem) -> Iterator[tuple[Predicate, AnnotatedPredicate]]:
    """The annotated predicates of the model beside what was written; none without annotations."""
    if problem.annotated:
        yield from zip(model.predicates, problem.predicates, strict=True)


def _span(part: object, predicate: AnnotatedPredicate) -> Span:
    span = getattr(part, "span", None)
    return span if isinstance(span, Span) else predicate.annotation.span
