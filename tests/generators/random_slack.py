"""Random predicates relaxed as lowering relaxes those of models."""

from fractions import Fraction
from typing import Any

from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import And, Compare, Formula, Or, Truth
from dl2c.ir.slack import Slacks, settled


def relaxations(name: str, formula: Formula, tolerance: Fraction) -> dict[str, Any]:
    """The members of `Predicate` that relax it, in a state and along flows."""
    slacks = Slacks(name, tolerance, {})
    along = _relaxed(formula, slacks)
    return {"relaxed": settled(along, slacks.starts), "along": along, "slacks": slacks.starts}


def _relaxed(formula: Formula, slacks: Slacks) -> Formula:
    match formula:
        case Truth():
            return formula
        case Compare():
            return slacks.relaxed(formula)
        case And(children):
            return conjunction(_relaxed(c, slacks) for c in children)
        case Or(children):
            return disjunction(_relaxed(c, slacks) for c in children)
