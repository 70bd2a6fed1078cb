"""Refuse what cannot be executed, naming the construct and its place.

Comes in: an expanded problem. Goes out: nothing, or `CompileError` with one error for
every construct found: uniform-substitution symbols, modalities with loops inside state formulas,
differential symbols, `old(...)`.
"""

from collections.abc import Iterable, Iterator

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.resolve.symbols import Node, children, nodes


def check_executable(problem: tree.Formula) -> None:
    """Raises `CompileError`. Modalities are legal where the problem's shape has them."""
    found = list(dict.fromkeys(_top(problem)))
    if found:
        raise CompileError(found)


def not_executable(parts: Iterable[tree.Formula | tree.Term]) -> list[Diagnostic]:
    """The errors of formulas and terms about one state, such as predicates and rewards."""
    return list(dict.fromkeys(d for part in parts for d in _state(part)))


def _top(formula: tree.Formula) -> Iterator[Diagnostic]:
    """The part of the problem in which modalities may stand."""
    match formula:
        case tree.Imply(left, right):
            yield from _state(left)
            yield from _top(right)
        case tree.And(left, right) if _has_modality(formula):
            yield from _top(left)
            yield from _top(right)
        case tree.Modal(program, child):
            yield from _state(program)
            yield from _top(child) if isinstance(child, type(formula)) else _state(child)
        case tree.Quantified(name, child, span=span) if _runs(child):
            advice = f"give `{name}` a name of its own, or declare it as a constant or a variable"
            yield errors.not_executable("quantifier", "a quantifier around a program", span, advice)
        case _:
            yield from _state(formula)


def _has_modality(node: Node) -> bool:
    return isinstance(node, tree.Modal) or any(
        _has_modality(c) for c in children(node) if isinstance(node, (tree.And, tree.Imply))
    )


def _runs(formula: tree.Formula) -> bool:
    return any(isinstance(n, tree.Modal) for n in nodes(formula))


def _endless(node: Node) -> str:
    """Why a program inside a condition with such a part is not a condition on the state."""
    match node:
        case tree.Loop():
            return "it has a loop"
        case tree.Dual():
            return "it is a game"
        case _:
            return ""


def _state(node: Node) -> Iterator[Diagnostic]:
    """Everything below must be executable."""
    refused = _refused(node)
    if refused is not None:
        yield refused
        return
    for child in children(node):
        yield from _state(child)


def _refused(node: Node) -> Diagnostic | None:
    match node:
        case tree.Modal(program, span=span):
            return next((errors.modality(span, why) for n in nodes(program) if (why := _endless(n))), None)
        case tree.FuncOf("old", (_, *_), span=span):
            advice = "keep the earlier value in a variable of the program"
            return errors.not_executable("old-value", "`old(...)` outside @invariant", span, advice)
        case (
            tree.DifferentialSymbol(span=span)
            | tree.Differential(span=span)
            | tree.DifferentialFormula(span=span)
        ):
            advice = "write the right-hand side of the differential equation instead"
            return errors.not_executable("differential", "a differential outside an ODE", span, advice)
        case tree.Assign(name, _, True, span=span) | tree.AssignAny(name, True, span=span):
            advice = f"rates change by differential equations: `{{{name}' = ...}}`"
            return errors.not_executable("differential", "an assignment to a differential", span, advice)
        case (
            tree.UnitFunctional(span=span)
            | tree.UnitPredicational(span=span)
            | tree.PredicationalOf(span=span)
            | tree.DifferentialProgramConst(span=span)
        ):
            advice = "replace it by what it stands for"
            return errors.not_executable(
                "substitution-symbol", "a symbol of uniform substitution", span, advice
            )
        case _:
            return None
