"""Annotated predicates with their parameters bound (semantics 1).

The arguments of an annotated predicate are those of its calls in the postcondition, else
in the loop's @invariant, else in the assumptions. Exactly one list binds; several are an
error; with none, each parameter stands for the variable or constant of its name. Rewards,
penalties and shapes see the same parameters, and may use predicates as values (their
distance to satisfaction, paper 4.4).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.parse import tree
from dl2c.parse.annotations import PredicateAnnotation
from dl2c.parse.printer import print_term
from dl2c.resolve.bind import check
from dl2c.resolve.expand import NONE, Expander
from dl2c.resolve.shape import Shape
from dl2c.resolve.symbols import Node, Symbols, children

Arguments = tuple[tree.Term, ...]


@dataclass(frozen=True, slots=True)
class ValueTerm:
    """A reward expression. Variables named in `deltas` stand for the distance to those formulas."""

    term: tree.Term
    deltas: dict[str, tree.Formula]


@dataclass(frozen=True, slots=True)
class AnnotatedPredicate:
    """An annotated predicate, expanded. `due` are the left-hand sides of obligations `due -> P` in Q."""

    declaration: tree.Declaration
    annotation: PredicateAnnotation
    formula: tree.Formula
    reward: ValueTerm | None
    penalty: ValueTerm | None
    shape: ValueTerm | None
    due: tuple[tuple[tree.Formula, ...], ...]


def bind_predicates(
    declared: Sequence[tuple[tree.Declaration, PredicateAnnotation]], shape: Shape, symbols: Symbols
) -> tuple[AnnotatedPredicate, ...]:
    """Raises `CompileError` with every error in any of them."""
    found: list[Diagnostic] = []
    bound: list[AnnotatedPredicate] = []
    for declaration, annotation in declared:
        try:
            bound.append(_bound(declaration, annotation, shape, symbols))
        except CompileError as problem:
            found += problem.diagnostics
    if found:
        raise CompileError(found)
    return tuple(bound)


def _bound(
    declaration: tree.Declaration, annotation: PredicateAnnotation, shape: Shape, symbols: Symbols
) -> AnnotatedPredicate:
    if not isinstance(declaration.body, tree.Formula):
        raise CompileError(_not_a_predicate(declaration))
    arguments = _arguments(declaration, shape, symbols)
    values = {p.name: a for p, a in zip(declaration.parameters or (), arguments, strict=True)}
    expander = Expander(symbols)
    formula = expander.formula(declaration.body, values, NONE)
    parts = (annotation.reward, annotation.penalty, annotation.shape)
    reward, penalty, potential = (_value(p, values, symbols) for p in parts)
    due = tuple(
        tuple(expander.formula(f, {}, NONE) for f in premises)
        for premises in _obligations(shape.written_postcondition, declaration.name, arguments, expander)
    )
    if expander.found:
        raise CompileError(expander.found)
    return AnnotatedPredicate(declaration, annotation, formula, reward, penalty, potential, due)


def _not_a_predicate(declaration: tree.Declaration) -> Diagnostic:
    return error(
        "annotation-not-on-predicate",
        "this annotation belongs to a predicate",
        declaration.span,
        f"`{declaration.name}` is not a `Bool` with a definition",
    )


def _arguments(declaration: tree.Declaration, shape: Shape, symbols: Symbols) -> Arguments:
    """The one argument list that binds the parameters."""
    places: list[tuple[tree.Formula, ...]] = [
        tuple(f for f in (shape.written_postcondition, shape.written_progress) if f is not None),
        shape.loop.invariants if shape.loop else (),
        shape.written_assumptions,
    ]
    for formulas in places:
        calls = list(dict.fromkeys(c for f in formulas for c in _calls(f, declaration.name, {}, symbols)))
        if len(calls) > 1:
            raise CompileError(_ambiguous(declaration, calls))
        if calls:
            return calls[0]
    return _namesakes(declaration, symbols)


def _calls(node: Node, name: str, values: dict[str, tree.Term], symbols: Symbols) -> Iterator[Arguments]:
    """Argument lists of the calls of a predicate, also inside other predicates."""
    if isinstance(node, tree.PredOf):
        expander = Expander(symbols)
        actual = tuple(expander.term(a, values, NONE) for a in node.args)
        if node.name == name:
            yield actual
            return
        definition = symbols.declarations.get(node.name)
        if definition is not None and isinstance(definition.body, tree.Formula):
            inner = {p.name: a for p, a in zip(definition.parameters or (), actual, strict=True)}
            yield from _calls(definition.body, name, inner, symbols)
        return
    for child in children(node):
        yield from _calls(child, name, values, symbols)


def _ambiguous(declaration: tree.Declaration, calls: Sequence[Arguments]) -> Diagnostic:
    lists = tuple(f"{declaration.name}({', '.join(print_term(a) for a in args)})" for args in calls)
    return error(
        "ambiguous-arguments",
        f"`{declaration.name}` is called with different arguments",
        declaration.span,
        "an annotated predicate stands for one condition",
        "define one predicate for each, and annotate them separately",
        lists,
    )


def _namesakes(declaration: tree.Declaration, symbols: Symbols) -> Arguments:
    """Without a call each parameter is the variable or constant of its name."""
    arguments: list[tree.Term] = []
    found: list[Diagnostic] = []
    for parameter in declaration.parameters or ():
        if symbols.roles.get(parameter.name) in ("variable", "constant"):
            arguments.append(tree.Variable(parameter.name, span=parameter.span))
        else:
            found.append(_unbound(declaration, parameter))
    if found:
        raise CompileError(found)
    return tuple(arguments)


def _unbound(declaration: tree.Declaration, parameter: tree.Parameter) -> Diagnostic:
    return error(
        "unbound-parameter",
        f"nothing says what parameter `{parameter.name}` of `{declaration.name}` stands for",
        parameter.span,
        "not a variable or constant, and the problem does not call the predicate",
        f"call `{declaration.name}` in the postcondition or @invariant, or name the parameter after a variable",
    )


def _value(
    expression: tree.Term | tree.Formula | None, values: dict[str, tree.Term], symbols: Symbols
) -> ValueTerm | None:
    """A reward expression with predicates taken out and definitions expanded."""
    if expression is None:
        return None
    deltas: dict[str, tree.Formula] = {}
    term = _without_predicates(expression, deltas, symbols)
    found = [
        d for part in (term, *deltas.values()) for d in check(part, symbols, frozenset({*values, *deltas}))
    ]
    if found:
        raise CompileError(found)
    expander = Expander(symbols)
    own = {name: tree.Variable(name) for name in deltas}
    expanded = expander.term(term, {**values, **own}, NONE)
    formulas = {name: expander.formula(f, values, NONE) for name, f in deltas.items()}
    if expander.found:
        raise CompileError(expander.found)
    return ValueTerm(expanded, formulas)


def _without_predicates(
    expression: tree.Term | tree.Formula, deltas: dict[str, tree.Formula], symbols: Symbols
) -> tree.Term:
    """The expression with each predicate replaced by a fresh variable that `deltas` explains."""
    match expression:
        case tree.Variable(name) if symbols.roles.get(name) == "predicate":
            return _fresh(tree.PredOf(name, (), span=expression.span), deltas)
        case tree.FuncOf(name, args) if symbols.roles.get(name) == "predicate":
            return _fresh(tree.PredOf(name, args, span=expression.span), deltas)
        case tree.FuncOf(name, args):
            return tree.FuncOf(
                name, tuple(_without_predicates(a, deltas, symbols) for a in args), span=expression.span
            )
        case tree.Neg(child):
            return tree.Neg(_without_predicates(child, deltas, symbols), span=expression.span)
        case tree.Plus() | tree.Minus() | tree.Times() | tree.Divide() | tree.Power():
            left = _without_predicates(expression.left, deltas, symbols)
            right = _without_predicates(expression.right, deltas, symbols)
            return type(expression)(left, right, span=expression.span)
        case (
            tree.Number()
            | tree.Variable()
            | tree.DifferentialSymbol()
            | tree.UnitFunctional()
            | tree.Differential()
        ):
            return expression
        case _:
            return _fresh(expression, deltas)


def _fresh(formula: tree.Formula, deltas: dict[str, tree.Formula]) -> tree.Term:
    name = f"delta {len(deltas)}"
    deltas[name] = formula
    return tree.Variable(name, span=formula.span)


def _obligations(
    postcondition: tree.Formula | None, name: str, arguments: Arguments, expander: Expander
) -> Iterator[tuple[tree.Formula, ...]]:
    """Premises D of every `D -> P` in Q under & only; `!D | P` and `D1 -> (D2 -> P)` count as well."""

    def is_call(formula: tree.Formula) -> bool:
        if not isinstance(formula, tree.PredOf) or formula.name != name:
            return False
        return tuple(expander.term(a, {}, NONE) for a in formula.args) == arguments

    def walk(formula: tree.Formula, premises: tuple[tree.Formula, ...]) -> Iterator[tuple[tree.Formula, ...]]:
        if premises and is_call(formula):
            yield premises
            return
        match formula:
            case tree.And(left, right):
                yield from walk(left, premises)
                yield from walk(right, premises)
            case tree.Imply(left, right):
                yield from walk(right, (*premises, left))
            case tree.Or(tree.Not(left), right) | tree.Or(right, tree.Not(left)):
                yield from walk(right, (*premises, left))
            case _:
                return

    if postcondition is not None:
        yield from walk(postcondition, ())
