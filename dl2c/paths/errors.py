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


def too_long(count: int, span: Span) -> Diagnostic:
    return error(
        "too-large",
        f"a control path of the step has more than {count} statements",
        span,
        "the path gets here",
        "loops inside loops multiply: give `max_repeat` a smaller value, or split the step by a flow",
    )


def too_long_paths(count: int, span: Span) -> Diagnostic:
    return error(
        "too-large",
        f"the control paths of the step have more than {count:,} statements",
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


def disjunctive_test(variable: str, span: Span) -> Diagnostic:
    advice = f"make a choice of it: `{{{variable} := *; ?...; ++ {variable} := *; ?...;}}`"
    return _unresolved(variable, "a disjunction leaves no interval", span, advice)


def joint_test(variables: tuple[str, ...], span: Span) -> Diagnostic:
    names = " and ".join(variables)
    advice = f"test {names} separately, or assign one of them a term"
    return _unresolved(variables[-1], f"it depends on {names} together", span, advice)


def single_value_test(variable: str, op: str, span: Span) -> Diagnostic:
    equal = f"assign the value instead: `{variable} := e;`"
    advice = equal if op == "=" else f"exclude the value on one side: `{variable} > e` or `{variable} < e`"
    return _unresolved(variable, f"`{op}` leaves no interval", span, advice)


def nonlinear_test(variable: str, span: Span) -> Diagnostic:
    advice = f"use comparisons that are linear in {variable}, e.g. `-b <= {variable} & {variable} <= A`"
    return _unresolved(variable, f"it is not linear in {variable}", span, advice)


def _unresolved(variable: str, reason: str, span: Span, advice: str) -> Diagnostic:
    title = f"the values of `{variable} := *` that pass this test cannot be computed"
    return error("unresolved-test", title, span, reason, advice)


def unbounded_input(variable: str, span: Span) -> Diagnostic:
    return error(
        "unbounded-input",
        f"`{variable} := *` has no finite range",
        span,
        "neither a bound nor the tests after it limit the value",
        f"annotate {variable} with `@var: bound=[lo:hi]`, test it: `?-b <= {variable} & {variable} <= A;`, "
        "or give `--default-bound`",
    )
