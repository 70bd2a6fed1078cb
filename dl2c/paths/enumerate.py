"""From a lowered model to its guarded paths.

Assumes a model as `lower` makes it. Every combination of alternatives becomes a path;
tests that are false whatever the state, or contradict each other word for word, drop theirs.
A while loop is not unrolled: its head is a point, to which the paths through its body return. So
is the first branch after an input that the agent does not give: its value is drawn before.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeVar, assert_never, get_args

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.ir.liveness import statements
from dl2c.ir.logic import conjunction, conjuncts, mapped, negation, operands, oriented, substituted
from dl2c.ir.model import (
    FALSE,
    Alternative,
    Assign,
    AssignAny,
    Block,
    Choice,
    Evolve,
    Formula,
    If,
    Model,
    Repeat,
    Role,
    Symbol,
    Term,
    Test,
    While,
)
from dl2c.paths import errors
from dl2c.paths.admitted import Meeting, Order, admitted, order_of
from dl2c.paths.limits import input_limits
from dl2c.paths.path import END, Decision, Input, Path, Paths, duration_input
from dl2c.source import NOWHERE, Span
from dl2c.work import spend

MAX_PATHS = 4096
MAX_LENGTH = 2000
"""Statements on one path."""
MAX_STATEMENTS = 400_000
"""Statements on all paths."""
MAX_SIZE = 100_000
"""Symbols in the value of a variable, written over the state at the start of its path."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A straight line up to and including its flow, and what remains to be done after it.

    It also ends at another cut point, which then is the first of `rest`.
    """

    decisions: tuple[tuple[str, int, bool], ...]
    statements: tuple[Assign | AssignAny | Test | Evolve, ...]
    rest: Block
    enters: bool = False


@dataclass(frozen=True, slots=True)
class Draft:
    """A line with its assignments substituted: `tests` and `updates` over the state at its point.

    `inputs` are the keys of the nondeterministic assignments on it, in order.
    """

    point: int
    line: _Line
    inputs: tuple[str, ...]
    tests: Formula
    updates: tuple[tuple[str, Term], ...]
    flow: int | None
    target: int

    @property
    def span(self) -> Span:
        return _first_span(self.line.statements)

    @property
    def alternatives(self) -> dict[str, int]:
        """Which alternative each of its decisions takes, by their keys."""
        return {key: alternative for key, alternative, _ in self.line.decisions}

    def place_of(self, key: str) -> Span:
        """Where an input is assigned."""
        return next(s.span for s in self.line.statements if isinstance(s, AssignAny) and s.key == key)


def control_drafts(model: Model, program: Block) -> tuple[Draft, ...]:
    """Every line from the start of a program, its tests not yet resolved for its inputs.

    Raises `CompileError` if there are too many.
    """
    found: list[Draft] = []
    _explore(model, program, [], found)
    return tuple(d for d in found if d.point == 0)


def enumerate_paths(model: Model, default_bound: tuple[Fraction, Fraction] | None = None) -> Paths:
    """All guarded paths of one step; `default_bound` limits inputs that nothing else limits.

    Raises `CompileError` if there are more than `MAX_PATHS`, if a test of an input is outside
    the class that can be resolved, or if an input has no finite range.
    """
    points: list[Block] = []
    drafts: list[Draft] = []
    entries = {name: block for name, block in (("lead", model.lead), ("prefix", model.prefix)) if block}
    _explore(model, model.body, points, drafts)
    starts = {name: _explore(model, block, points, drafts) for name, block in entries.items()}
    programs = (*model.lead, *model.body, *model.prefix)
    tests: dict[str, list[Formula]] = {}
    for draft in drafts:
        for key in draft.inputs:
            tests.setdefault(key, []).append(draft.tests)
    inputs = input_limits(model, _by_role({a.key: a for a in assignments_of(programs)}), tests, default_bound)
    flows = tuple(dict.fromkeys(s.flow for s in statements(model.body) if isinstance(s, Evolve)))
    if model.duration == "agent":
        durations = tuple(duration_input(k) for k in flows if not model.flows[k].drawn)
        agents = sum(i.role == "agent" for i in inputs)
        inputs = (*inputs[:agents], *durations, *inputs[agents:])
    sampled = tuple(k for k in flows if model.flows[k].drawn)
    decisions = _by_role({d.key: d for d in decisions_of(programs)})
    found: list[Diagnostic] = []
    order = order_of(dict.fromkeys(Meeting(d.point, d.inputs, d.target) for d in drafts))
    paths = tuple(_path(draft, decisions, inputs, order, found) for draft in drafts)
    if found:
        raise CompileError(found)
    lead, prefix = starts.get("lead"), starts.get("prefix")
    deep = model.mask_depth == "step" and model.duration != "agent"
    return Paths(decisions, inputs, len(points), paths, lead, prefix, sampled, deep)


def _explore(model: Model, start: Block, points: list[Block], drafts: list[Draft]) -> int:
    """Append a point for the start of a program, and everything reached from it; the point."""
    first = done = len(points)
    points.append(start)
    seen, statements = len(drafts), 0
    while done < len(points):
        for line in _lines_from(points[done]):
            seen += 1
            if seen > MAX_PATHS:
                raise CompileError(errors.too_many_paths(MAX_PATHS, _first_span(start)))
            statements += len(line.statements)
            if statements > MAX_STATEMENTS:
                raise CompileError(errors.too_long_paths(MAX_STATEMENTS, _first_span(start)))
            draft = _draft(model, points, done, line)
            if draft.tests != FALSE:
                drafts.append(draft)
        done += 1
    return first


_Decided = TypeVar("_Decided", Decision, AssignAny)


def _by_role(found: Mapping[str, _Decided]) -> tuple[_Decided, ...]:
    """Those of the agent, of the environment, of a reset."""
    return tuple(d for role in get_args(Role) for d in found.values() if d.role == role)


def decisions_of(block: Block) -> Iterator[Decision]:
    """Every discrete decision in a block, in program order, each as often as it is written."""
    for statement in statements(block):
        if isinstance(statement, Choice | Repeat):
            texts = tuple(map(_shown, statement.alternatives))
            yield Decision(statement.key, statement.name, statement.role, texts)


def assignments_of(block: Block) -> Iterator[AssignAny]:
    """Every nondeterministic assignment in a block, likewise."""
    return (s for s in statements(block) if isinstance(s, AssignAny))


def _shown(alternative: Alternative) -> str:
    """Its text on one line, without comments' line ends."""
    text = " ".join(alternative.span.text.split())
    times = alternative.times
    return text if times is None else f"{times} time{'s' * (times != 1)} {text}".strip()


