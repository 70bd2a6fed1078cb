"""What a model claims: the formula of an entry with every definition expanded, as dL means it.

In: an entry and the values given to constants. Out: `Theorem`. Nothing of how the model is run matters here:
bounds are kept beside the formula for the second answer, within bounds. pi and e are symbols.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import reduce
from typing import Any

from dl2c.diagnostics import CompileError
from dl2c.ir.model import Number, Symbol, Term
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.annotations import ConstantAnnotation, VariableAnnotation, decode_declaration
from dl2c.resolve.bind import IN_HINTS, check, check_entry
from dl2c.resolve.errors import unknown_constants
from dl2c.resolve.expand import NONE, Expander, expanded_formula
from dl2c.resolve.infer import with_implied
from dl2c.resolve.problem import resolve
from dl2c.resolve.shape import conjuncts, written_variables
from dl2c.resolve.symbols import Node, Symbols, children, collect, nodes
from dl2c.resolve.unreadable import read_entry
from dl2c.source import Source
from dl2c.verify.arithmetic.total import PI, E
from dl2c.verify.execution import Kind
from dl2c.verify.hints import Hints, hints_of
from dl2c.verify.states import has_program
from dl2c.work import at_place, budgeted

Bounds = Mapping[str, tuple[Fraction | None, Fraction | None]]


@dataclass(frozen=True, slots=True)
class Theorem:
    """`formula` is the claim. `scope` has what each name stands for in the first state. `bounds` are those
    declared, by name. `safety` are the annotated predicates that must hold wherever a run may end.
    `hints` are what its tactics name.
    """

    name: str
    formula: tree.Formula
    scope: Mapping[str, Term]
    bounds: Bounds
    safety: tuple[tuple[str, tree.Formula], ...]
    hints: Hints


def theorem_in(source: Source, options: Options) -> Theorem:
    """The theorem of a model. Raises `CompileError` for a mistake in the model."""
    with budgeted():
        at_place(source.start)
        entry, given = read_entry(source, options.entry), dict(options.constants)
        theorem = theorem_of(entry, given)
        symbols, _ = collect(with_implied(entry))
        known = list(symbols.named("constant"))
        if unknown := unknown_constants(given, known, symbols.declarations, entry.span):
            raise CompileError(unknown)
        return theorem


def theorem_of(entry: tree.Entry, values: Mapping[str, Fraction]) -> Theorem:
    """The claim of an entry. Raises `CompileError` for what KeYmaera X refuses too, and undefined names."""
    entry = with_implied(entry)
    symbols, found = collect(entry)
    found += check_entry(entry, symbols)
    if found:
        raise CompileError(found)
    formula = expanded_formula(entry.problem, symbols)
    read = _Reader(symbols)
    scope: dict[str, Term] = {PI.name: PI, E.name: E}
    for name in symbols.named("variable", "constant"):
        kind = "variable" if symbols.roles[name] == "variable" else "constant"
        scope[name] = Number(values[name]) if name in values else Symbol(name, kind)
    return Theorem(
        entry.name,
        read.rewritten(formula),
        scope,
        _bounds(entry),
        tuple((name, read.rewritten(f)) for name, f in _safety(entry)),
        hints_of(entry, read.hint),
    )


@dataclass(frozen=True, slots=True)
class _Reader:
    """Rewrites expanded trees: pi and e by symbols, hints by their expansions."""

    symbols: Symbols

    def rewritten(self, node: Any) -> Any:
        """The node with all that is below it. An invariant that cannot be read is left out."""
        if isinstance(node, tree.FuncOf) and not node.args and node.name in ("pi", "e"):
            return tree.Variable(f"{node.name}()", span=node.span)
        changes: dict[str, Any] = {}
        for f in fields(node):
            value: Any = getattr(node, f.name)
            if f.name == "invariants":
                changes[f.name] = tuple(h for w in value if (h := self.hint(w)) is not None)
            elif isinstance(value, tree.Expression | tree.AtomicODE | tree.DifferentialProgramConst):
                changes[f.name] = self.rewritten(value)
            elif f.name in ("args", "equations"):
                changes[f.name] = tuple(self.rewritten(v) for v in value)
        return replace(node, **changes) if changes else node

    def hint(self, written: tree.Formula) -> tree.Formula | None:
        """An invariant, expanded; None where it is none of this model's formulas."""
        if any(check(written, self.symbols, IN_HINTS)):
            return None
        expander = Expander(self.symbols)
        try:
            expanded = expander.formula(written, {}, NONE)
        except CompileError:
            return None
        return None if expander.found else self.rewritten(expanded)


def _bounds(entry: tree.Entry) -> Bounds:
    """The declared bounds of variables and constants."""
    found: dict[str, tuple[Fraction | None, Fraction | None]] = {}
    for kind, declarations in (("variable", entry.variables), ("definition", entry.definitions)):
        for declaration in declarations:
            for a in _decoded(declaration, kind):
                if isinstance(a, VariableAnnotation | ConstantAnnotation) and a.bound is not None:
                    low, high = a.bound
                    found[declaration.name] = (_finite(low), _finite(high))
    return found


def _decoded(declaration: tree.Declaration, kind: Any) -> tuple[Any, ...]:
    try:
        return tuple(decode_declaration(declaration, kind))
    except CompileError:
        return ()


def _finite(value: Any) -> Fraction | None:
    return value if isinstance(value, Fraction) else None


def _safety(entry: tree.Entry) -> tuple[tuple[str, tree.Formula], ...]:
    """The `@safety` predicates, their parameters bound; none where no environment can be made."""
    try:
        problem = resolve(entry)
    except CompileError:
        return ()
    chosen = (p for p in problem.predicates if p.annotation.category == "safety")
    return tuple((p.declaration.name, p.formula) for p in chosen)


