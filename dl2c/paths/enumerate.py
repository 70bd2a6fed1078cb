"""From a lowered model to its guarded paths.

Assumes a model as `lower` makes it. Every combination of alternatives becomes a path;
tests that are false whatever the state, or contradict each other word for word, drop theirs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import assert_never

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.ir.logic import (
    atoms,
    conjunction,
    conjuncts,
    mapped,
    negation,
    operands,
    oriented,
    substituted,
    symbols,
)
from dl2c.ir.model import (
    FALSE,
    ONE,
    ZERO,
    Assign,
    AssignAny,
    Block,
    Choice,
    Compare,
    Evolve,
    Formula,
    If,
    Model,
    Sub,
    Symbol,
    Term,
    Test,
)
from dl2c.ir.polynomial import polynomial
from dl2c.paths import errors
from dl2c.paths.limits import input_limits
from dl2c.paths.path import END, Admission, Decision, Input, Limit, Path, Paths
from dl2c.source import NOWHERE, Span

MAX_PATHS = 4096
MAX_SIZE = 100_000
"""Symbols in the value of a variable, written over the state at the start of its path."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A straight line up to and including its flow, and what remains to be done after it."""

    decisions: tuple[tuple[str, int, bool], ...]
    statements: tuple[Assign | AssignAny | Test | Evolve, ...]
    rest: Block


@dataclass(frozen=True, slots=True)
class _Draft:
    """A line with its assignments substituted: `tests` and `updates` over the state at its point."""

    point: int
    line: _Line
    inputs: tuple[str, ...]
    tests: Formula
    updates: tuple[tuple[str, Term], ...]
    flow: int | None
    target: int


def enumerate_paths(model: Model) -> Paths:
    """All guarded paths of one step.

    Raises `CompileError` if there are more than `MAX_PATHS`, if a test of an input is outside
    the class that can be resolved, or if an input has no finite range.
    """
    points: list[Block] = [model.body]
    drafts: list[_Draft] = []
    done = 0
    seen = 0
    while done < len(points):
        for line in _lines(points[done]):
            seen += 1
            if seen > MAX_PATHS:
                raise CompileError(errors.too_many_paths(MAX_PATHS, _first_span(model.body)))
            draft = _draft(model, points, done, line)
            if draft.tests != FALSE:
                drafts.append(draft)
        done += 1
    tests: dict[str, list[Formula]] = {}
    for draft in drafts:
        for key in draft.inputs:
            tests.setdefault(key, []).append(draft.tests)
    inputs = input_limits(model, tuple(_inputs(model.body)), tests)
    decisions = tuple(_decisions(model.body))
    found: list[Diagnostic] = []
    paths = tuple(_path(draft, decisions, inputs, found) for draft in drafts)
    if found:
        raise CompileError(found)
    return Paths(decisions, inputs, len(points), paths)


def _decisions(block: Block) -> Iterator[Decision]:
    for statement in block:
        match statement:
            case Choice(key, alternatives, role, name):
                texts = tuple(_shown(a.span) for a in alternatives)
                yield Decision(key, name, role, texts)
                for alternative in alternatives:
                    yield from _decisions(alternative.body)
            case If(_, _, then, orelse):
                yield from _decisions(then)
                yield from _decisions(orelse)
            case Assign() | AssignAny() | Test() | Evolve():
                pass
            case _:
                assert_never(statement)


def _inputs(block: Block) -> Iterator[AssignAny]:
    for statement in block:
        match statement:
            case AssignAny():
                yield statement
            case Choice(_, alternatives):
                for alternative in alternatives:
                    yield from _inputs(alternative.body)
            case If(_, _, then, orelse):
                yield from _inputs(then)
                yield from _inputs(orelse)
            case Assign() | Test() | Evolve():
                pass
            case _:
                assert_never(statement)


def _shown(span: Span) -> str:
    """The text of an alternative on one line, without comments' line ends."""
    return " ".join(span.text.split())


def _first_span(block: Block) -> Span:
    return block[0].span if block else NOWHERE


def _lines(block: Block) -> Iterator[_Line]:
    """Every straight line from the start of a block to its first flow or its end."""
    if not block:
        yield _Line((), (), ())
        return
    first, rest = block[0], block[1:]
    match first:
        case Evolve():
            yield _Line((), (first,), rest)
        case Assign() | AssignAny() | Test():
            for line in _lines(rest):
                yield replace(line, statements=(first, *line.statements))
        case If(condition, otherwise, then, orelse):
            for guard, body in ((condition, then), (otherwise, orelse)):
                test = Test(guard, span=first.span)
                for line in _lines((test, *body, *rest)):
                    yield line
        case Choice(key, alternatives):
            for k, alternative in enumerate(alternatives):
                for line in _lines((*alternative.body, *rest)):
                    yield replace(line, decisions=((key, k, alternative.fallback), *line.decisions))
        case _:
            assert_never(first)