def _first_span(block: Block) -> Span:
    return block[0].span if block else NOWHERE


def _lines_from(point: Block) -> Iterator[_Line]:
    """Every straight line from a point; at the head of a while loop into it and past it."""
    if point and isinstance(loop := point[0], While):
        into = (Test(loop.condition, span=loop.span), *loop.body, *point)
        yield from (replace(line, enters=True) for line in _lines(into))
        yield from _lines((Test(loop.otherwise, span=loop.span), *point[1:]))
    else:
        yield from _lines(point)


def _lines(block: Block) -> Iterator[_Line]:
    """Every straight line from the start of a block to its first flow or while loop, or its end.

    A decision that was taken earlier on the line keeps its outcome. It also ends before a branch
    where an input was `drawn` on it.
    """
    todo = [(_Line((), (), block), False)]
    while todo:
        spend()
        line, drawn = todo.pop()
        if not line.rest:
            yield line
            continue
        first, rest = line.rest[0], line.rest[1:]
        if len(line.statements) > MAX_LENGTH:
            raise CompileError(errors.too_long(MAX_LENGTH, first.span))
        match first:
            case Evolve():
                yield replace(line, statements=(*line.statements, first), rest=rest)
            case While():
                yield line
            case If() | Choice() | Repeat() if drawn:
                yield line
            case Assign() | AssignAny() | Test():
                draws = isinstance(first, AssignAny) and first.role != "agent"
                todo.append((_with(line, first, rest), drawn or draws))
            case If(condition, otherwise, then, orelse):
                for guard, body in ((otherwise, orelse), (condition, then)):
                    todo.append((_with(line, Test(guard, span=first.span), (*body, *rest)), False))
            case Choice(key, alternatives) | Repeat(key=key, alternatives=alternatives):
                taken = {k: outcome for k, outcome, _ in line.decisions}
                for k in (taken[key],) if key in taken else reversed(range(len(alternatives))):
                    decision = () if key in taken else ((key, k, alternatives[k].fallback),)
                    decisions = (*line.decisions, *decision)
                    todo.append(
                        (replace(line, decisions=decisions, rest=(*alternatives[k].body, *rest)), False)
                    )
            case _:
                assert_never(first)


def _with(line: _Line, statement: Assign | AssignAny | Test, rest: Block) -> _Line:
    return replace(line, statements=(*line.statements, statement), rest=rest)


def _draft(model: Model, points: list[Block], point: int, line: _Line) -> Draft:
    """Substitute a line's assignments; a new point is appended to `points`."""
    values: dict[Symbol, Term] = {}
    sizes: dict[Term, int] = {}
    tests: list[Formula] = []
    inputs: list[str] = []
    flow = None
    for statement in line.statements:
        spend()
        match statement:
            case Assign(name, term):
                symbol = Symbol(name, "variable")
                values[symbol], sizes[symbol] = substituted(term, values), _size(term, sizes)
                if sizes[symbol] > MAX_SIZE:
                    raise CompileError(errors.too_large(name, MAX_SIZE, statement.span))
            case AssignAny(name, key):
                values[Symbol(name, "variable")] = Symbol(key, "input")
                inputs += [key] if key not in inputs else []
            case Test(formula):
                tests.append(_at_start(formula, values))
            case Evolve(flow):
                tests.append(_at_start(model.flows[flow].domain, values))
            case _:
                assert_never(statement)
    updates = tuple((s.name, t) for s, t in values.items() if s != t)
    return Draft(point, line, tuple(inputs), _together(tests), updates, flow, _target(points, line.rest))


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
    draft: Draft,
    decisions: tuple[Decision, ...],
    inputs: tuple[Input, ...],
    order: Order,
    found: list[Diagnostic],
) -> Path:
    """The path of a draft; tests of inputs that cannot be resolved go to `found`."""
    meeting = Meeting(draft.point, draft.inputs, draft.target)
    guard, admissions = admitted(draft.tests, meeting, inputs, order, found)
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
        span=draft.span,
        enters=draft.line.enters,
        statements=tuple(s.span for s in draft.line.statements),
    )


def _at_start(formula: Formula, values: dict[Symbol, Term]) -> Formula:
    return mapped(formula, lambda term: substituted(term, values))


def _target(points: list[Block], rest: Block) -> int:
    if not rest:
        return END
    if rest not in points:
        points.append(rest)
    return points.index(rest)
