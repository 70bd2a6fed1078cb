"""Models with one mistake each, made from models without: what a prover must not go on proving.

Not every mutant is false: a guard may be stricter than it has to be. What a mutant is labelled with is where
the mistake is: a `guard`, a `sign`, a `constant`, the `strictness` of a comparison, a `domain`, a `missing
assignment`, or a `weaker P`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from fractions import Fraction
from functools import reduce
from random import Random
from typing import Any

from dl2c.parse import tree
from dl2c.parse.printer import print_entry
from dl2c.resolve.symbols import mentioned

KINDS = ("guard", "sign", "constant", "strictness", "domain", "missing assignment", "weaker P")

OTHER: dict[str, tree.Comparison] = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
TRUE = tree.Truth(True)
HINTS = {"invariants", "annotations", "span", "dual"}
"""Fields that are no part of what is proved, or no nodes."""

Change = tuple[str, Any]
"""The kind of a mistake, and the node with it."""


@dataclass(frozen=True)
class Mutant:
    kind: str
    entry: tree.Entry

    @property
    def text(self) -> str:
        """As a file of its own."""
        return print_entry(self.entry)


def mutants(entry: tree.Entry, seed: int, count: int | None = None) -> Iterator[Mutant]:
    """Mutants of an entry, kinds by turns, in an order that the seed decides; all of them without a count."""
    random = Random(f"{seed} {entry.name}")
    plain = replace(entry, program_annotations=())  # their places would no longer be there
    by_kind: dict[str, list[Mutant]] = {kind: [] for kind in KINDS}
    for kind, changed in changed_entries(plain):
        by_kind[kind].append(Mutant(kind, changed))
    for found in by_kind.values():
        random.shuffle(found)
    made = 0
    while any(by_kind.values()):
        for kind in KINDS:
            if by_kind[kind] and (count is None or made < count):
                yield by_kind[kind].pop()
                made += 1
        if count is not None and made >= count:
            return


def changed_entries(entry: tree.Entry) -> Iterator[Change]:
    """All mutants, labelled."""
    for kind, problem in _problem(entry.problem):
        yield kind, replace(entry, problem=problem)
    assumed = only_assumed(entry)
    for place, declaration in enumerate(entry.definitions):
        if declaration.body is None or declaration.implicit:
            continue
        changes: Iterable[Change] = nodes_changed(declaration.body)
        if declaration.name in assumed:
            changes = [*changes, *(("weaker P", weaker) for weaker in without_one(declaration.body))]
        for kind, body in changes:
            changed = replace(declaration, body=body)
            definitions = (*entry.definitions[:place], changed, *entry.definitions[place + 1 :])
            yield kind, replace(entry, definitions=definitions)


def only_assumed(entry: tree.Entry) -> set[str]:
    """Definitions of formulas that nothing but P mentions."""
    problem: Any = entry.problem
    assumed: set[str] = set()
    while isinstance(problem, tree.Imply):
        assumed |= set(mentioned(problem.left))
        problem = problem.right
    others = set(mentioned(problem)) | {n for d in entry.definitions for n in mentioned(d.body)}
    return {d.name for d in entry.definitions if d.sort == "Bool" and d.name in assumed - others}


def _problem(formula: tree.Formula) -> Iterator[Change]:
    """P has mistakes of its own."""
    if not isinstance(formula, tree.Imply):
        yield from nodes_changed(formula)
        return
    for weaker in without_one(formula.left):
        yield "weaker P", replace(formula, left=weaker)
    for kind, left in nodes_changed(formula.left):
        yield kind, replace(formula, left=left)
    for kind, right in _problem(formula.right):
        yield kind, replace(formula, right=right)


def nodes_changed(node: Any) -> Iterator[Change]:
    """The node with one mistake in it, in every way."""
    yield from _here(node)
    if isinstance(node, tree.Power):  # other exponents than whole ones are another matter
        for kind, left in nodes_changed(node.left):
            yield kind, replace(node, left=left)
        return
    for field in fields(node):
        if field.name in HINTS:
            continue
        value = getattr(node, field.name)
        if isinstance(value, tuple):
            for place, part in enumerate(value):
                for kind, changed in nodes_changed(part) if is_dataclass(part) else ():
                    parts = (*value[:place], changed, *value[place + 1 :])
                    yield kind, replace(node, **{field.name: parts})
        elif is_dataclass(value):
            for kind, changed in nodes_changed(value):
                yield kind, replace(node, **{field.name: changed})


def _here(node: Any) -> Iterator[Change]:
    """The mistakes at the top of a node."""
    match node:
        case tree.Test(formula) if formula != TRUE:
            yield "guard", replace(node, formula=tree.Not(formula))
            yield from (("guard", replace(node, formula=weaker)) for weaker in without_one(formula))
        case tree.ODESystem(domain=domain) if domain != TRUE:
            yield from (("domain", replace(node, domain=weaker)) for weaker in without_one(domain))
        case tree.Assign() | tree.AssignAny():
            yield "missing assignment", tree.Test(TRUE)
        case tree.Compare(op) if op in OTHER:
            yield "strictness", replace(node, op=OTHER[op])
        case tree.Plus(left, right):
            yield "sign", tree.Minus(left, right)
        case tree.Minus(left, right):
            yield "sign", tree.Plus(left, right)
        case tree.Neg(child):
            yield "sign", child
        case tree.Power(right=tree.Number(value) as exponent) if value.denominator == 1:
            yield "constant", replace(node, right=replace(exponent, value=value + 1))
        case tree.Number(value):
            for other in sorted({value + 1, 2 * value, value / 2} - {value}):
                yield "constant", replace(node, value=Fraction(other))
        case _:
            return


def without_one(formula: tree.Formula) -> list[tree.Formula]:
    """The formula without one of its conjuncts; `true` for the last one."""
    parts = list(_conjuncts(formula))
    if len(parts) == 1:
        return [] if parts == [TRUE] else [TRUE]
    join: Callable[[Any, Any], tree.Formula] = tree.And
    return [reduce(join, [*parts[:k], *parts[k + 1 :]]) for k in range(len(parts))]


def _conjuncts(formula: tree.Formula) -> Iterator[tree.Formula]:
    if isinstance(formula, tree.And):
        yield from _conjuncts(formula.left)
        yield from _conjuncts(formula.right)
    else:
        yield formula
