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


def joint_test(variables: tuple[str, ...], span: Span) -> Diagnostic:
    *earlier, last = dict.fromkeys(variables)
    earlier = earlier or [last]  # one variable may have several inputs
    names = " and ".join(earlier)
    reason = f"for which {names} it leaves a {last} depends on terms of too high a degree in {names}"
    return _unresolved(earlier[-1], reason, span, f"test {names} alone as well, or assign one of them a term")


def many_inputs(variables: tuple[str, ...], span: Span) -> Diagnostic:
    reason = "too many values of the inputs that tests join would have to be tried together"
    return _unresolved(
        variables[-1], reason, span, "join fewer inputs by tests, or assign some of them a term"
    )


def reused_input(variables: tuple[str, ...], span: Span) -> Diagnostic:
    *earlier, last = dict.fromkeys(variables)
    reason = f"{last} may have its value from earlier in the step, before that of {' and '.join(earlier)}"
    return _unresolved(earlier[-1] if earlier else last, reason, span, "decide them in the same place")


def high_degree(variable: str, span: Span) -> Diagnostic:
    advice = (
        f"use polynomials in {variable} of degree 2, e.g. `{variable}^2 <= x`, or 12 in a test of it alone"
    )
    label = f"it is not a polynomial in {variable}, or of too high a degree"
    return _unresolved(variable, label, span, advice)


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
