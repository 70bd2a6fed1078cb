"""Formulas that an entry's tactics and comments name, as candidates for invariants, and terms that it names
without using them in its problem, as candidates for Lyapunov functions. They prove nothing by themselves.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from itertools import islice
from typing import Any

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.parse.parser import parse_formula, parse_term
from dl2c.resolve.symbols import free_variables, nodes

_TACTIC = re.compile(r'\bTactic\s+"[^"]*"(.*?)\bEnd\s*\.', re.DOTALL)
_CALL = re.compile(
    r'\b(loop|dC|dI|dbx|barrier|diffCut|diffInvariant|ODEinv|cut|discreteGhost|MR|edit)\s*\(\s*"((?:[^"\\]|\\.)*)"'
)
_ARGUMENT = re.compile(r'\b\w+\s*\(\s*"([^"<>=!&|\[\]{}]*)"')
_COMMENT = re.compile(r"/\*\s*@invariant\s*\(((?:[^*/]|\*(?!/)|/(?!\*))*)\*/")
"""An invariant in a comment, as older files have it."""

_OLD_CALL = re.compile(r"\b(loop|dC|diffCut|diffInvariant)\s*\(\s*\{`(.*?)`\}", re.DOTALL)

MOST = 60
"""Formulas taken from one entry."""

LONGEST = 100_000
"""Characters of tactics, and of a comment, in which terms and formulas are looked for."""


@dataclass(frozen=True, slots=True)
class Hints:
    """Candidates for loops and for differential equations, in the order of the text; `functions` are one for
    all equations of a loop, or one for each.
    """

    loops: tuple[tree.Formula, ...]
    flows: tuple[tree.Formula, ...]
    functions: tuple[tuple[tree.Term, ...], ...] = ()


def hints_of(entry: tree.Entry, read: Callable[[tree.Formula], tree.Formula | None]) -> Hints:
    """The hints of an entry; `read` expands a formula, or refuses it."""
    loops: dict[tree.Formula, None] = {}
    flows: dict[tree.Formula, None] = {}
    names = frozenset(d.name for d in entry.variables)
    named = [(tactic, f) for tactic, text in _calls(entry.span.text) for f in _formulas(text)]
    for tactic, formula in named:
        expanded = read(_unchanged(formula))
        if expanded is not None and len(loops) + len(flows) < MOST:
            (loops if tactic == "loop" else flows).setdefault(expanded)
    for comment in islice(_COMMENT.finditer(entry.span.text), MOST):
        written = islice(_listed(comment.group(1)), MOST - len(loops) - len(flows))
        parts = [p for f in written if (p := read(_begun(f, names))) is not None]
        if not comment.string[: comment.start()].rstrip().endswith("*"):
            flows |= dict.fromkeys(parts)
        elif parts:
            loops.setdefault(reduce(tree.And, parts))
    return Hints(
        tuple(loops), tuple(flows), tuple(dict.fromkeys(_functions(entry, [f for _, f in named], read)))
    )


def _functions(
    entry: tree.Entry, named: Sequence[tree.Formula], read: Callable[[tree.Formula], tree.Formula | None]
) -> Iterator[tuple[tree.Term, ...]]:
    """Arguments of tactics that are terms, alone or in a list, functions that are only defined, and terms
    that the formulas of tactics compare with a variable, such as `x^2+y^2 >= k`.
    """
    unused = tuple(_unused(entry))
    found = [(body,) for body in unused] + [unused] * (len(unused) > 1)
    tactics = "".join(tactic.group(1) for tactic in _TACTIC.finditer(entry.span.text))
    found += map(_terms, dict.fromkeys(_ARGUMENT.findall(tactics[:LONGEST])))
    found += (sides for formula in named for sides in _compared(formula))
    for terms in dict.fromkeys(found[:MOST]):
        known = [read(tree.Compare("=", term, tree.Number(Fraction(0)))) for term in terms]
        if known and all(isinstance(k, tree.Compare) for k in known):
            yield tuple(k.left for k in known if isinstance(k, tree.Compare))


def _compared(formula: tree.Formula) -> Iterator[tuple[tree.Term, ...]]:
    """The terms that inequalities compare with a variable, together and one by one."""
    sides: dict[tree.Term, None] = {}
    for node in nodes(formula):
        match node:
            case tree.Compare("<" | "<=" | ">=" | ">", left, tree.Variable()) if (
                len(free_variables(left)) > 1
            ):
                sides.setdefault(left)
            case _:
                pass
    if sides:
        yield tuple(sides)
        yield from ((side,) for side in sides if len(sides) > 1)


def _unused(entry: tree.Entry) -> Iterator[tree.Term]:
    """The bodies of functions that neither the problem nor another definition mentions."""
    texts = (entry.problem, *(d.body for d in entry.definitions))
    mentioned = {n.name for text in texts for n in nodes(text) if isinstance(n, tree.FuncOf)}
    for d in entry.definitions:
        if d.parameters and isinstance(d.body, tree.Term) and d.name not in mentioned:
            yield d.body


def _terms(text: str) -> tuple[tree.Term, ...]:
    """The terms of a list `a :: b :: nil`; none of other texts."""
    parts = [p for part in text.split("::") if (p := part.strip()) and p != "nil"]
    try:
        return tuple(parse_term(part) for part in parts)
    except (CompileError, RecursionError):
        return ()


def _calls(text: str) -> Iterator[tuple[str, str]]:
    for tactic in _TACTIC.finditer(text):
        for pattern in (_CALL, _OLD_CALL):
            for call in pattern.finditer(tactic.group(1)):
                yield call.group(1), call.group(2).replace('\\"', '"')


def _unchanged(formula: tree.Formula) -> tree.Formula:
    """The formula with `e = const()`, by which tactics say that e keeps its value, as `e = old(e)`."""
    match formula:
        case tree.Connective(left, right):
            return replace(formula, left=_unchanged(left), right=_unchanged(right))
        case tree.Compare(_, left, tree.FuncOf("const", ())):
            return replace(formula, right=tree.FuncOf("old", (left,)))
        case _:
            return formula


def _listed(text: str) -> Iterator[tree.Formula]:
    """The formulas of a list, which ends with its bracket; where a comma is missing those of its lines."""
    inside = text[:LONGEST].rstrip().removesuffix(")")
    depth, begun = 0, 0
    for place, character in enumerate(f"{inside},"):
        depth += (character == "(") - (character == ")")
        if character == "," and not depth:
            part, begun = inside[begun:place], place + 1
            yield from list(_formulas(part)) or (f for line in part.splitlines() for f in _formulas(line))


def _begun(node: Any, names: frozenset[str]) -> Any:
    """A formula with `old(x)` for `x0`, where x is a variable and x0 is none."""
    match node:
        case tree.Variable(name) if name not in names and name.endswith("0") and name[:-1] in names:
            return tree.FuncOf("old", (tree.Variable(name[:-1]),))
        case tree.Connective() | tree.Compare() | tree.BinaryTerm():
            return replace(node, left=_begun(node.left, names), right=_begun(node.right, names))
        case tree.Not() | tree.Neg():
            return replace(node, child=_begun(node.child, names))
        case tree.FuncOf(_, args):
            return replace(node, args=tuple(_begun(a, names) for a in args))
        case _:
            return node


def _formulas(text: str) -> Iterator[tree.Formula]:
    """What a tactic's argument says; a list of cuts `a :: b :: nil` is several."""
    for part in text.split("::"):
        try:
            yield parse_formula(part.strip())
        except (CompileError, RecursionError):
            continue
