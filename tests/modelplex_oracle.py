"""Monitors that KeYmaera X's tests expect, beside those of the same source models.

Names of the state after are `xpost` there, and `xpost_0` for a value chosen freely, which is the same one.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjunction, disjunction, mapped, substituted
from dl2c.ir.model import Compare, Formula, Model, Symbol
from dl2c.monitor.check import Tolerance, after
from dl2c.monitor.control import case_of, control_paths
from dl2c.monitor.plant import model_check
from dl2c.options import Options
from dl2c.pipeline import lowered_model
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


def expectations(shared: Path) -> Iterator[Expectation]:
    """Every monitor whose source model is in the corpus."""
    listed = json.loads((shared / "oracle" / "modelplex_monitors.json").read_text(encoding="utf-8"))
    for one in listed:
        found = [p for s in one["source"] for p in _files(shared / "corpus", s)]
        if found:
            for text in one["expected"]:
                yield Expectation(one["test"], found[-1], next(iter(one["entry"]), None), text)


def _files(corpus: Path, source: str) -> list[Path]:
    tail = source.removeprefix("/keymaerax-projects")
    hits = [p for r in ROOTS for p in (corpus / r).rglob(Path(tail).name) if p.as_posix().endswith(tail)]
    return hits[:1]


def verdict(expected: Expectation, seconds: float = 5.0) -> str:
    """`equivalent`, `different`, `undecided`, or why there is nothing to compare."""
    try:
        model = lowered_model(Source.read(expected.path), Options(entry=expected.entry))
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
    return "different" if "yes" in answers else "undecided" if "unknown" in answers else "equivalent"


def _plain(text: str) -> str:
    """The formula with constants for functions, and what tests of a program say as conjunctions."""
    text = text.removeprefix("==> ").replace("\\\\", "\\").replace("()", "")
    text = re.sub(r"(\w+post)_0\b", r"\1", text)
    if text.startswith("<?"):
        text = text.replace("<?", "(").replace(";>", ")&")
    return text


def _theirs(text: str, model: Model, shown: frozenset[str]) -> Formula:
    """The expected formula, read as a precondition over variables of all its names."""
    words = set(re.findall(r"(?<![\\\w])[A-Za-z]\w*", text)) - {"true", "false", "abs", "min", "max"}
    declared = "".join(f"Real {w}; " for w in sorted(words | {"zz"}))
    entry = (
        f'ArchiveEntry "m"\nProgramVariables {declared}End.\nProblem ({text}) -> [zz := 0;]true End.\nEnd.\n'
    )
    read = lowered_model(Source("expected", entry), Options(default_bound=(Fraction(-1), Fraction(1))))
    constants = {c.name for c in model.constants}
    renamed = {Symbol(f"{x}post", k): after(x) for x in shown for k in ("variable", "constant")}
    renamed |= {
        Symbol(w, k): Symbol(w, "constant" if w in constants else "variable")
        for w in words
        for k in ("variable", "constant")
        if Symbol(w, k) not in renamed
    }
    return mapped(read.precondition, lambda term: substituted(term, renamed))


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
