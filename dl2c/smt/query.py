"""Questions about formulas of the IR, with limits of time.

Formulas over the reals come in; whether some state satisfies them all, and which, goes out.
Where Z3 gives up, or a formula is outside its arithmetic, the answer is "unknown": who asks must
be content with it. What is left out of a question can only make it easier to satisfy.
"""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeAlias

from dl2c.ir.logic import negation, subterms
from dl2c.ir.model import Call, Formula, Symbol
from dl2c.smt.terms import (
    Expression,
    TooLarge,
    Untranslatable,
    answer_of,
    condition,
    solution_of,
    solver_of,
    z3,
)

Verdict: TypeAlias = Literal["yes", "no", "unknown"]


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether a state exists; with "yes" its values, exact or, of irrational ones, decimal text."""

    verdict: Verdict
    witness: Mapping[str, Fraction | str]


@dataclass(frozen=True, slots=True)
class Impossible:
    """The condition that no values of the symbols satisfy a formula."""

    symbols: Sequence[Symbol]
    formula: Formula


UNKNOWN = Answer("unknown", {})


@dataclass(slots=True)
class Oracle:
    """Answers questions, each within `each` seconds and all together within about `total`."""

    each: float = 1.0
    total: float = 30.0
    spent: float = 0.0

    def exists(
        self, formulas: Iterable[Formula], never: Iterable[Impossible] = (), shown: Iterable[str] = ()
    ) -> Answer:
        """Whether some state satisfies all `formulas` and all of `never`; its values of `shown`."""
        seconds = min(self.each, self.total - self.spent)
        if seconds <= 0:
            return UNKNOWN
        begun = time.monotonic()
        try:
            return _decided(tuple(formulas), tuple(never), tuple(shown), seconds)
        finally:
            self.spent += time.monotonic() - begun


def _decided(
    formulas: Sequence[Formula], never: Sequence[Impossible], shown: Sequence[str], seconds: float
) -> Answer:
    context = z3.Context()
    asserted: list[Expression] = []
    complete = True
    for part in (*formulas, *never):
        try:
            absent = isinstance(part, Impossible)
            asserted.append(_impossible(part, context) if absent else condition(part, context))
        except (Untranslatable, TooLarge):
            complete = False
    solver = solver_of(context, asserted, seconds)
    answer = answer_of(solver)
    if answer == z3.unsat:
        return Answer("no", {})
    if answer == z3.unknown or not complete:
        return UNKNOWN
    return Answer("yes", solution_of(solver, shown, context))


def _impossible(part: Impossible, context: Expression) -> Expression:
    """Raises `Untranslatable` for roots under a quantifier, which Z3 is given as further unknowns."""
    roots = [t for t in subterms(part.formula) if isinstance(t, Call) and t.function == "sqrt"]
    if roots and part.symbols:
        raise Untranslatable(roots[0])
    if roots:
        return condition(negation(part.formula), context)
    absent = z3.Not(condition(part.formula, context))
    return z3.ForAll([z3.Real(s.name, context) for s in part.symbols], absent) if part.symbols else absent