# What is claimed of a loop's invariant --------------------------------------------------


def obligation(
    theorem: Theorem,
    loop: tree.Loop,
    kind: Kind,
    invariant: Sequence[tree.Formula],
    wanted: Sequence[tree.Formula],
) -> tuple[Theorem, tree.Test] | None:
    """What an obligation says of a loop: of real runs that come to it, then of any state of its invariant.
    With the test at which that begins; None where the loop stands in a place for which there is no rule.

    `wanted` is what is to hold at the end; of "finally" it is what the theorem says.
    """
    end = None if kind == "finally" else _all(wanted)
    head = tree.Test(_all(invariant) if kind != "initially" else tree.Truth(True))
    instead: tree.Program = head
    if kind != "initially":
        for name in sorted(written_variables((loop,))):
            instead = tree.Compose(tree.AssignAny(name), instead)
    if kind == "step":
        instead = tree.Compose(instead, loop.child)
    formula = _instead(theorem.formula, loop, instead, end)
    return None if formula is None else (replace(theorem, formula=formula), head)


def _all(formulas: Sequence[tree.Formula]) -> tree.Formula:
    return reduce(tree.And, formulas) if formulas else tree.Truth(True)


def _instead(
    formula: tree.Formula, loop: tree.Loop, program: tree.Program, wanted: tree.Formula | None
) -> tree.Formula | None:
    """The claim that `wanted` holds where runs that come to a loop end with a program in its stead; without
    `wanted`, that what is said of their ends holds.
    """
    match formula:
        case tree.Imply(left, right) if (inner := _instead(right, loop, program, wanted)) is not None:
            return tree.Imply(left, inner)
        case tree.And(left, right):
            sides = (_instead(side, loop, program, wanted) for side in (left, right))
            return next((side for side in sides if side is not None), None)
        case tree.Forall() if (inner := _instead(formula.child, loop, program, wanted)) is not None:
            return replace(formula, child=inner)
        case tree.Box(before, child):
            if (changed := _exchanged(before, loop, program, wanted is None)) is not None:
                return tree.Box(changed, child if wanted is None else wanted)
            inner = _instead(child, loop, program, wanted)
            return None if inner is None else tree.Box(before, inner)
        case _:
            return None


def _exchanged(
    program: tree.Program, loop: tree.Loop, instead: tree.Program, whole: bool
) -> tree.Program | None:
    """The program with another one in the place of a loop, and, unless `whole`, without what comes after it.
    Other alternatives have no runs.
    """
    match program:
        case tree.Loop() if program.span == loop.span:
            return instead
        case tree.Loop(child) if not whole and (inner := _exchanged(child, loop, instead, whole)) is not None:
            return tree.Compose(program, inner)
        case tree.Compose(left, right):
            if (first := _exchanged(left, loop, instead, whole)) is not None:
                return tree.Compose(first, right) if whole else first
            second = _exchanged(right, loop, instead, whole)
            return None if second is None else tree.Compose(left, second)
        case tree.Choice(left, right):
            never = tree.Test(tree.Truth(False))
            if (first := _exchanged(left, loop, instead, whole)) is not None:
                return tree.Choice(first, never)
            second = _exchanged(right, loop, instead, whole)
            return None if second is None else tree.Choice(never, second)
        case _:
            return None


def ending_in(formula: tree.Formula, wanted: tree.Formula) -> tree.Formula:
    """The claim that `wanted` holds at the ends of runs."""
    match formula:
        case tree.Imply(left, right) if has_program(right):
            return tree.Imply(left, ending_in(right, wanted))
        case tree.Box(program, child):
            return tree.Box(program, ending_in(child, wanted))
        case tree.Forall(_, child):
            return replace(formula, child=ending_in(child, wanted))
        case _:
            return wanted


def assumptions(formula: tree.Formula) -> Iterator[tree.Formula]:
    """What is assumed before programs."""
    while isinstance(formula, tree.Imply):
        if not has_program(formula.left):
            yield formula.left
        formula = formula.right


def conclusions(formula: tree.Formula) -> Iterator[tree.Formula]:
    """The conditions after programs, as far as they are about states alone."""
    for node in nodes(formula):
        if isinstance(node, tree.Modal) and not has_program(node.child):
            yield node.child


def loops_of(formula: tree.Formula) -> Iterator[tree.Loop]:
    """The loops that need invariants: all but those of diamonds, unless these are negated boxes. A program
    that is in a box and in a diamond is looked at in the box.
    """
    stack: list[Node] = [formula]
    while stack:
        match stack.pop():
            case tree.Diamond(_, child):
                stack.append(child)
            case tree.Not(tree.Diamond(program, child)):
                stack += [child, program]
            case node:
                if isinstance(node, tree.Loop):
                    yield node
                stack.extend(reversed(children(node)))


def candidates(theorem: Theorem) -> tuple[tree.Formula, ...]:
    """What may be an invariant: conjuncts of hints, of what is to be shown, and of what is assumed."""
    safety = (f for _, f in theorem.safety)
    claims = *conclusions(theorem.formula), *safety, *assumptions(theorem.formula)
    return parts_of((*theorem.hints.loops, *claims))


def parts_of(formulas: Sequence[tree.Formula]) -> tuple[tree.Formula, ...]:
    """The conjuncts of all formulas."""
    return tuple(part for f in formulas for part in conjuncts(f))


def with_consequent(formula: tree.Formula) -> tuple[tree.Formula, ...]:
    """A formula, and of an implication what it is about where its condition holds."""
    return (formula, formula.right) if isinstance(formula, tree.Imply) else (formula,)
