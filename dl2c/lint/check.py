"""Everything that can be said of a model without compiling C: errors, warnings, lints.

A lint is a warning with a code of `codes.py`; `@episode: allow=code|code` silences it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from dl2c.diagnostics import CompileError, Diagnostic, in_source_order
from dl2c.lint import annotations, choices, runs
from dl2c.lint.allowed import allowed, unknown
from dl2c.lint.conditions import constant_tests
from dl2c.lint.portable import portability, quotients
from dl2c.lint.units import unit_mismatches
from dl2c.lower.doubts import program_warnings
from dl2c.options import Options
from dl2c.parse.errors import REJECTS
from dl2c.pipeline import Compilation, compilation
from dl2c.smt.query import Oracle
from dl2c.source import Source
from dl2c.work import at_place, at_stage, budgeted


def examine(source: Source, options: Options, *, portable: bool = False) -> tuple[Diagnostic, ...]:
    """All diagnostics of a model. With `portable` what KeYmaera X 5 does not read is an error."""
    found: tuple[Diagnostic, ...] = ()
    model = compilation(source, options)
    if portable:
        try:
            found = tuple(replace(d, severity="error") for d in portability(source, model.read))
        except CompileError as unreadable:
            return unreadable.diagnostics
    return examined(source, model, found)


def examined(
    source: Source, model: Compilation, before: Sequence[Diagnostic] = (), *, solving: bool = True
) -> tuple[Diagnostic, ...]:
    """All diagnostics of a compilation, and those `before`; without `solving`, what needs no solver."""
    found = [*before]
    try:
        warnings = model.warnings if solving else _plain_warnings(model)
    except CompileError as refused:
        return in_source_order((*found, *refused.diagnostics))
    places = {d.span for d in found}
    found += (d for d in warnings if not (d.code == REJECTS and d.span in places))
    try:
        with budgeted():
            at_place(model.place)
            at_stage("looking for what it may not mean")
            found += (lints if solving else plain_lints)(source, model)
    except CompileError as unfinished:
        found += (replace(d, severity="warning") for d in unfinished.diagnostics)
    return in_source_order(allowed(found, model.resolved.problem))


def _plain_warnings(model: Compilation) -> tuple[Diagnostic, ...]:
    """Those of a build that need no solver. Raises `CompileError` for such errors."""
    assert model.flows is not None
    return (*model.resolved.warnings, *program_warnings(model.lowered.model))


def lints(source: Source, model: Compilation) -> Iterator[Diagnostic]:
    """The lints of a model that can be built."""
    problem, step, paths, oracle = model.resolved.problem, model.lowered.model, model.paths, Oracle()
    yield from plain_lints(source, model)
    yield from runs.postcondition(step, problem, paths, oracle)
    yield from annotations.shapes(step, problem, oracle)
    dead = tuple(runs.dead_alternatives(step, paths, oracle))
    yield from dead
    yield from (d for d in constant_tests(step, oracle) if not any(_within(d, other) for other in dead))
    yield from runs.deadlock(step, problem, paths, oracle)


def plain_lints(source: Source, model: Compilation) -> Iterator[Diagnostic]:
    """Those that need no solver."""
    problem, options = model.resolved.problem, model.resolved.options
    step, paths = model.lowered.model, model.paths
    yield from quotients(source, model.read[0])
    yield from annotations.ends_of_episodes(problem)
    yield from annotations.penalties(step, problem)
    yield from annotations.safety_checks(step, paths, options)
    yield from annotations.limits(step, options, problem)
    yield from annotations.unobserved(step, problem)
    yield from annotations.durations(step, options)
    yield from choices.flattened(problem)
    yield from runs.standstill(step, paths, options)
    yield from unit_mismatches(problem)
    yield from unknown(problem)


def _within(inner: Diagnostic, outer: Diagnostic) -> bool:
    a, b = inner.span, outer.span
    return a.source is b.source and b.start <= a.start and a.end <= b.end
