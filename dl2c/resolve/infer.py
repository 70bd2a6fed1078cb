"""Declarations of names that a model uses without declaring them, as KeYmaera X infers them.

Comes in: a parsed entry. Goes out: the entry with a declaration for every such name, and which they
are. What the program writes is a variable. What it only reads is a constant, in an entry that
declares no variables at all; in others a name that nothing declares is more likely to be a mistake.
Quantifiers around the program declare their names too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from dl2c.diagnostics import Diagnostic
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.resolve.quantified import without_quantifiers
from dl2c.resolve.symbols import Node, collect, is_hole, nodes, own_names, uses


@dataclass(frozen=True, slots=True)
class Inferred:
    """Names without declaration, with declarations whose spans are where they are first used; `existential`
    are those of existential quantifiers around the program.
    """

    variables: tuple[tree.Declaration, ...]
    constants: tuple[tree.Declaration, ...]
    existential: tuple[tree.Declaration, ...] = ()

    def warnings(self) -> tuple[Diagnostic, ...]:
        """One for all names, at the first; one for all that stand for some value."""
        found: list[Diagnostic] = []
        if self.variables or self.constants:
            variables, constants = ([d.name for d in names] for names in (self.variables, self.constants))
            first = min((*self.variables, *self.constants), key=lambda d: d.span.start)
            found.append(errors.inferred(variables, constants, first.span))
        if self.existential:
            found.append(errors.existential([d.name for d in self.existential], self.existential[0].span))
        return tuple(found)


def inferred(entry: tree.Entry) -> Inferred:
    """What is not declared, and what it must be."""
    symbols, _ = collect(entry)
    written: dict[str, tree.Declaration] = {}
    read: dict[str, tree.Declaration] = {}
    for body, local in _bodies(entry):
        for name, node in uses(body, local):
            if name not in symbols.roles and not symbols.is_builtin(name, 0):
                kept = written if isinstance(node, (tree.Assign, tree.AssignAny, tree.AtomicODE)) else read
                kept.setdefault(name, tree.Declaration("Real", name, None, None, span=node.span))
    constants = [] if entry.variables else [d for name, d in read.items() if name not in written]
    return Inferred(tuple(written.values()), tuple(constants))


def with_inferred(entry: tree.Entry) -> tuple[tree.Entry, Inferred]:
    """The entry with everything declared that can be inferred, and the problem without the quantifiers
    around its program: their names are constants where nothing writes them.
    """
    opened = without_quantifiers(entry)
    quantified = {d.name: d for d in opened.declared}
    entry = replace(entry, problem=opened.problem)
    found = inferred(entry)
    known = {d.name for d in (*entry.definitions, *entry.variables, *found.variables, *found.constants)}
    constants = (d for name, d in quantified.items() if name not in known)
    complete = replace(
        entry,
        variables=(*entry.variables, *found.variables),
        definitions=(*entry.definitions, *found.constants, *constants),
    )
    names = frozenset(quantified)
    return complete, Inferred(
        _others(found.variables, names), _others(found.constants, names), opened.existential
    )


def _others(found: tuple[tree.Declaration, ...], names: frozenset[str]) -> tuple[tree.Declaration, ...]:
    return tuple(d for d in found if d.name not in names)


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
