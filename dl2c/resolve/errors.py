"""Diagnostics of name resolution and of the executable fragment."""

from collections.abc import Iterable
from difflib import get_close_matches

from dl2c.diagnostics import Diagnostic, error
from dl2c.source import Span


def suggestion(name: str, known: Iterable[str]) -> str:
    """Advice naming the closest known name, or nothing."""
    close = get_close_matches(name, sorted(known), n=1)
    return f"did you mean `{close[0]}`?" if close else ""


def undeclared(kind: str, name: str, span: Span, known: Iterable[str], where: str) -> Diagnostic:
    """`kind` is variable, function, predicate or program."""
    label = f"`{name}` is not declared in {where}"
    return error(f"undeclared-{kind}", f"undeclared {kind}", span, label, suggestion(name, known))


def wrong_sort(name: str, is_a: str, wanted: str, span: Span) -> Diagnostic:
    return error("wrong-sort", f"expected a {wanted}", span, f"`{name}` is a {is_a}")


def wrong_arity(name: str, wanted: int, given: int, span: Span) -> Diagnostic:
    takes = "no arguments" if wanted == 0 else f"{wanted} argument{'s' * (wanted != 1)}"
    return error("wrong-arity", "wrong number of arguments", span, f"`{name}` takes {takes}, {given} given")


def duplicate(name: str, span: Span, first: Span) -> Diagnostic:
    return error(
        "duplicate-declaration",
        f"`{name}` is declared twice",
        span,
        "declared again here",
        notes=(f"first declared at {first.place}",),
    )


def constant_written(name: str, span: Span) -> Diagnostic:
    return error(
        "constant-written",
        "a constant cannot change",
        span,
        f"`{name}` is declared in Definitions",
        "move it to ProgramVariables if the program changes it",
    )


def recursive_definition(cycle: tuple[str, ...], span: Span) -> Diagnostic:
    chain = " -> ".join(f"`{n}`" for n in cycle)
    return error("recursive-definition", "a definition uses itself", span, chain)


def captured(name: str, variables: Iterable[str], span: Span) -> Diagnostic:
    free = ", ".join(sorted(variables))
    return error(
        "captured-variable",
        "a definition would change its meaning here",
        span,
        f"`{name}` mentions {free}, which the program around it changes",
        f"declare {free} as argument of `{name}`",
    )


def undefined_function(name: str, span: Span) -> Diagnostic:
    return error(
        "undefined-function",
        "a function without definition cannot be executed",
        span,
        f"`{name}` has no body",
    )


def undefined_program(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    return error(
        "undefined-program", "undefined program", span, f"`{name}` is not defined", suggestion(name, known)
    )


def not_executable(code: str, construct: str, span: Span, advice: str = "") -> Diagnostic:
    """A construct that dL allows and no environment can execute."""
    return error(code, f"{construct} cannot be executed", span, help=advice)


def not_a_problem(span: Span) -> Diagnostic:
    return error(
        "no-program",
        "the problem contains no program to run",
        span,
        "expected `assumptions -> [{ctrl; plant}*] safe`",
    )
