"""The loop's invariant as a formula over states. It is a hint for proofs: a step does not depend on it."""

from dl2c.diagnostics import CompileError
from dl2c.ir.logic import conjunction
from dl2c.ir.model import Formula
from dl2c.lower.problem import scope_of
from dl2c.lower.terms import lower_formula
from dl2c.resolve.bind import IN_HINTS, check
from dl2c.resolve.expand import NONE, Expander
from dl2c.resolve.fragment import not_executable
from dl2c.resolve.problem import Problem


def invariant(problem: Problem) -> Formula | None:
    """The conjunction of the loop's invariants; None where there is none that can be evaluated."""
    if problem.shape.loop is None or not problem.shape.loop.invariants:
        return None
    expander = Expander(problem.symbols)
    found: list[Formula] = []
    for written in problem.shape.loop.invariants:
        if any(check(written, problem.symbols, IN_HINTS)):
            return None
        expanded = expander.formula(written, {}, NONE)
        if expander.found or not_executable((expanded,)):
            return None
        try:
            found.append(lower_formula(expanded, scope_of(problem)))
        except CompileError:
            return None
    return conjunction(found)
