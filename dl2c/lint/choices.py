"""Lints of choices: what `++` takes up that was meant to be something else."""

from collections.abc import Iterator

from dl2c.diagnostics import Diagnostic, warning
from dl2c.parse import tree
from dl2c.resolve.problem import Problem
from dl2c.resolve.shape import alternatives
from dl2c.resolve.symbols import nodes
from dl2c.source import Span


def flattened(problem: Problem) -> Iterator[Diagnostic]:
    """`if-in-choice`: both branches of an `if` become alternatives beside others."""
    seen: set[Span] = set()
    for node in nodes(problem.expanded):
        if not isinstance(node, tree.Choice):
            continue
        for side in (node.left, node.right):
            if _is_if(side) and side.span not in seen:
                seen.add(side.span)
                yield _flattened(side, len(alternatives(node)))


def _is_if(program: tree.Program) -> bool:
    """Whether it is written with `if`: its first branch then has the text of the whole."""
    match program:
        case tree.Choice(tree.Compose(tree.Test()) as first):
            return first.span.text.startswith("if")
        case _:
            return False


def _flattened(branches: tree.Program, count: int) -> Diagnostic:
    return warning(
        "if-in-choice",
        f"an `if` beside `++` makes a choice of {count} alternatives",
        branches.span,
        "`++` binds less than `if`, so each branch is an alternative with its test",
        "put the other alternatives into the branches, `if (P) { a ++ c } else { b ++ c }`, or write the "
        "alternatives out: `{ ?P; a ++ ?!P; b ++ c }`",
    )
