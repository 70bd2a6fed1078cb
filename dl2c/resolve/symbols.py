"""The names of an entry: what each one is, and whether every use fits.

Comes in: a parsed entry. Goes out: `Symbols`, with every declaration and every body
checked, or all errors found at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias, assert_never

from dl2c.diagnostics import Diagnostic
from dl2c.ir.functions import KYX_MATH
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.work import spend

BUILTINS = {name: arity for name, arity in KYX_MATH.items() if arity}
"""Functions of kyx.math, with their arity; usable with or without import."""

NULLARY_BUILTINS = ("e", "pi")
"""Numbers of kyx.math; ordinary names unless imported."""

HOLES = {
    "exerciseF_": "term",
    "exerciseP_": "formula",
    "exerciseS_": "program",
    "exerciseD_": "differential equation",
}
"""How the holes of exercises are read: as which symbol, standing for what."""

Role: TypeAlias = Literal["variable", "constant", "function", "predicate", "program"]


@dataclass(frozen=True, slots=True)
class Symbols:
    """Every declared name. `imports` are the last parts of imported library names."""

    declarations: dict[str, tree.Declaration]
    roles: dict[str, Role]
    imports: frozenset[str]

    def named(self, *roles: Role) -> tuple[str, ...]:
        return tuple(n for n, r in self.roles.items() if r in roles)

    def is_builtin(self, name: str, arity: int) -> bool:
        """Whether a call means the library function: known, and not defined by the model."""
        declared = self.declarations.get(name)
        if declared is not None and declared.body is not None:
            return False
        imported = name in self.imports or "*" in self.imports
        return BUILTINS.get(name) == arity or (arity == 0 and name in NULLARY_BUILTINS and imported)


def collect(entry: tree.Entry) -> tuple[Symbols, list[Diagnostic]]:
    """All declarations of an entry, and what is wrong with them."""
    declarations: dict[str, tree.Declaration] = {}
    roles: dict[str, Role] = {}
    found: list[Diagnostic] = []
    variables = {d.name for d in entry.variables}
    for declaration in (*entry.definitions, *entry.variables):
        if (first := declarations.get(declaration.name)) is not None:
            found.append(errors.duplicate(declaration.name, declaration.span, first.span))
            continue
        declarations[declaration.name] = declaration
        roles[declaration.name] = "variable" if declaration.name in variables else _role(declaration)
    imports = frozenset(name.rsplit(".", 1)[-1] for name in entry.imports)
    symbols = Symbols(declarations, roles, imports)
    found += _cycles(symbols)
    return symbols, found


def is_hole(node: tree.Expression | None) -> bool:
    """Whether an expression is the hole `__________` of an exercise."""
    return (
        isinstance(node, (tree.UnitFunctional, tree.UnitPredicational, tree.ProgramConst))
        and node.name in HOLES
    )


def _role(declaration: tree.Declaration) -> Role:
    match declaration.sort:
        case "Real" if not declaration.parameters and declaration.body is None:
            return "constant"
        case "Real":
            return "function"
        case "Bool":
            return "predicate"
        case "HP":
            return "program"
        case _:
            assert_never(declaration.sort)


def _cycles(symbols: Symbols) -> list[Diagnostic]:
    """One error for every definition that reaches itself, at the first of the cycle."""
    uses = {
        name: [n for n in mentioned(d.body) if n in symbols.declarations and n not in own_names(d)]
        for name, d in symbols.declarations.items()
        if d.body is not None
    }
    found: list[Diagnostic] = []
    done: set[str] = set()
    for root, used in uses.items():
        trail: list[tuple[str, Iterator[str]]] = [(root, iter(used))] if root not in done else []
        while trail:
            name, rest = trail[-1]
            following = next(rest, None)
            if following is None:
                done.add(name)
                trail.pop()
            elif following in (names := [n for n, _ in trail]):
                cycle = (*names[names.index(following) :], following)
                found.append(errors.recursive_definition(cycle, symbols.declarations[following].span))
                done.update(names)
                break
            elif following in uses and following not in done:
                trail.append((following, iter(uses[following])))
    return found


def own_names(declaration: tree.Declaration) -> frozenset[str]:
    """The names that a body redefines: its parameters, and the variables of an implicit definition."""
    parameters = frozenset(p.name for p in declaration.parameters or ())
    if not declaration.implicit:
        return parameters
    return parameters | {
        n.name for n in nodes(declaration.body) if isinstance(n, (tree.Assign, tree.AtomicODE))
    }


def mentioned(expression: tree.Expression | None) -> Iterator[str]:
    """Every name an expression mentions, in order; bound occurrences too."""
    for node in nodes(expression):
        match node:
            case (
                tree.Variable(name)
                | tree.DifferentialSymbol(name)
                | tree.FuncOf(name)
                | tree.PredOf(name)
                | tree.ProgramConst(name)
                | tree.DifferentialProgramConst(name)
            ):
                yield name
            case _:
                pass


def free_variables(node: "Node") -> frozenset[str]:
    """The names in terms, other than those that quantifiers around them bind. Parts that are shared, as
    arguments of definitions are, are gone through once.
    """
    known: dict[int, frozenset[str]] = {}

    def found(node: "Node") -> frozenset[str]:
        if id(node) in known:
            return known[id(node)]
        spend()
        match node:
            case tree.Variable(name) | tree.DifferentialSymbol(name):
                names = frozenset({name})
            case tree.Quantified(name, child):
                names = found(child) - {name}
            case _:
                names = frozenset[str]().union(*map(found, children(node)))
        known[id(node)] = names
        return names

    return found(node)


def reached_by(declaration: tree.Declaration, symbols: "Symbols") -> frozenset[str]:
    """The program variables that a definition, or what it calls, reads or changes."""
    found: set[str] = set()
    seen: set[str] = set()
    stack = [declaration]
    while stack:
        one = stack.pop()
        if one.name in seen or one.body is None:
            continue
        seen.add(one.name)
        own = own_names(one)
        changed = {
            n.name for n in nodes(one.body) if isinstance(n, (tree.Assign, tree.AssignAny, tree.AtomicODE))
        }
        names = (free_variables(one.body) | changed) - own
        found |= {n for n in names if symbols.roles.get(n) == "variable"}
        stack += [d for n in {*mentioned(one.body)} - own if (d := symbols.declarations.get(n)) is not None]
    return frozenset(found)


Node: TypeAlias = tree.Expression | tree.AtomicODE | tree.DifferentialProgramConst


def nodes(expression: Node | None) -> Iterator[Node]:
    """The expression and everything in it, outermost first, left to right."""
    stack: list[Node] = [] if expression is None else [expression]
    while stack:
        spend()
        node = stack.pop()
        yield node
        stack.extend(reversed(children(node)))


def children(node: Node) -> tuple[Node, ...]:
    """The direct parts of a node; invariants are not part of the program."""
    match node:
        case tree.FuncOf(_, args) | tree.PredOf(_, args):
            return args
        case (
            tree.Neg(child)
            | tree.Differential(child)
            | tree.PredicationalOf(_, child)
            | tree.Not(child)
            | tree.Quantified(_, child)
            | tree.DifferentialFormula(child)
            | tree.Loop(child)
            | tree.Dual(child)
            | tree.Test(child)
            | tree.Assign(_, child)
            | tree.AtomicODE(_, child)
        ):
            return (child,)
        case (
            tree.BinaryTerm(left, right)
            | tree.Compare(_, left, right)
            | tree.Connective(left, right)
            | tree.Compose(left, right)
            | tree.Choice(left, right)
            | tree.Modal(left, right)
        ):
            return (left, right)
        case tree.ODESystem(equations, domain):
            return (*equations, domain)
        case _:
            return ()


def uses(node: Node, local: frozenset[str] = frozenset()) -> Iterator[tuple[str, Node]]:
    """Every name of a number that is used, but for `local` ones, with the node that does."""
    spend()
    match node:
        case tree.Quantified(name, child):
            yield from uses(child, local | {name})
            return
        case tree.Variable(name) | tree.FuncOf(name, ()):
            if name not in local:
                yield name, node
        case tree.Assign(name, _) | tree.AssignAny(name) | tree.AtomicODE(name, _):
            if name not in local:
                yield name, node
        case _:
            pass
    for child in children(node):
        yield from uses(child, local)
