"""From a resolved problem to the step model (semantics 1 to 6).

Assumes a problem as `resolve` makes it. Raises `CompileError` with every independent
error: constants without a value, constructs that cannot be executed.
"""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import assert_never

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.flows.watch import last_flows
from dl2c.ir import model as ir
from dl2c.ir.liveness import overwritten
from dl2c.ir.logic import conjunction, disjunction, symbols
from dl2c.lower.leading import leading
from dl2c.lower.program import ProgramLowering
from dl2c.lower.scene import default_scene, lower_scene
from dl2c.lower.terms import Scope, lower_delta, lower_formula, lower_predicate, lower_term
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.annotations import (
    ChoiceAnnotation,
    ConstantAnnotation,
    FallbackAnnotation,
    Trigger,
    VariableAnnotation,
)
from dl2c.resolve.errors import unknown_constants
from dl2c.resolve.predicates import AnnotatedPredicate, ValueTerm
from dl2c.resolve.problem import Problem
from dl2c.resolve.shape import written_variables
from dl2c.resolve.symbols import free_variables, mentioned
from dl2c.source import Span

UNANNOTATED_PENALTY = Fraction(-1)


def lower(problem: Problem, options: Options) -> ir.Model:
    """The step model of a problem."""
    scope = scope_of(problem)
    shape = problem.shape
    found: list[Diagnostic] = []
    annotations = {a.span: a for a in problem.program_annotations}
    loops = shape.loop is not None
    lowering = ProgramLowering(scope, _roles(problem), annotations, options, not loops)
    step = lowering.sequence(shape.body)
    lead, body = leading(step)
    prefix = replace(lowering, resets=True, choices=0, loops=0, assigned={}).sequence(shape.prefix)
    assumptions = [(f.span, lower_formula(f, scope)) for f in shape.assumptions]
    found += [_never_true(span) for span, formula in assumptions if formula == ir.FALSE]
    precondition = conjunction(formula for _, formula in assumptions)
    constants = _constants(problem, options, precondition, found)
    found += _unused_annotations(problem, lowering)
    found += _after_loop(problem)
    if found:
        raise CompileError(found)
    flows = tuple(lowering.flows)
    model = ir.Model(
        name=problem.entry.name,
        source=problem.entry.span.source.file_name,
        variables=_variables(problem, precondition, (*prefix, *step), flows),
        constants=constants,
        precondition=precondition,
        prefix=prefix,
        body=body,
        loops=loops,
        flows=flows,
        predicates=_predicates(problem, scope, options),
        postcondition=_postcondition(problem, scope),
        tolerance=options.tolerance,
        duration=options.duration,
        continuous=_is_continuous(body, options),
        everywhere=options.safety_check == "flows",
        mask_depth=options.mask_depth,
        lead=lead,
        max_loop=options.max_loop,
    )
    return replace(model, scene=lower_scene(problem.scene, scope) or default_scene(model))


def _is_continuous(body: ir.Block, options: Options) -> bool:
    """Whether safety is watched along some flow (semantics 6)."""
    if options.safety_check == "continuous":
        return any(True for _ in last_flows(body))
    return options.safety_check == "flows"


def _never_true(span: Span) -> Diagnostic:
    return error(
        "unsatisfiable-precondition",
        "no initial state satisfies the precondition",
        span,
        "is never true",
        "relax this condition",
    )


def _changed_afterwards(problem: Problem, formula: tree.Formula) -> frozenset[str]:
    """What the formula reads and the program after the loop, which is not run, would change."""
    return written_variables(problem.shape.suffix) & free_variables(formula)


def _postcondition(problem: Problem, scope: Scope) -> ir.Formula | None:
    post = problem.shape.postcondition
    return None if post is None or _changed_afterwards(problem, post) else lower_formula(post, scope)