def _draft(model: Model, points: list[Block], point: int, line: _Line) -> _Draft:
    """Substitute a line's assignments; a new point is appended to `points`."""
    values: dict[Symbol, Term] = {}
    sizes: dict[Term, int] = {}
    tests: list[Formula] = []
    inputs: list[str] = []
    flow = None
    for statement in line.statements:
        match statement:
            case Assign(name, term):
                symbol = Symbol(name, "variable")
                values[symbol], sizes[symbol] = substituted(term, values), _size(term, sizes)
                if sizes[symbol] > MAX_SIZE:
                    raise CompileError(errors.too_large(name, MAX_SIZE, statement.span))
            case AssignAny(name, key):
                values[Symbol(name, "variable")] = Symbol(key, "input")
                inputs.append(key)
            case Test(formula):
                tests.append(_at_start(formula, values))
            case Evolve(flow):
                tests.append(_at_start(model.flows[flow].domain, values))
            case _:
                assert_never(statement)
    updates = tuple((s.name, t) for s, t in values.items() if s != t)
    return _Draft(point, line, tuple(inputs), _together(tests), updates, flow, _target(points, line.rest))


def _together(tests: list[Formula]) -> Formula:
    """The conjunction, each part once; false where a part contradicts others word for word."""
    parts: dict[Formula, Formula] = {}
    for part in conjuncts(conjunction(tests)):
        parts.setdefault(oriented(part), part)
    for part in parts:
        if all(opposite in parts for opposite in conjuncts(oriented(negation(part)))):
            return FALSE
    return conjunction(parts.values())


def _size(term: Term, sizes: dict[Term, int]) -> int:
    """How many symbols a term has once those in `sizes` are substituted."""
    return sizes.get(term, 1) + sum(_size(t, sizes) for t in operands(term))


def _path(
    draft: _Draft, decisions: tuple[Decision, ...], inputs: tuple[Input, ...], found: list[Diagnostic]
) -> Path:
    """The path of a draft; tests of inputs that cannot be resolved go to `found`."""
    guard, admissions = _split(draft, inputs, found)
    chosen = {key: alternative for key, alternative, _ in draft.line.decisions}
    index = {d.key: k for k, d in enumerate(decisions)}
    return Path(
        point=draft.point,
        decisions=tuple(chosen.get(d.key, -1) for d in decisions),
        met=tuple(index[key] for key, _, _ in draft.line.decisions),
        marks=tuple(mark for _, _, mark in draft.line.decisions),
        guard=guard,
        admissions=admissions,
        updates=draft.updates,
        flow=draft.flow,
        target=draft.target,
        span=_first_span(draft.line.statements),
    )


def _at_start(formula: Formula, values: dict[Symbol, Term]) -> Formula:
    return mapped(formula, lambda term: substituted(term, values))


def _target(points: list[Block], rest: Block) -> int:
    if not rest:
        return END
    if rest not in points:
        points.append(rest)
    return points.index(rest)


def _split(
    draft: _Draft, inputs: tuple[Input, ...], found: list[Diagnostic]
) -> tuple[Formula, tuple[Admission, ...]]:
    """Tests that no input decides, and for every input met those that it alone decides."""
    keys = {i.key: k for k, i in enumerate(inputs)}
    guard: list[Formula] = []
    by_input: dict[int, list[Compare]] = {keys[key]: [] for key in draft.inputs}
    for part in conjuncts(draft.tests):
        used = sorted(keys[s.name] for s in symbols(part) if s.kind == "input")
        if not used:
            guard.append(part)
        elif (problem := _unresolved(inputs, part, used)) is not None:
            found.append(problem)
        else:
            assert isinstance(part, Compare)
            by_input[used[0]].append(part)
    admissions = tuple(
        Admission(k, conjunction(parts), tuple(_limit(inputs[k], p) for p in parts))
        for k, parts in by_input.items()
    )
    return conjunction(guard), admissions


def _unresolved(inputs: tuple[Input, ...], part: Formula, used: list[int]) -> Diagnostic | None:
    """Why a test of inputs cannot be resolved, if it cannot."""
    variable = inputs[used[0]].variable
    if not isinstance(part, Compare):
        first, *_, last = (a.span for a in (*atoms(part), *atoms(part)))
        return errors.disjunctive_test(variable, first.to(last) if first.source is last.source else first)
    if len(used) > 1:
        return errors.joint_test(tuple(inputs[k].variable for k in used), part.span)
    if part.op in ("=", "!="):
        return errors.single_value_test(variable, part.op, part.span)
    margin = polynomial(_margin(part), {inputs[used[0]].symbol: (ZERO, ONE)})
    if margin is None or len(margin) > 2:
        return errors.nonlinear_test(variable, part.span)
    return None


def _margin(atom: Compare) -> Term:
    return Sub(atom.right, atom.left) if atom.op in ("<", "<=") else Sub(atom.left, atom.right)


def _limit(given: Input, atom: Compare) -> Limit:
    margin = polynomial(_margin(atom), {given.symbol: (ZERO, ONE)})
    assert margin is not None
    offset, slope = (*margin, ZERO)[:2]
    return Limit(offset, slope)
