"""Formulas that an entry's tactics name, as candidates for invariants. They prove nothing by themselves."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.parse.parser import parse_formula

_TACTIC = re.compile(r'\bTactic\s+"[^"]*"(.*?)\bEnd\s*\.', re.DOTALL)
_CALL = re.compile(
    r'\b(loop|dC|dI|dbx|barrier|diffCut|diffInvariant|ODEinv|cut|discreteGhost|MR|edit)\s*\(\s*"((?:[^"\\]|\\.)*)"'
)
_OLD_CALL = re.compile(r"\b(loop|dC|diffCut|diffInvariant)\s*\(\s*\{`(.*?)`\}", re.DOTALL)

MOST = 60
"""Formulas taken from one entry."""


@dataclass(frozen=True, slots=True)
class Hints:
    """Candidates for loops and for differential equations, in the order of the text."""

    loops: tuple[tree.Formula, ...]
    flows: tuple[tree.Formula, ...]


def hints_of(entry: tree.Entry, read: Callable[[tree.Formula], tree.Formula | None]) -> Hints:
    """The hints of an entry; `read` expands a formula, or refuses it."""
    loops: dict[tree.Formula, None] = {}
    flows: dict[tree.Formula, None] = {}
    for tactic, text in _calls(entry.span.text):
        for formula in _formulas(text):
            expanded = read(_unchanged(formula))
            if expanded is not None and len(loops) + len(flows) < MOST:
                (loops if tactic == "loop" else flows).setdefault(expanded)
    return Hints(tuple(loops), tuple(flows))


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


def _formulas(text: str) -> Iterator[tree.Formula]:
    """What a tactic's argument says; a list of cuts `a :: b :: nil` is several."""
    for part in text.split("::"):
        try:
            yield parse_formula(part.strip())
        except (CompileError, RecursionError):
            continue
