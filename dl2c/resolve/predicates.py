"""Annotated predicates with their parameters bound (semantics 1).

The arguments of an annotated predicate are those of its calls in the postcondition, else
in the loop's @invariant, else in the assumptions. Exactly one list binds; several are an
error; with none, each parameter stands for the variable or constant of its name. Rewards,
penalties and shapes see the same parameters, and may use predicates as values (their
distance to satisfaction, paper 4.4). A `Real` function with a `@stability` shape binds its
parameters alike; as a predicate it is true.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.parse import tree
from dl2c.parse.annotations import PredicateAnnotation
from dl2c.parse.printer import print_term
from dl2c.resolve.bind import IN_HINTS, check
from dl2c.resolve.expand import NONE, Expander, bound_parameters
from dl2c.resolve.fragment import not_executable
from dl2c.resolve.obligations import Obligations
from dl2c.resolve.shape import Shape
from dl2c.resolve.symbols import Node, Symbols, children, free_variables

Arguments = tuple[tree.Term, ...]
Values = dict[str, tree.Term]


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


@dataclass(frozen=True, slots=True)
class _Binding:
    """An annotated definition while it is being bound: `values` are what its parameters stand for."""

    declaration: tree.Declaration
    values: Values
    shape: Shape
    symbols: Symbols


def bind_predicates(
    declared: Sequence[tuple[tree.Declaration, PredicateAnnotation]],
    concluded: Sequence[PredicateAnnotation],
    shape: Shape,
    symbols: Symbols,
) -> tuple[AnnotatedPredicate, ...]:
    """`concluded` annotate what the problem's box and diamond promise.

    Raises `CompileError` with every error in any of them.
    """
    found: list[Diagnostic] = []
    bound: list[AnnotatedPredicate] = []
    bindings = [partial(_bound, declaration, annotation) for declaration, annotation in declared]
    bindings += [partial(_concluded, annotation) for annotation in concluded]
    for binding in bindings:
        try:
            bound.append(binding(shape, symbols))
        except CompileError as problem:
            found += problem.diagnostics
    if found:
        raise CompileError(found)
    return tuple(bound)


def _concluded(annotation: PredicateAnnotation, shape: Shape, symbols: Symbols) -> AnnotatedPredicate:
    """The postcondition as a @safety predicate, or what the diamond reaches as a @progress predicate."""
    safety = annotation.category == "safety"
    formula = shape.postcondition if safety else shape.progress
    if formula is None:
        modality = "`[program]`" if safety else "`<program>`"
        raise CompileError(_nothing_concluded(annotation, modality))
    name = "postcondition" if safety else "progress"
    while name in symbols.declarations:
        name += "_"
    declaration = tree.Declaration("Bool", name, None, formula, span=formula.span)
    binding = _Binding(declaration, {}, shape, symbols)
    found: list[Diagnostic] = []
    parts = (annotation.reward, annotation.penalty, annotation.shape)
    reward, penalty, potential = (_value(part, binding, found) for part in parts)
    if found:
        raise CompileError(found)
    return AnnotatedPredicate(declaration, annotation, formula, reward, penalty, potential, ())


def _nothing_concluded(annotation: PredicateAnnotation, modality: str) -> Diagnostic:
    return error(
        "misplaced-annotation",
        f"the problem has nothing that this `@{annotation.category}` could annotate",
        annotation.span,
        f"there is no {modality}",
        "annotate a `Bool` definition",
    )


def _bound(
    declaration: tree.Declaration, annotation: PredicateAnnotation, shape: Shape, symbols: Symbols
) -> AnnotatedPredicate:
    _check_kind(declaration, annotation)
    arguments = arguments_of(declaration, shape, symbols)
    values = bound_parameters(declaration, arguments)
    binding = _Binding(declaration, values, shape, symbols)
    expander = Expander(symbols)
    body = declaration.body if isinstance(declaration.body, tree.Formula) else tree.Truth(True)
    found: list[Diagnostic] = []
    formula = expander.formula(body, values, NONE)
    parts = (annotation.reward, annotation.penalty, annotation.shape)
    reward, penalty, potential = (_value(p, binding, found) for p in parts)
    due: list[tuple[tree.Formula, ...]] = []
    if shape.written_postcondition is not None:
        due += Obligations(declaration.name, arguments, expander).of(shape.written_postcondition)
    found += expander.found
    found += not_executable((formula, *(f for premises in due for f in premises)))
    if found:
        raise CompileError(found)
    return AnnotatedPredicate(declaration, annotation, formula, reward, penalty, potential, tuple(due))


def _check_kind(declaration: tree.Declaration, annotation: PredicateAnnotation) -> None:
    """A function has a value and no truth: only `shape` says anything about it."""
    if isinstance(declaration.body, tree.Formula):
        return
    given = {
        "reward": annotation.reward,
        "penalty": annotation.penalty,
        "on_success": annotation.on_success,
        "on_failure": annotation.on_failure,
    }
    if wrong := [name for name, value in given.items() if value is not None]:
        raise CompileError(_not_a_predicate(declaration, annotation, wrong[0]))


def _not_a_predicate(
    declaration: tree.Declaration, annotation: PredicateAnnotation, attribute: str
) -> Diagnostic:
    return error(
        "attribute-not-on-function",
        f"`{attribute}` needs a predicate",
        annotation.span,
        f"`{declaration.name}` has a value, but is never true or false",
        f"use `shape` alone, or annotate a condition: `Bool p(...) <-> {declaration.name}(...) <= c;`",
    )


def arguments_of(declaration: tree.Declaration, shape: Shape, symbols: Symbols) -> Arguments:
    """The one argument list that binds the parameters. An argument that no call gives has the span of its
    parameter. Raises `CompileError`.
    """
    places: list[tuple[tree.Formula, ...]] = [
        tuple(f for f in (shape.written_postcondition, shape.written_progress) if f is not None),
        shape.loop.invariants if shape.loop else (),
        shape.written_assumptions,
    ]
    for formulas in places:
        if formulas is places[1]:
            _check_invariants(formulas, symbols)
        calls = list(dict.fromkeys(c for f in formulas for c in _calls(f, declaration.name, {}, symbols)))
        if len(calls) > 1:
            raise CompileError(_ambiguous(declaration, calls))
        if calls:
            if found := [d for argument in calls[0] for d in check(argument, symbols, frozenset())]:
                raise CompileError(found)
            return calls[0]
    return _namesakes(declaration, symbols)


def _check_invariants(formulas: tuple[tree.Formula, ...], symbols: Symbols) -> None:
    """Invariants are not executed; they are looked at only where they bind parameters."""
    found = [d for f in formulas for d in check(f, symbols, IN_HINTS)]
    if found:
        raise CompileError(found)


def _calls(node: Node, name: str, values: Values, symbols: Symbols) -> Iterator[Arguments]:
    """Argument lists of the calls of a definition, also inside other definitions, but about one state: none
    with a variable that a quantifier binds."""
    if isinstance(node, (tree.PredOf, tree.FuncOf)):
        definition = symbols.declarations.get(node.name)
        if definition is not None and definition.body is not None:
            expander = Expander(symbols)
            actual = tuple(expander.term(a, values, NONE) for a in node.args)
            if node.name == name:
                yield actual
                return
            yield from _calls(definition.body, name, bound_parameters(definition, actual), symbols)
    bound = {node.variable} if isinstance(node, tree.Quantified) else set[str]()
    values = {parameter: v for parameter, v in values.items() if parameter not in bound}
    for child in children(node):
        for arguments in _calls(child, name, values, symbols):
            if bound.isdisjoint(n for a in arguments for n in free_variables(a)):
                yield arguments


def _ambiguous(declaration: tree.Declaration, calls: Sequence[Arguments]) -> Diagnostic:
    lists = tuple(f"{declaration.name}({', '.join(print_term(a) for a in args)})" for args in calls)
    return error(
        "ambiguous-arguments",
        f"`{declaration.name}` is called with different arguments",
        declaration.span,
        "an annotated definition stands for one condition",
        "define one for each, and annotate them separately",
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
        "not a variable or constant, and the problem does not call the definition",
        f"call `{declaration.name}` in the postcondition or @invariant, or rename the parameter",
    )


@dataclass(frozen=True, slots=True)
class _Use:
    """A formula used as a value, and what parameters stand for in it."""

    formula: tree.Formula
    values: Values


def _value(
    expression: tree.Term | tree.Formula | None, binding: _Binding, errors: list[Diagnostic]
) -> ValueTerm | None:
    """A reward expression with predicates taken out and definitions expanded; None where it has `errors`."""
    if expression is None:
        return None
    symbols = binding.symbols
    uses: dict[str, _Use] = {}
    term = _without_predicates(expression, uses, binding)
    found = [*check(term, symbols, frozenset({*binding.values, *uses}))]
    found += [d for u in uses.values() for d in check(u.formula, symbols, frozenset(u.values))]
    if found:
        errors += found
        return None
    expander = Expander(symbols)
    own: Values = {name: tree.Variable(name) for name in uses}
    expanded = expander.term(term, {**binding.values, **own}, NONE)
    formulas = {name: expander.formula(u.formula, u.values, NONE) for name, u in uses.items()}
    errors += expander.found
    errors += not_executable((expanded, *formulas.values()))
    return ValueTerm(expanded, formulas)


def _without_predicates(
    expression: tree.Term | tree.Formula, uses: dict[str, _Use], binding: _Binding
) -> tree.Term:
    """The expression with each predicate replaced by a fresh variable that `uses` explains."""
    roles = binding.symbols.roles
    match expression:
        case tree.Variable(name) if roles.get(name) == "predicate" and name not in binding.values:
            return _bare(expression, uses, binding)
        case tree.FuncOf(name, args) if roles.get(name) == "predicate":
            return _fresh(tree.PredOf(name, args, span=expression.span), binding.values, uses)
        case tree.FuncOf(name, args):
            return tree.FuncOf(
                name, tuple(_without_predicates(a, uses, binding) for a in args), span=expression.span
            )
        case tree.Neg(child):
            return tree.Neg(_without_predicates(child, uses, binding), span=expression.span)
        case tree.BinaryTerm():
            left = _without_predicates(expression.left, uses, binding)
            right = _without_predicates(expression.right, uses, binding)
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
            return _fresh(expression, binding.values, uses)


def _bare(name: tree.Variable, uses: dict[str, _Use], binding: _Binding) -> tree.Term:
    """A predicate's name without arguments: the condition that an annotation of it stands for."""
    declaration = binding.symbols.declarations[name.name]
    values = binding.values
    if declaration.name != binding.declaration.name:
        values = bound_parameters(declaration, arguments_of(declaration, binding.shape, binding.symbols))
    own = tuple(tree.Variable(p.name, span=name.span) for p in declaration.parameters or ())
    return _fresh(tree.PredOf(name.name, own, span=name.span), values, uses)


def _fresh(formula: tree.Formula, values: Values, uses: dict[str, _Use]) -> tree.Term:
    name = f"delta {len(uses)}"
    uses[name] = _Use(formula, values)
    return tree.Variable(name, span=formula.span)
