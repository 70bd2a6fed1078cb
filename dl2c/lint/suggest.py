"""Annotations for a model that has none, or not enough to be built.

Comes in: a source and options. Go out: comments to insert, each in lines of its own, or, where a
declaration stands behind other text in its line, with a line end inside. Whoever removes them has
the model as it was. Bounds come from the precondition, and from a default where it limits nothing:
of what a step changes they are as wide as that default, since they limit observations too, but for
what the loop's invariant and the domain of its last flow exclude.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context
from fractions import Fraction

from dl2c.interval.arithmetic import WHOLE, Box, Interval, hull_of
from dl2c.interval.bounded import Range, bounded, initial_box, interval_of
from dl2c.interval.contract import contract
from dl2c.ir.liveness import read_first
from dl2c.ir.logic import conjunction, symbols
from dl2c.ir.model import (
    TRUE,
    UNBOUNDED,
    Bound,
    Constant,
    Evolve,
    Formula,
    Model,
    Symbol,
    Variable,
)
from dl2c.lint.edits import Edit
from dl2c.lint.world import changing
from dl2c.lower.invariant import invariant
from dl2c.lower.problem import lower
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.scan import scan
from dl2c.parse.sections import Section, find_sections
from dl2c.paths.enumerate import enumerate_paths
from dl2c.pipeline import compilation
from dl2c.resolve.problem import Problem
from dl2c.resolve.shape import written_variables
from dl2c.resolve.symbols import free_variables
from dl2c.source import Source

DEFAULT: Range = (Fraction(-10), Fraction(10))
CLOCK: Range = (Fraction(1, 10), Fraction(1))
"""Of a constant that limits how long a flow may last, in place of the default."""

SAFETY = "@safety: penalty=-1, on_failure=terminate:failure"
PROGRESS = "@progress: reward=1, on_success=terminate:success"

DIGITS = 3
"""Significant digits of a suggested limit that is no shorter decimal."""


@dataclass(frozen=True, slots=True)
class _Wish:
    """An annotation with this name and bound for a declaration."""

    declaration: tree.Declaration
    name: str
    limits: Interval
    hidden: bool = False


def suggestions(source: Source, options: Options) -> tuple[Edit, ...]:
    """What to insert into the text. Raises `CompileError` for a model that no annotation could help."""
    found = compilation(source, options).resolved
    problem, options = found.problem, found.options
    default = options.default_bound or DEFAULT
    model = lower(problem, replace(options, default_bound=default))
    drawn = bounded(_with_clocks(model), default)
    model = replace(model, constants=drawn.constants)
    scanned = scan(source)
    code, sections = scanned.text, find_sections(scanned, [])
    kept = _kept(problem, model)
    wishes = [*_variables(problem, model, drawn, kept, default), *_constants(problem, options, model, drawn)]
    declared = [w for w in wishes if _is_declared(w.declaration, sections)]
    edits = [*_bounds(code, declared), *_conclusions(problem, code, source)]
    return tuple(sorted(edits, key=lambda e: e.start))


def _with_clocks(model: Model) -> Model:
    """The model with `CLOCK` for constants that limit how long a flow lasts and have no upper limit."""
    limiting = {h.bound for flow in model.flows for h in flow.horizons}
    box = initial_box(model) or {}
    usual = Bound(*CLOCK)
    constants = tuple(
        replace(c, bound=usual)
        if c.symbol in limiting and c.bound == UNBOUNDED and _contains(box.get(c.symbol, WHOLE), usual)
        else c
        for c in model.constants
    )
    return replace(model, constants=constants)


def _contains(limits: Interval, bound: Bound) -> bool:
    inner = interval_of(bound)
    return limits.low <= inner.low and inner.high <= limits.high and math.isinf(limits.high)


def _kept(problem: Problem, model: Model) -> Formula:
    """What holds after every step of a proved model: its invariant, the domain of the flow that ends it."""
    last = model.body[-1] if model.body else None
    domain = model.flows[last.flow].domain if isinstance(last, Evolve) else TRUE
    return conjunction([invariant(problem) or TRUE, domain])


def _variables(
    problem: Problem, model: Model, drawn: Model, kept: Formula, default: Range
) -> Iterator[_Wish]:
    """Variables to annotate: those that lack limits or, if nothing is annotated, all that a step depends on,
    and its inputs.
    """
    box, unlimited = initial_box(drawn) or {}, _unlimited(model, drawn)
    usual = Interval(float(default[0]), float(default[1]))
    reached = _reached(model, box, usual, kept)
    inputs: dict[str, list[Interval]] = {}
    for given in enumerate_paths(model, default).inputs:
        inputs.setdefault(given.variable, []).append(Interval(float(given.low), float(given.high)))
    for (declaration, annotation), variable in zip(problem.variables, model.variables, strict=True):
        name = declaration.name
        own = [box.get(Symbol(name, "variable"), WHOLE)] if variable.initial == "sampled" else []
        if not own and read_first((*model.lead, *model.body), name, model.flows):
            own = [usual]
        limits = (*own, *inputs.get(name, ()))
        wanted = name in unlimited or name in inputs if problem.annotated else limits
        if annotation is None and wanted:
            wide = hull_of((*limits, reached[name]) if name in reached else limits)
            yield _Wish(declaration, "var", wide, problem.annotated)


def _reached(model: Model, start: Box, usual: Interval, kept: Formula) -> dict[str, Interval]:
    """What variables that change may be later: the default, but for what `kept` excludes."""
    names = changing(model)
    sampled = {v.symbol: start.get(v.symbol, WHOLE) for v in model.variables if v.initial == "sampled"}
    moving = {
        v.symbol: hull_of((sampled.get(v.symbol, usual), usual)) for v in model.variables if v.name in names
    }
    box = dict.fromkeys(symbols(kept), WHOLE) | dict(start) | moving
    narrowed = contract(kept, box) or box
    return {symbol.name: narrowed.get(symbol, limits) for symbol, limits in moving.items()}


def _constants(problem: Problem, options: Options, model: Model, drawn: Model) -> Iterator[_Wish]:
    box, unlimited = initial_box(drawn) or {}, _unlimited(model, drawn)
    unlimited |= {d.name for d, _ in problem.constants}
    fixed = dict(options.constants)
    for declaration, annotation in problem.constants:
        name = declaration.name
        if annotation is None and name in unlimited and name not in fixed:
            yield _Wish(declaration, "const", box.get(Symbol(name, "constant"), WHOLE))


def _unlimited(model: Model, drawn: Model) -> set[str]:
    """Names that only the default limits."""
    before: Mapping[str, Variable | Constant] = {i.name: i for i in (*model.variables, *model.constants)}
    return {i.name for i in (*drawn.variables, *drawn.constants) if i.bound != before[i.name].bound}


def _is_declared(declaration: tree.Declaration, sections: Sequence[Section]) -> bool:
    """Whether a section declares it, so that an annotation has a place; a quantifier has none."""
    at = declaration.span.start
    return any(s.kind in ("Definitions", "ProgramVariables") and s.begin <= at < s.end for s in sections)


def _bounds(code: str, wishes: Iterable[_Wish]) -> Iterator[Edit]:
    """One annotation for all names that share a declaration."""
    places: dict[int, list[_Wish]] = {}
    for wish in wishes:
        places.setdefault(_keyword(code, wish.declaration.span.start, "Real|R"), []).append(wish)
    for place, shared in places.items():
        wide = hull_of([w.limits for w in shared])
        bound = f"bound=[{_decimal(wide.low, ROUND_FLOOR)}:{_decimal(wide.high, ROUND_CEILING)}]"
        hidden = ", observe=false" if shared[0].hidden else ""
        yield _inserted(code, place, f"@{shared[0].name}: {bound}{hidden}")


def _conclusions(problem: Problem, code: str, source: Source) -> Iterator[Edit]:
    """What the box and the diamond promise, unless the model has predicates of its own."""
    if problem.predicates:
        return
    shape = problem.shape
    changed = written_variables(shape.suffix)
    for formula, written, text in (
        (shape.postcondition, shape.written_postcondition, SAFETY),
        (shape.progress, shape.written_progress, PROGRESS),
    ):
        if formula is not None and not changed & free_variables(formula):
            yield _inserted(code, _definition(problem, written, code) or _problem(problem, source), text)


def _definition(problem: Problem, written: tree.Formula | None, code: str) -> int | None:
    """Where the entry defines the predicate that a formula is, if it is one and no other call differs."""
    if not isinstance(written, tree.PredOf):
        return None
    declaration = problem.symbols.declarations[written.name]
    own = declaration.span.source is problem.entry.span.source
    inside = problem.entry.span.start <= declaration.span.start < problem.entry.span.end
    if not (own and inside) or declaration.annotations:
        return None
    conclusions = (problem.shape.written_postcondition, problem.shape.written_progress)
    calls = {f.args for f in conclusions if isinstance(f, tree.PredOf) and f.name == written.name}
    return _keyword(code, declaration.span.start, "Bool|B") if len(calls) == 1 else None


def _problem(problem: Problem, source: Source) -> int:
    """Where the word `Problem` of the entry stands."""
    at = problem.entry.problem.span.start
    return next(
        s.start for s in find_sections(scan(source), []) if s.kind == "Problem" and s.begin <= at < s.end
    )


def _keyword(code: str, before: int, words: str) -> int:
    """Where the last of these words begins before a place."""
    found = re.finditer(rf"(?<![A-Za-z0-9_])({words})(?![A-Za-z0-9_])", code[:before])
    return max(m.start() for m in found)


def _inserted(code: str, at: int, annotation: str) -> Edit:
    """A comment in a line of its own; behind other code, one that begins a line inside itself."""
    line = code.rfind("\n", 0, at) + 1
    indent = code[line:at]
    if indent.strip():
        return Edit(at, at, f"/*\n{annotation} */")
    return Edit(line, line, f"{indent}/* {annotation} */\n")


def _decimal(value: float, rounding: str) -> str:
    """A short decimal that the value was rounded from, else a few digits rounded outward."""
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    near = Context(prec=9, rounding=ROUND_HALF_EVEN).create_decimal_from_float(value)
    if abs(float(near) - value) > 1e-15 * abs(value):
        near = Context(prec=DIGITS, rounding=rounding).create_decimal_from_float(value)
    text = f"{near.normalize() + 0:f}"
    return "0" if float(text) == 0 else text