def _after_loop(problem: Problem) -> Iterator[Diagnostic]:
    """Conditions after the program that become predicates of the state after a step."""
    shape = problem.shape
    used = [p.formula for p in problem.predicates if p.declaration.name not in problem.symbols.declarations]
    if not problem.annotated:
        used = [f for f in (shape.postcondition or shape.progress,) if f is not None]
    read = frozenset(name for formula in used for name in _changed_afterwards(problem, formula))
    for program in shape.suffix:
        if changed := written_variables((program,)) & read:
            yield error(
                "program-after-loop",
                "a program after the loop is not run",
                program.span,
                f"it changes {', '.join(f'`{n}`' for n in sorted(changed))}, which the postcondition reads",
                "leave it out, or annotate the predicates that judge a step",
            )


def _unused_annotations(problem: Problem, lowering: ProgramLowering) -> Iterator[Diagnostic]:
    """Annotations in a program that runs, but not in front of what they are for."""
    for annotation in problem.program_annotations:
        if annotation in lowering.placed or not _runs(problem, annotation.span):
            continue
        match annotation:
            case ChoiceAnnotation():
                name, wanted = "choice", "a choice `{...} ++ {...}` that is not an `if`"
            case FallbackAnnotation():
                name, wanted = "fallback", "an alternative of a choice `{...} ++ {...}` that is not an `if`"
            case _:
                assert_never(annotation)
        title = f"this `@{name}` belongs to nothing"
        yield error("misplaced-annotation", title, annotation.span, help=f"write it directly before {wanted}")


def _runs(problem: Problem, place: Span) -> bool:
    """Whether a place is inside the body of a step, or of a definition that the problem uses."""
    loop, first, last = problem.shape.loop, problem.entry.problem.span, problem.shape.body[-1].span
    ranges = [(loop.span.start, loop.span.end) if loop else (first.start, last.end)]
    ranges += [(p.span.start, p.span.end) for p in problem.shape.prefix]
    used = set(mentioned(problem.entry.problem))
    waiting = list(used)
    while waiting:
        declaration = problem.symbols.declarations.get(waiting.pop())
        if declaration is None or declaration.body is None:
            continue
        ranges.append((declaration.span.end, declaration.body.span.end))
        more = set(mentioned(declaration.body)) - used
        used |= more
        waiting += more
    return any(start <= place.start < end for start, end in ranges)


def scope_of(problem: Problem) -> Scope:
    """What the names of a problem stand for."""
    scope: dict[str, ir.Term] = {d.name: ir.Symbol(d.name, "variable") for d, _ in problem.variables}
    return scope | {d.name: ir.Symbol(d.name, "constant") for d, _ in problem.constants}


def _roles(problem: Problem) -> dict[str, ir.Role]:
    return {d.name: a.role for d, a in problem.variables if a is not None and a.role is not None}


def _constants(
    problem: Problem, options: Options, precondition: ir.Formula, found: list[Diagnostic]
) -> tuple[ir.Constant, ...]:
    """Every constant with its bound or value; `found` gets those that have neither."""
    given = dict(options.constants)
    used = {s.name for s in symbols(precondition) if s.kind == "constant"}
    known = [d.name for d, _ in problem.constants]
    found += unknown_constants(given, known, problem.symbols.declarations, problem.entry.span)
    constants: list[ir.Constant] = []
    for declaration, annotation in problem.constants:
        constant = _constant(declaration, annotation, given.get(declaration.name))
        open_ended = constant.bound.low is None or constant.bound.high is None
        limited = declaration.name in used or options.default_bound is not None
        if constant.value is None and open_ended and not limited:
            found.append(_no_value(declaration))
        constants.append(constant)
    return tuple(constants)


def _constant(
    declaration: tree.Declaration, annotation: ConstantAnnotation | None, value: Fraction | None
) -> ir.Constant:
    if annotation is None:
        return ir.Constant(declaration.name, value=value, span=declaration.span)
    return ir.Constant(
        declaration.name,
        bound=_bound(annotation.bound),
        value=value,
        observed=annotation.observe,
        description=annotation.description,
        unit=annotation.unit,
        plot=annotation.plot,
        span=declaration.span,
    )


