"""Monitors that KeYmaera X's tests expect, beside those of the same source models.

Names of the state after are `xpost` there, and `xpost_0` for a value chosen freely, which is the same one.
"""

import json
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from oracles.exact_truth import exact_formula, exact_term

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjunction, conjuncts, delta, disjunction, mapped, substituted, symbols
from dl2c.ir.model import ZERO, Add, Compare, Formula, Model, Or, Symbol
from dl2c.monitor.check import Tolerance, after
from dl2c.monitor.control import case_of, control_paths
from dl2c.monitor.plant import model_check
from dl2c.options import Options
from dl2c.pipeline import Compilation
from dl2c.smt.query import Impossible, Oracle
from dl2c.source import Source

ROOTS = ("LS-Lab__KeYmaeraX-release", "LS-Lab__KeYmaeraX-release@history", "LS-Lab__KeYmaeraX-projects")


@dataclass(frozen=True, slots=True)
class Expectation:
    """An expected monitor in dL, and the entry of a file that it is of."""

    test: str
    path: Path
    entry: str | None
    text: str

    @property
    def whole(self) -> bool:
        """Whether it is of a whole step, not of its control alone."""
        return "model monitor" in self.test


ELSEWHERE = {
    "work using the command line interface": "/examples/casestudies/modelplex/watertank/watertank.key"
}
"""Sources that the data does not name: it is the file whose other expectations are the same text."""

WITHOUT_SOURCE = {
    "chase away a loop by updateCalculus implicationally": "its model is in the test itself",
    "find euler model monitor condition": "it approximates motion by Euler steps of a size that is found",
    "find euler model monitor condition for systems": "the same for two variables",
    "derive controller monitor for velocity car safety": "its file is not in the corpus",
    "refuse to apply forall simplification when right-hand side is bound": "it simplifies a formula",
}
"""Expectations that there is no model for, and why."""


def expectations(shared: Path) -> Iterator[Expectation]:
    """Every monitor whose source model is in the corpus."""
    for one in listed(shared):
        sources = one["source"] or [s for s in (ELSEWHERE.get(one["test"]),) if s is not None]
        found = [p for s in sources for p in _files(shared / "corpus", s)]
        if found:
            for text in one["expected"]:
                yield Expectation(one["test"], found[-1], next(iter(one["entry"]), None), text)


def listed(shared: Path) -> list[dict[str, Any]]:
    """What KeYmaera X's tests expect, as it was collected."""
    text = (shared / "oracle" / "modelplex_monitors.json").read_text(encoding="utf-8")
    found: list[dict[str, Any]] = json.loads(text)
    return found


def _files(corpus: Path, source: str) -> list[Path]:
    tail = source.removeprefix("/keymaerax-projects")
    hits = [p for r in ROOTS for p in (corpus / r).rglob(Path(tail).name) if p.as_posix().endswith(tail)]
    return hits[:1]


def verdict(expected: Expectation, seconds: float = 5.0, samples: int = 3000) -> str:
    """`equivalent` as proved, `agree` on so many states where Z3 gives up, `different`, `undecided`; or why
    there is none.
    """
    try:
        model = Compilation(Source.read(expected.path), Options(entry=expected.entry)).unbounded
    except CompileError as refused:
        return f"no model: {refused.diagnostics[0].title}"
    names = {v.name for v in model.variables}
    plain = _plain(expected.text)
    shown = frozenset(n for n in names if re.search(rf"\b{n}post(_0)?\b", plain))
    try:
        theirs, ours = _theirs(plain, model, shown), _ours(model, shown, expected.whole)
    except CompileError as refused:
        return f"no monitor: {refused.diagnostics[0].title}"
    oracle = Oracle(seconds, 2 * seconds)
    answers = {
        oracle.exists([theirs], [Impossible((), ours)]).verdict,
        oracle.exists([ours], [Impossible((), theirs)]).verdict,
    }
    if "unknown" in answers and "yes" not in answers:
        return _sampled(theirs, ours, samples, random.Random(1))
    return "different" if "yes" in answers else "equivalent"


