"""Declarations of names that a model uses without declaring them, as KeYmaera X infers them.

Comes in: a parsed entry. Goes out: the entry with a declaration for every such name, and which they
are. What the program writes is a variable. What it only reads is a constant, in an entry that
declares no variables at all; in others a name that nothing declares is more likely to be a mistake.
Universal quantifiers around the program declare their names too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from dl2c.diagnostics import Diagnostic
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.resolve.shape import conjuncts, implications
from dl2c.resolve.symbols import Node, children, collect, is_hole, mentioned, nodes, own_names


@dataclass(frozen=True, slots=True)
class Inferred:
    """Names without declaration, with declarations whose spans are where they are first used."""

    variables: tuple[tree.Declaration, ...]
    constants: tuple[tree.Declaration, ...]

    def warnings(self) -> tuple[Diagnostic, ...]:
        """One for all names, at the first."""
        if not self.variables and not self.constants:
            return ()
        variables, constants = ([d.name for d in found] for found in (self.variables, self.constants))
        first = min((*self.variables, *self.constants), key=lambda d: d.span.start)
        return (errors.inferred(variables, constants, first.span),)


def inferred(entry: tree.Entry) -> Inferred:
    """What is not declared, and what it must be."""
    symbols, _ = collect(entry)
    written: dict[str, tree.Declaration] = {}
    read: dict[str, tree.Declaration] = {}
    for body, local in _bodies(entry):
        for name, node in _uses(body, local):
            if name not in symbols.roles and not symbols.is_builtin(name, 0):
                kept = written if isinstance(node, (tree.Assign, tree.AssignAny, tree.AtomicODE)) else read
                kept.setdefault(name, tree.Declaration("Real", name, None, None, span=node.span))
    constants = [] if entry.variables else [d for name, d in read.items() if name not in written]
    return Inferred(tuple(written.values()), tuple(constants))


def with_inferred(entry: tree.Entry) -> tuple[tree.Entry, Inferred]:
    """The entry with everything declared that can be inferred, and the problem without the universal
    quantifiers around its program: for all values of a name that nothing writes is for all constants.
    """
    problem, quantified = _opened(entry, entry.problem, frozenset())
    entry = replace(entry, problem=problem)
    found = inferred(entry)
    known = {d.name for d in (*entry.definitions, *entry.variables, *found.variables, *found.constants)}
    constants = (d for name, d in quantified.items() if name not in known)
    complete = replace(
        entry,
        variables=(*entry.variables, *found.variables),
        definitions=(*entry.definitions, *found.constants, *constants),
    )
    names = frozenset(quantified)
    return complete, Inferred(_others(found.variables, names), _others(found.constants, names))


def _others(found: tuple[tree.Declaration, ...], names: frozenset[str]) -> tuple[tree.Declaration, ...]:
    return tuple(d for d in found if d.name not in names)


def _opened(
    entry: tree.Entry, formula: tree.Formula, outside: frozenset[str]
) -> tuple[tree.Formula, dict[str, tree.Declaration]]:
    """`P -> \\forall x F` as `P -> F`, and what the quantifiers declare; `outside` are the names that the
    formula is read beside. A quantifier whose name means something outside it stays.
    """
    match formula:
        case tree.Imply(left, right):
            opened, names = _opened(entry, right, outside | _names(entry, left))
            return (replace(formula, right=opened) if names else formula), names
        case tree.Forall(name, child) if name not in outside:
            opened, names = _opened(entry, child, outside)
            if name in names or not _has_program(opened):
                return formula, {}
            return opened, {name: tree.Declaration("Real", name, None, None, span=formula.span), **names}
        case _:
            return formula, {}


def _names(entry: tree.Entry, formula: tree.Formula) -> frozenset[str]:
    """The names of numbers in a formula and in the definitions that it mentions."""
    definitions = {d.name: d for d in entry.definitions if d.body is not None}
    found: set[str] = set()
    open_: list[tuple[tree.Expression, frozenset[str]]] = [(formula, frozenset())]
    while open_:
        node, local = open_.pop()
        found |= {name for name, _ in _uses(node, local)}
        for called in [definitions.pop(name) for name in mentioned(node) if name in definitions]:
            assert called.body is not None
            open_.append((called.body, own_names(called)))
    return frozenset(found)


def _has_program(formula: tree.Formula) -> bool:
    """Whether a formula says what a program does, under nothing but implications."""
    _, conclusion = implications(formula)
    return any(isinstance(part, (tree.Box, tree.Diamond)) for part in conjuncts(conclusion))


def with_implied(entry: tree.Entry) -> tree.Entry:
    """The entry with declarations of what KeYmaera X lets be undeclared or undefined, though nothing can
    run it: programs too, and in an entry without any declaration every name as a variable. A hole as
    definition defines nothing.
    """
    found = inferred(entry)
    bare = not entry.definitions and not entry.variables
    declared = {d.name for d in (*entry.definitions, *entry.variables)}
    programs: dict[str, tree.Declaration] = {}
    for body, _ in _bodies(entry):
        for node in nodes(body):
            if isinstance(node, tree.ProgramConst) and node.name not in declared:
                programs[node.name] = tree.Declaration("HP", node.name, None, None, span=node.span)
    return replace(
        entry,
        definitions=(*map(_without_hole, entry.definitions), *programs.values()),
        variables=(*entry.variables, *found.variables, *(found.constants if bare else ())),
    )


def _without_hole(declaration: tree.Declaration) -> tree.Declaration:
    return replace(declaration, body=None) if is_hole(declaration.body) else declaration


def _bodies(entry: tree.Entry) -> Iterator[tuple[Node, frozenset[str]]]:
    """The problem and all definitions, each with the names that mean something else in it."""
    yield entry.problem, frozenset()
    for declaration in entry.definitions:
        if declaration.body is not None:
            yield declaration.body, own_names(declaration)


def _uses(node: Node, local: frozenset[str]) -> Iterator[tuple[str, Node]]:
    """Every name of a number that is used, with the node that does."""
    match node:
        case tree.Forall(name, child) | tree.Exists(name, child):
            yield from _uses(child, local | {name})
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
        yield from _uses(child, local)