def _no_value(declaration: tree.Declaration) -> Diagnostic:
    name = declaration.name
    return error(
        "constant-without-value",
        f"nothing says which values `{name}` takes",
        declaration.span,
        "neither bounded nor fixed",
        f"annotate it with `@const: bound=[lo:hi]`, fix it with `--set {name}=1.5`, or give "
        "`--default-bound`",
    )


def _bound(bound: tuple[Fraction | None, Fraction | None] | None) -> ir.Bound:
    return ir.UNBOUNDED if bound is None else ir.Bound(bound[0], bound[1])


def _variables(
    problem: Problem, precondition: ir.Formula, program: ir.Block, flows: tuple[ir.Flow, ...]
) -> tuple[ir.Variable, ...]:
    assumed = {s.name for s in symbols(precondition)}
    return tuple(
        _variable(d, a, problem.annotated, d.name not in assumed and overwritten(program, d.name, flows))
        for d, a in problem.variables
    )


def _variable(
    declaration: tree.Declaration, annotation: VariableAnnotation | None, annotated: bool, fresh: bool
) -> ir.Variable:
    """`fresh` where nothing depends on the value that it starts with."""
    bound = _bound(annotation.bound if annotation else None)
    return ir.Variable(
        name=declaration.name,
        bound=bound,
        initial="zero" if bound == ir.UNBOUNDED and fresh else "sampled",
        observed=annotation.observe if annotation else not annotated,
        description=annotation.description if annotation else "",
        unit=annotation.unit if annotation else "",
        plot=annotation.plot if annotation else "none",
        span=declaration.span,
    )


def _predicates(problem: Problem, scope: Scope, options: Options) -> tuple[ir.Predicate, ...]:
    """Annotated predicates; without any annotation Q is a safety predicate (semantics 6)."""
    if problem.annotated:
        return tuple(_predicate(p, scope, options) for p in problem.predicates)
    post, progress = problem.shape.postcondition, problem.shape.progress
    if post is not None:
        implied = lower_predicate("postcondition", "safety", post, scope, options.tolerance)
        failure = ir.Trigger("terminate", "failure")
        return (replace(implied, penalty=ir.Number(UNANNOTATED_PENALTY), on_failure=failure),)
    if progress is not None:
        implied = lower_predicate("progress", "progress", progress, scope, options.tolerance)
        return (replace(implied, reward=ir.ONE, on_success=ir.Trigger("terminate", "success")),)
    return ()


def _predicate(predicate: AnnotatedPredicate, scope: Scope, options: Options) -> ir.Predicate:
    annotation = predicate.annotation
    name = predicate.declaration.name
    lowered = lower_predicate(name, annotation.category, predicate.formula, scope, options.tolerance)
    return replace(
        lowered,
        reward=_value(predicate.reward, scope),
        penalty=_value(predicate.penalty, scope),
        shape=_value(predicate.shape, scope),
        on_success=_trigger(annotation.on_success),
        on_failure=_trigger(annotation.on_failure),
        due=_due(predicate, scope, options),
        span=predicate.declaration.span,
    )


def _due(predicate: AnnotatedPredicate, scope: Scope, options: Options) -> ir.Formula | None:
    """When a progress predicate must hold; always under the literal reading (semantics 6)."""
    if predicate.annotation.category != "progress":
        return None
    if options.progress_failure == "literal":
        return ir.TRUE
    if not predicate.due:
        return None
    return disjunction(conjunction(lower_formula(f, scope) for f in premises) for premises in predicate.due)


def _value(value: ValueTerm | None, scope: Scope) -> ir.Term | None:
    if value is None:
        return None
    deltas = {name: lower_delta(formula, scope) for name, formula in value.deltas.items()}
    return lower_term(value.term, {**scope, **deltas})


def _trigger(trigger: Trigger | None) -> ir.Trigger | None:
    return None if trigger is None else ir.Trigger(trigger.action, trigger.status)
