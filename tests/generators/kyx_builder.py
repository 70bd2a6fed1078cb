"""Small models as text for tests, and what becomes of them; a meaning of syntax trees to compare with."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.ir.model import Model
from dl2c.lower.problem import lower
from dl2c.parse import tree
from dl2c.parse.parser import parse_archive
from dl2c.paths.enumerate import enumerate_paths
from dl2c.paths.path import Paths
from dl2c.resolve.problem import Problem, resolve
from dl2c.source import Source

# Models -----------------------------------------------------------------------


def model_text(
    problem: str, definitions: str = "", variables: str = "Real x; Real v;", above: str = ""
) -> str:
    """An archive with one entry; `above` stands above its Problem."""
    return (
        f'ArchiveEntry "Model"\nDefinitions\n{definitions}\nEnd.\nProgramVariables\n{variables}\nEnd.\n'
        f"{above}\nProblem\n{problem}\nEnd.\nEnd.\n"
    )


def resolved(*parts: str, **named: str) -> Problem:
    """The problem of a `model_text`."""
    archive, _ = parse_archive(Source("model.kyx", model_text(*parts, **named)))
    return resolve(archive.entries[0])


def lowered(*parts: str, options: Mapping[str, Any] | None = None, **named: str) -> Model:
    """The step model of a `model_text`."""
    return lower(resolved(*parts, **named), resolve_options(options or {}))


def paths_of(*parts: str, options: Mapping[str, Any] | None = None, **named: str) -> Paths:
    """The guarded paths of a `model_text`."""
    return enumerate_paths(lowered(*parts, options=options, **named))


def codes(refused: CompileError) -> list[str]:
    return [d.code for d in refused.diagnostics]


# The meaning of trees ---------------------------------------------------------

Point = Mapping[str, Fraction]
Definitions = Mapping[str, tuple[tuple[str, ...], tree.Expression]]
"""Parameters and body by name."""


def value(term: tree.Term, at: Point, definitions: Definitions) -> Fraction | None:
    """The exact value, a call by evaluating its arguments first; None where undefined."""
    match term:
        case tree.Number(number):
            return number
        case tree.Variable(name) if name not in definitions:
            return at[name]
        case tree.Variable(name):
            return value(tree.FuncOf(name, ()), at, definitions)
        case tree.FuncOf(name, args):
            inner = _arguments(name, args, at, definitions)
            return None if inner is None else value(definitions[name][1], inner, definitions)
        case tree.Neg(child):
            a = value(child, at, definitions)
            return None if a is None else -a
        case (
            tree.Plus(left, right)
            | tree.Minus(left, right)
            | tree.Times(left, right)
            | tree.Divide(left, right)
        ):
            a, b = value(left, at, definitions), value(right, at, definitions)
            if a is None or b is None or (isinstance(term, tree.Divide) and b == 0):
                return None
            match term:
                case tree.Plus():
                    return a + b
                case tree.Minus():
                    return a - b
                case tree.Times():
                    return a * b
            return a / b
    raise AssertionError(term)


def holds(formula: tree.Formula, at: Point, definitions: Definitions, wanted: bool = True) -> bool:
    """Whether the formula is `wanted`: an atom with an undefined subterm is neither true nor false."""
    match formula:
        case tree.Truth(truth):
            return truth == wanted
        case tree.Compare(op, left, right):
            a, b = value(left, at, definitions), value(right, at, definitions)
            if a is None or b is None:
                return False
            truth = {"=": a == b, "!=": a != b, "<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[op]
            return truth == wanted
        case tree.PredOf(name, args):
            inner = _arguments(name, args, at, definitions)
            assert inner is not None, "tests pass defined arguments to predicates"
            return holds(definitions[name][1], inner, definitions, wanted)
        case tree.Not(child):
            return holds(child, at, definitions, not wanted)
        case tree.And(left, right) | tree.Or(left, right):
            both = isinstance(formula, tree.And) == wanted
            sides = [holds(side, at, definitions, wanted) for side in (left, right)]
            return all(sides) if both else any(sides)
        case tree.Imply(left, right):
            return holds(tree.Or(tree.Not(left), right), at, definitions, wanted)
        case tree.Equiv(left, right):
            both_ways = tree.And(tree.Imply(left, right), tree.Imply(right, left))
            return holds(both_ways, at, definitions, wanted)
    raise AssertionError(formula)


def _arguments(
    name: str, args: tuple[tree.Term, ...], at: Point, definitions: Definitions
) -> dict[str, Fraction] | None:
    """The point at which the body of a definition is evaluated."""
    values = [value(a, at, definitions) for a in args]
    if any(v is None for v in values):
        return None
    return {**at, **dict(zip(definitions[name][0], [v for v in values if v is not None], strict=True))}