def _sampled(theirs: Formula, ours: Formula, samples: int, rng: random.Random) -> str:
    """`agree` or `different` on exact states around those that a case of ours explains; `undecided`
    where too few satisfy either.
    """
    used = sorted(symbols(theirs, ours), key=lambda s: (s.kind, s.name))
    said, meant = exact_formula(theirs, used), exact_formula(ours, used)
    cases = [_solved(case, used) for case in (ours.children if isinstance(ours, Or) else (ours,))]
    satisfied = 0
    for _ in range(samples):
        row = [(rng.randint(-6, 6), 2) for _ in used]
        row = [
            (abs(n) or d, d) if s.kind == "constant" else (n, d) for s, (n, d) in zip(used, row, strict=True)
        ]
        for k, right in rng.choice(cases):
            if isinstance(value := right(row), tuple):
                row[k] = Fraction(*value).as_integer_ratio()
        if rng.random() < 0.5:
            row[rng.randrange(len(row))] = rng.choice(row)
        found = said(row)
        if found != meant(row):
            return "different"
        satisfied += found
    return "agree" if satisfied >= samples / 100 else "undecided"


def _solved(case: Formula, used: list[Symbol]) -> list[tuple[int, Any]]:
    """What a case says that a value is equal to, those that depend on no state after first."""
    parts = sorted(conjuncts(case), key=lambda c: any(s.kind == "input" for s in symbols(c)))
    return [
        (used.index(part.left), exact_term(part.right, used))
        for part in parts
        if isinstance(part, Compare) and part.op == "=" and isinstance(part.left, Symbol)
    ]


def equal_metric(formula: str, metric: str, seconds: float = 5.0) -> bool:
    """Whether our distance of a formula is KeYmaera X's, which it compares with 0, with the other sign."""
    ours, theirs = (_read(re.sub(r"\b(\w+)\([^()]*(\(\)[^()]*)*\)", _constant, t)) for t in (formula, metric))
    distance = delta(ours)
    assert distance is not None and isinstance(theirs, Compare) and theirs.right == ZERO
    different = Compare("!=", Add(distance, theirs.left), ZERO)
    return Oracle(seconds, seconds).exists([different]).verdict == "no"


def _constant(found: re.Match[str]) -> str:
    """A name for a function of no variable; min and max stay."""
    return found[0] if found[1] in ("min", "max") else found[1]


def _plain(text: str) -> str:
    """The formula with constants for functions, and what tests of a program say as conjunctions."""
    text = text.removeprefix("==> ").replace("\\\\", "\\").replace("()", "")
    text = re.sub(r"(\w+post)_0\b", r"\1", text)
    if text.startswith("<?"):
        text = text.replace("<?", "(").replace(";>", ")&")
    return text


def _theirs(text: str, model: Model, shown: frozenset[str]) -> Formula:
    """The expected formula, read as a precondition over variables of all its names."""
    read = _read(text)
    words = _words(text)
    constants = {c.name for c in model.constants}
    renamed = {Symbol(f"{x}post", k): after(x) for x in shown for k in ("variable", "constant")}
    renamed |= {
        Symbol(w, k): Symbol(w, "constant" if w in constants else "variable")
        for w in words
        for k in ("variable", "constant")
        if Symbol(w, k) not in renamed
    }
    return mapped(read, lambda term: substituted(term, renamed))


def _read(text: str) -> Formula:
    """The formula over variables of all its names."""
    declared = "".join(f"Real {w}; " for w in sorted(_words(text) | {"zz"}))
    entry = (
        f'ArchiveEntry "m"\nProgramVariables {declared}End.\nProblem ({text}) -> [zz := 0;]true End.\nEnd.\n'
    )
    options = Options(default_bound=(Fraction(-1), Fraction(1)))
    return Compilation(Source("expected", entry), options).unbounded.precondition


def _words(text: str) -> set[str]:
    return set(re.findall(r"(?<![\\\w])[A-Za-z]\w*", text)) - {"true", "false", "abs", "min", "max"}


def _ours(model: Model, shown: frozenset[str], whole: bool) -> Formula:
    """The monitor of the model for the variables that the expected one speaks of; others stay as they are."""
    unchanged = {after(v.name): Symbol(v.name, "variable") for v in model.variables if v.name not in shown}
    exact = Tolerance(Fraction(0))
    if whole:
        cases = model_check(model, exact).cases
    else:
        cases = tuple(case_of(model, control, exact) for control in control_paths(model, shown))
    return disjunction(
        conjunction(
            mapped(c.formula, lambda term: substituted(term, unchanged))
            for c in case.conditions
            if not (isinstance(c.formula, Compare) and c.formula.left in unchanged)
        )
        for case in cases
    )
