"""Diagnostics of path enumeration."""

from dl2c.diagnostics import Diagnostic, error
from dl2c.source import Span


def too_many_paths(count: int, span: Span) -> Diagnostic:
    return error(
        "too-many-paths",
        f"the step has more than {count} control paths",
        span,
        help="move choices that do not depend on each other into separate steps, or merge them",
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
        f"annotate {variable} with `@var: bound=[lo:hi]`, or test it: `?lo <= {variable} & {variable} <= hi;`",
    )
