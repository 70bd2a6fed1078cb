"""Diagnostics of path enumeration."""

from dl2c.diagnostics import Diagnostic, error
from dl2c.source import Span


def too_many_paths(count: int, span: Span) -> Diagnostic:
    return error(
        "too-many-paths",
        f"the step has more than {count} control paths",
        span,
        "the step begins here",
        "every combination of alternatives is a path: leave out choices that make no difference",
    )


def too_large(variable: str, limit: int, span: Span) -> Diagnostic:
    return error(
        "too-large",
        f"the value of `{variable}` is a term of more than {limit} symbols over the state before the step",
        span,
        "after this assignment",
        "assignments that mention a variable several times multiply: split the step by a flow or the loop",
    )


def unresolved_test(variable: str, reason: str, span: Span) -> Diagnostic:
    return error(
        "unresolved-test",
        f"the values of `{variable} := *` that pass this test cannot be computed",
        span,
        reason,
        f"bound {variable} by comparisons linear in {variable}, e.g. `-b <= {variable} & {variable} <= A`",
    )


def unbounded_input(variable: str, span: Span) -> Diagnostic:
    return error(
        "unbounded-input",
        f"`{variable} := *` has no finite range",
        span,
        "neither a bound nor the tests after it limit the value",
        f"annotate {variable} with `@var: bound=[lo:hi]`, or test it: `?-b <= {variable} & {variable} <= A;`",
    )
