"""Doubts about which runs a step has: dead alternatives, deadlock, time that stands still, safety.

Whether a state exists is asked of Z3; only what it answers is reported.
"""

from collections.abc import Iterator, Mapping
from fractions import Fraction

from dl2c.diagnostics import Diagnostic, warning
from dl2c.ir.liveness import statements
from dl2c.ir.logic import conjunction, disjunction, domain_at_end, negation, symbols
from dl2c.ir.model import TRUE, Assign, AssignAny, Choice, Compare, Flow, Formula, Model, Number
from dl2c.lint.world import bounds_of, rigid_facts
from dl2c.lower.invariant import invariant
from dl2c.options import Options
from dl2c.paths.path import END, Path, Paths
from dl2c.resolve.problem import Problem
from dl2c.smt.query import Impossible, Oracle
from dl2c.source import Span


def dead_alternatives(model: Model, paths: Paths, oracle: Oracle) -> Iterator[Diagnostic]:
    """`dead-alternative`: whatever the state, no path that takes it passes its tests."""
    facts = rigid_facts(model)
    places = {d.key: k for k, d in enumerate(paths.decisions)}
    seen: set[tuple[str, int]] = set()
    for choice in statements((*model.prefix, *model.lead, *model.body)):
        if not isinstance(choice, Choice):
            continue
        for k, alternative in enumerate(choice.alternatives):
            taking = [p for p in paths.paths if p.decisions[places[choice.key]] == k]
            if (choice.key, k) in seen or any(_is_open(p, paths, facts, oracle) for p in taking):
                continue
            seen.add((choice.key, k))
            yield warning(
                "dead-alternative",
                "this alternative can never be taken",
                alternative.span,
                "no state passes the tests on any path through it",
                "leave it out, or correct its tests",
            )


def _is_open(path: Path, paths: Paths, facts: tuple[Formula, ...], oracle: Oracle) -> bool:
    return oracle.exists((*facts, *_tests(path, paths))).verdict != "no"


def _tests(path: Path, paths: Paths) -> tuple[Formula, ...]:
    """All that must hold of the state and the inputs where a path begins."""
    found = [path.guard]
    for admission in path.admissions:
        given = paths.inputs[admission.input]
        low = Compare(">=", given.symbol, Number(given.low))
        found += [admission.tests, low, Compare("<=", given.symbol, Number(given.high))]
    return tuple(found)


def deadlock(model: Model, problem: Problem, paths: Paths, oracle: Oracle) -> Iterator[Diagnostic]:
    """`deadlock`: a state under the loop's @invariant, first or after a flow, where no path begins."""
    known = invariant(problem)
    if known is None or problem.shape.loop is None or paths.lead is not None:
        return
    never = [
        Impossible(tuple(paths.inputs[a.input].symbol for a in p.admissions), conjunction(_tests(p, paths)))
        for p in paths.of(0)
    ]
    used = {s.name for s in symbols(known, *(part.formula for part in never)) if s.kind != "input"}
    first = conjunction((model.precondition, *bounds_of(model)))
    reached = disjunction((first, after_steps(model, paths)))
    answer = oracle.exists((*rigid_facts(model), known, reached), never, sorted(used))
    if answer.verdict == "yes":
        invariants = problem.shape.loop.invariants
        yield warning(
            "deadlock",
            "a state that satisfies the invariant has no run",
            Span(invariants[0].span.source, invariants[0].span.start, invariants[-1].span.end),
            "every test fails there, and the episode is truncated",
            "strengthen the invariant if the state cannot be reached, or add an alternative for it",
            (f"for instance {_shown(answer.witness)}",) if used else (),
        )


def after_steps(model: Model, paths: Paths) -> Formula:
    """What holds after every step because flows end in their domains."""
    last = [p.flow for p in paths.paths if p.target == END and p.point < paths.own_points]
    flows = [model.flows[k] for k in dict.fromkeys(last) if k is not None]
    return TRUE if None in last else disjunction(domain_at_end(flow) for flow in flows)


def postcondition(model: Model, problem: Problem, paths: Paths, oracle: Oracle) -> Iterator[Diagnostic]:
    """`postcondition-not-safe`: a violation of what is proved may go unnoticed.

    An obligation of the postcondition is noticed where its @progress predicate has an `on_failure`.
    """
    if not problem.annotated or model.postcondition is None or problem.shape.written_postcondition is None:
        return
    span = problem.shape.written_postcondition.span
    safe = [p for p in model.predicates if p.category == "safety"]
    wrong = negation(model.postcondition)
    used = {s.name for s in symbols(wrong)}
    met = [p for p in model.predicates if p.due is not None and p.on_failure is not None]
    known = [*(p.formula for p in safe), *(disjunction((negation(p.due or TRUE), p.formula)) for p in met)]
    facts = (*rigid_facts(model), after_steps(model, paths))
    answer = oracle.exists((*facts, *known, wrong), shown=sorted(used))
    if answer.verdict == "yes":
        yield warning(
            "postcondition-not-safe",
            "a state may be safe and violate the postcondition",
            span,
            "no @safety predicate implies it" if known else "there is no @safety predicate",
            "annotate a predicate that does, or write `@safety` above Problem",
            (f"for instance {_shown(answer.witness)}",) if used else (),
        )


def _shown(witness: Mapping[str, Fraction | str]) -> str:
    return ", ".join(f"{name} = {float(value):.6g}" for name, value in witness.items())


def standstill(model: Model, paths: Paths, options: Options) -> Iterator[Diagnostic]:
    """`zero-duration`: runs without a flow, and flows whose clock has run out after the first step."""
    if options.stall_limit or not model.loops or not model.flows:
        return
    start = paths.of(0)
    assigned = {
        s.variable for s in statements((*model.lead, *model.body)) if isinstance(s, Assign | AssignAny)
    }
    advice = "limit it with `@episode: stall_limit=...`"
    for path in start:
        if path.flow is None and path.target == END:
            label = "this run of a step has no flow"
            yield _standing(path.span, label, f"let time pass on it, or {advice}")
        elif path.flow is not None and (clock := _run_out(model.flows[path.flow], path, assigned)):
            label = f"`{clock}` is not reset on the way here: it runs out once"
            yield _standing(
                model.flows[path.flow].span, label, f"write `{clock} := 0;` before it, or {advice}"
            )


def _run_out(flow: Flow, path: Path, assigned: set[str]) -> str | None:
    """A clock that neither the path nor what follows it resets."""
    changed = {name for name, _ in path.updates}
    if path.target != END:
        changed |= assigned
    for horizon in flow.horizons:
        names = {s.name for s in symbols(horizon.bound)} | {horizon.clock}
        if not names & changed:
            return horizon.clock
    return None


def _standing(span: Span, label: str, help: str) -> Diagnostic:
    return warning("zero-duration", "a step that takes no time can be repeated for ever", span, label, help)
