"""Check that every name in a model is used as what it is declared to be.

Comes in: the symbols of an entry and its expressions as written. Goes out: the list of
errors; an empty one means that `expand` cannot meet an unknown name, a wrong sort or a
wrong number of arguments.
"""

from collections.abc import Iterator
from typing import assert_never

from dl2c.diagnostics import Diagnostic
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.resolve.symbols import BUILTINS, HOLES, Node, Symbols, children, nodes, own_names
from dl2c.source import Span

IN_HINTS = frozenset({"old()"})
"""What invariants may use, and definitions that only they call."""


def check_entry(entry: tree.Entry, symbols: Symbols) -> list[Diagnostic]:
    """Errors in all definitions and in the problem."""
    found: list[Diagnostic] = []
    for declaration in entry.definitions:
        local = own_names(declaration) | IN_HINTS
        found += _parameters(declaration) if declaration.body is not None else ()
        found += [d for part in _meaning(declaration) for d in check(part, symbols, local)]
    return list(_once([*found, *check(entry.problem, symbols, frozenset())]))


def _once(found: list[Diagnostic]) -> Iterator[Diagnostic]:
    """Each name that is not declared once, at its first use, with the places of the others."""
    places: dict[tuple[str, str], list[Span]] = {}
    for d in found:
        if d.code.startswith("undeclared-"):
            places.setdefault((d.code, d.label), []).append(d.span)
    for d in found:
        spans = sorted(places.get((d.code, d.label), [d.span]), key=lambda span: span.start)
        if d.span == spans[0]:
            yield errors.also_at(d, spans[1:])


def _meaning(declaration: tree.Declaration) -> list[Node]:
    """What a definition says: its body; of an implicit one the values and rates."""
    if not declaration.implicit:
        return [] if declaration.body is None else [declaration.body]
    return [n.term for n in nodes(declaration.body) if isinstance(n, (tree.Assign, tree.AtomicODE))]


def _parameters(declaration: tree.Declaration) -> Iterator[Diagnostic]:
    first: dict[str, tree.Parameter] = {}
    for parameter in declaration.parameters or ():
        if parameter.name in first:
            yield errors.duplicate(parameter.name, parameter.span, first[parameter.name].span)
        first.setdefault(parameter.name, parameter)


def check(node: Node, symbols: Symbols, local: frozenset[str]) -> Iterator[Diagnostic]:
    """Errors in one expression.

    `local` are parameters and quantified variables in scope, and as `f()` functions that need no
    declaration there.
    """
    match node:
        case (
            tree.UnitFunctional(name)
            | tree.UnitPredicational(name)
            | tree.ProgramConst(name)
            | tree.DifferentialProgramConst(name)
        ) if name in HOLES and name not in symbols.roles:
            yield errors.hole(node.span, HOLES[name])
        case tree.Variable(name):
            yield from _name(name, node, symbols, local)
        case tree.FuncOf(name, args):
            yield from _call(name, args, node, symbols, local, "function")
        case tree.PredOf(name, args):
            yield from _call(name, args, node, symbols, local, "predicate")
        case tree.Quantified(name, child):
            yield from check(child, symbols, local | {name})
            return
        case tree.Assign(name, _) | tree.AssignAny(name) | tree.AtomicODE(name, _):
            yield from _written(name, node, symbols, local)
        case tree.ProgramConst(name):
            if symbols.roles.get(name) != "program":
                yield _not_a_program(name, node, symbols)
        case tree.ODESystem(equations):
            yield from _equations(equations)
        case tree.DifferentialProgramConst(name, None):
            yield from _equation_call(name, node, symbols)
        case _:
            pass
    for child in children(node):
        yield from check(child, symbols, local)


def _name(name: str, node: tree.Variable, symbols: Symbols, local: frozenset[str]) -> Iterator[Diagnostic]:
    role = symbols.roles.get(name)
    if name in local or role in ("variable", "constant") or symbols.is_builtin(name, 0):
        return
    match role:
        case None:
            known = (*symbols.named("variable", "constant", "function"), *local)
            yield errors.undeclared("variable", name, node.span, known, "ProgramVariables or Definitions")
        case "function":
            wanted = len(symbols.declarations[name].parameters or ())
            if wanted:
                yield errors.wrong_arity(name, wanted, 0, node.span)
        case "predicate" | "program":
            yield errors.wrong_sort(name, role, "term", node.span)
        case _:
            assert_never(role)


def _call(
    name: str,
    args: tuple[tree.Term, ...],
    node: tree.FuncOf | tree.PredOf,
    symbols: Symbols,
    local: frozenset[str],
    wanted: str,
) -> Iterator[Diagnostic]:
    role = symbols.roles.get(name)
    if role is None and f"{name}()" in local:
        return
    if wanted == "function" and (symbols.is_builtin(name, len(args)) or (role == "constant" and not args)):
        return
    if role is None and name in BUILTINS and wanted == "function":
        yield errors.wrong_arity(name, BUILTINS[name], len(args), node.span)
    elif role is None:
        known = (
            *symbols.named("function", "predicate"),
            *(BUILTINS if wanted == "function" else ("true", "false")),
        )
        yield errors.undeclared(wanted, name, node.span, known, "Definitions")
    elif role != wanted:
        yield errors.wrong_sort(name, role, "formula" if wanted == "predicate" else "function", node.span)
    elif len(args) != (arity := len(symbols.declarations[name].parameters or ())):
        yield errors.wrong_arity(name, arity, len(args), node.span)


def _written(
    name: str, node: tree.Assign | tree.AssignAny | tree.AtomicODE, symbols: Symbols, local: frozenset[str]
) -> Iterator[Diagnostic]:
    role = symbols.roles.get(name)
    if role is None and name in local:
        return
    if role is None:
        yield errors.undeclared("variable", name, node.span, symbols.named("variable"), "ProgramVariables")
    elif role == "constant":
        yield errors.constant_written(name, node.span)
    elif role != "variable":
        yield errors.wrong_sort(name, role, "program variable", node.span)


def _not_a_program(name: str, node: tree.ProgramConst, symbols: Symbols) -> Diagnostic:
    role = symbols.roles.get(name)
    if role is not None:
        return errors.wrong_sort(name, role, "program", node.span)
    return errors.undefined_program(name, node.span, symbols.named("program"))


def _equations(equations: tuple[tree.AtomicODE | tree.DifferentialProgramConst, ...]) -> Iterator[Diagnostic]:
    first: dict[str, tree.AtomicODE] = {}
    for equation in equations:
        if isinstance(equation, tree.AtomicODE):
            if equation.name in first:
                yield errors.duplicate(f"{equation.name}'", equation.span, first[equation.name].span)
            first.setdefault(equation.name, equation)


def _equation_call(name: str, node: tree.DifferentialProgramConst, symbols: Symbols) -> Iterator[Diagnostic]:
    if symbols.roles.get(name) == "program":
        yield errors.program_as_equation(name, node.span)
    else:
        yield errors.undefined_equation(name, node.span, symbols.named("program"))
