"""Diagnostics of name resolution and of the executable fragment."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches

from dl2c.diagnostics import Diagnostic, error, warning
from dl2c.parse.tree import Declaration
from dl2c.source import Span

ELSEWHERE = {
    "skip": "`?true;` does nothing",
    "abort": "`?false;` has no run",
    "return": "dL has no `return`",
    "break": "dL has no `break`",
    "continue": "dL has no `continue`",
    "pow": "write `x^y`",
    "pi": "import it: `import kyx.math.pi;`",
    "e": "import it: `import kyx.math.e;`",
}
"""Advice for names that mean something in other languages or in the library."""

_AS_FORMULA = "a formula is true or false: compare it, for example with `= 0`"
_ADVICE = {
    ("variable", "formula"): _AS_FORMULA,
    ("constant", "formula"): _AS_FORMULA,
    ("function", "formula"): _AS_FORMULA,
    ("program", "formula"): "to say what holds after it write `[program;] P`",
    ("predicate", "function"): "a term is a number, a predicate is true or false",
    ("predicate", "term"): "a term is a number, a predicate is true or false",
    ("variable", "function"): "leave out the parentheses",
    ("constant", "function"): "leave out the arguments",
    ("predicate", "program"): "to test it write `?` before it",
}


def suggestion(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Advice naming the closest known name, or else another."""
    names = {known.lower(): known for known in sorted(known)}
    close = get_close_matches(name.lower(), names, n=1)
    return ELSEWHERE.get(name, f"did you mean `{names[close[0]]}`?" if close else otherwise)


def undeclared(kind: str, name: str, span: Span, known: Iterable[str], where: str) -> Diagnostic:
    """`kind` is variable, function, predicate or program."""
    label = f"`{name}` is not declared in {where}"
    declaration = {
        "variable": f"Real {name};",
        "function": f"Real {name}(Real x) = ...;",
        "predicate": f"Bool {name}(Real x) <-> ...;",
    }
    return error(
        f"undeclared-{kind}",
        f"undeclared {kind}",
        span,
        label,
        suggestion(name, known, f"declare it: `{declaration[kind]}`"),
    )


MANY_PLACES = 5
"""More places than these are counted."""


def also_at(found: Diagnostic, others: Sequence[Span]) -> Diagnostic:
    """The diagnostic, with the other places of the same mistake."""
    if not others:
        return found
    shown = ", ".join(f"{span.line}:{span.column}" for span in others[:MANY_PLACES])
    more = f" and {len(others) - MANY_PLACES} more" if len(others) > MANY_PLACES else ""
    return replace(found, notes=(*found.notes, f"also at {shown}{more}"))


UNDECLARED = "undeclared-names"

MANY_NAMES = 8
"""More names than these are counted."""


def inferred(variables: Sequence[str], constants: Sequence[str], span: Span) -> Diagnostic:
    """Names without declaration, of which either list may be empty."""
    both = ((variables, "a variable", "variables"), (constants, "a constant", "constants"))
    parts = [
        f"{_listed(names)} are taken as {several}" if len(names) > 1 else f"`{names[0]}` is taken as {one}"
        for names, one, several in both
        if names
    ]
    title = "names without declaration"
    return warning(UNDECLARED, title, span, ", ".join(parts), "`dl2c check --fix` declares them")


def existential(names: Sequence[str], span: Span) -> Diagnostic:
    """Names of existential quantifiers around the program."""
    several = len(names) > 1
    label = f"{_listed(names)} {'are constants' if several else 'is a constant'} here, with any value"
    return warning(
        "existential-constant",
        "the problem is about some value, not about all",
        span,
        f"{label}; a violation says nothing of others",
        f"give one for which the problem holds, `--set {names[0]}=0.1`",
    )


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"`{name}`" for name in names[:MANY_NAMES])
    return shown if len(names) <= MANY_NAMES else f"{shown} and {len(names) - MANY_NAMES} more"


def wrong_sort(name: str, is_a: str, wanted: str, span: Span) -> Diagnostic:
    help = _ADVICE.get((is_a, wanted), "")
    return error("wrong-sort", f"expected a {wanted}", span, f"`{name}` is a {is_a}", help)


def wrong_arity(name: str, wanted: int, given: int, span: Span) -> Diagnostic:
    takes = "no arguments" if wanted == 0 else f"{wanted} argument{'s' * (wanted != 1)}"
    return error("wrong-arity", "wrong number of arguments", span, f"`{name}` takes {takes}, {given} given")


def duplicate(name: str, span: Span, first: Span) -> Diagnostic:
    return error(
        "duplicate-declaration",
        f"`{name}` is declared twice",
        span,
        "declared again here",
        "leave one out",
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
    advice = "a use of a definition stands for its body, so the body must do without it"
    return error("recursive-definition", "a definition uses itself", span, chain, advice)


def captured(name: str, variables: Iterable[str], span: Span, bound: bool = False) -> Diagnostic:
    """`bound` by a quantifier around a use, which has another name now; else changed by a program."""
    free = ", ".join(sorted(variables))
    return error(
        "captured-variable",
        "a definition would change its meaning here",
        span,
        f"`{name}` mentions {free}, which {'a quantifier' if bound else 'the program'} around it "
        f"{'binds' if bound else 'changes'}",
        "let the quantifier bind another name" if bound else f"declare {free} as argument of `{name}`",
    )


def captured_argument(parameter: str, variables: Iterable[str], span: Span) -> Diagnostic:
    free = ", ".join(sorted(variables))
    return error(
        "captured-variable",
        "an argument would change its meaning here",
        span,
        f"`{parameter}` stands for a term with {free}, which the program around it changes",
        f"let the program change another variable than {free}",
    )


def parameter_written(parameter: str, span: Span) -> Diagnostic:
    return error(
        "captured-variable",
        "a parameter of a definition cannot be changed",
        span,
        f"`{parameter}` stands for an argument",
        "let the program change a variable of its own",
    )


def undefined_function(name: str, span: Span) -> Diagnostic:
    return error(
        "undefined-function",
        "a function without definition cannot be executed",
        span,
        f"`{name}` has no body",
    )


def implicit_function(name: str, defined: Span, span: Span) -> Diagnostic:
    return error(
        "implicit-function",
        "this function of time cannot be run",
        span,
        f"no solution of the differential equation of `{name}` is known",
        "solve it by hand, or make it part of the plant",
        notes=(f"defined at {defined.place}",),
    )


def undefined_program(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    help = suggestion(name, known, f"define it: `HP {name} ::= {{ ... }};`")
    return error("undefined-program", "undefined program", span, f"`{name}` is not defined", help)


def program_as_equation(name: str, span: Span) -> Diagnostic:
    return error(
        "program-as-equation",
        "a program is used as a differential equation",
        span,
        f"`{name}` is a program",
        f"to run it write `{name};`",
    )


def undefined_equation(name: str, span: Span, programs: Iterable[str]) -> Diagnostic:
    """A name among differential equations, `{c}` or `{x' = 1, c}`."""
    close = get_close_matches(name, sorted(programs), n=1)
    advice = f"to run the program `{close[0]}` write `{close[0]};`" if close else f"write `{name}' = ...`"
    label = f"`{name}` is not a differential equation"
    return error("undefined-program", "undefined differential equation", span, label, advice)


def not_executable(code: str, construct: str, span: Span, advice: str = "") -> Diagnostic:
    """A construct that dL allows and no environment can execute."""
    return error(code, f"{construct} cannot be executed", span, help=advice)


def unknown_constants(
    given: Iterable[str], known: Sequence[str], declarations: Mapping[str, Declaration], entry: Span
) -> list[Diagnostic]:
    """Names that `--set` gives a value, of which the model has no constants without definition."""
    return [_unknown_constant(n, known, declarations.get(n), entry) for n in sorted({*given} - {*known})]


def _unknown_constant(
    name: str, known: Sequence[str], declaration: Declaration | None, entry: Span
) -> Diagnostic:
    if declaration is None:
        label = f"the model declares no `{name}`"
    elif declaration.body is not None:
        label = f"`{name}` has a definition, which cannot be replaced"
    else:
        label = f"`{name}` is a program variable"
    return error(
        "unknown-constant",
        f"there is no undefined constant `{name}` to set",
        entry if declaration is None else declaration.span,
        label,
        suggestion(name, known) or f"constants without definition: {', '.join(known) or 'none'}",
    )


def modality(span: Span, reason: str) -> Diagnostic:
    """A program inside a condition that no condition on the state can stand for."""
    return error(
        "modality-in-state",
        "a modality inside a condition cannot be executed",
        span,
        reason,
        "replace it by a condition on the state; only the problem itself may run a program",
    )


def hole(span: Span, wanted: str) -> Diagnostic:
    """An exercise placeholder; `wanted` is what has to stand there."""
    return error(
        "exercise-hole",
        "an exercise with a hole cannot be executed",
        span,
        f"a {wanted} is missing here",
        f"replace `{'_' * 10}` by a {wanted}",
    )


def too_deep(span: Span, limit: int) -> Diagnostic:
    return error(
        "too-deep",
        f"with its definitions expanded, the problem is nested deeper than {limit} levels",
        span,
        help="nest definitions less deeply",
    )


def too_large(span: Span, limit: int) -> Diagnostic:
    return error(
        "too-large",
        f"with its definitions expanded, the problem has more than {limit} symbols",
        span,
        help="nest fewer definitions that use an argument more than once",
    )


def too_many_quantifiers(span: Span, limit: int) -> Diagnostic:
    return error(
        "quantifier",
        f"with its definitions expanded, the problem has more than {limit} quantifiers",
        span,
        help="replace quantified conditions by equivalent ones without quantifiers",
    )


def not_a_problem(span: Span) -> Diagnostic:
    return error(
        "no-program",
        "the problem contains no program to run",
        span,
        "expected `assumptions -> [{ctrl; plant}*] safe`; programs inside conditions are none",
    )


def outside_modality(span: Span) -> Diagnostic:
    return error(
        "condition-beside-program",
        "a condition beside the program is not part of an environment",
        span,
        "no program stands before this",
        "`[program] P & Q` means `([program] P) & Q`: write `[program](P & Q)`",
    )


def several_modalities(span: Span, written: str, first: Span) -> Diagnostic:
    """`written` is how the modality looks: `[program]` or `<program>`."""
    return error(
        "several-modalities",
        f"the problem has several `{written}`",
        span,
        f"the first is at {first.place}",
        "join their postconditions after one of them: `" + written + "(P & Q)`",
    )


# ---------------------------------------------------------------- scenes


def not_a_shape(span: Span) -> Diagnostic:
    return error(
        "malformed-annotation",
        "`@scene` lists shapes",
        span,
        "expected `shape(...)`",
        'for example `disk(x, y, radius=1, name="robot", role=agent)`',
    )


def unknown_shape(span: Span, name: str, known: Sequence[str]) -> Diagnostic:
    otherwise = f"shapes are {', '.join(f'`{k}`' for k in known)}"
    return error("unknown-shape", f"there is no shape `{name}`", span, "", suggestion(name, known, otherwise))


def unknown_argument(span: Span, shape: str, name: str, known: Sequence[str]) -> Diagnostic:
    otherwise = f"by name it takes {', '.join(f'`{k}`' for k in known)}"
    help = suggestion(name, known, otherwise)
    return error("unknown-argument", f"`{shape}` has no argument `{name}`", span, "", help)


def missing_argument(span: Span, shape: str, name: str) -> Diagnostic:
    value = {"name": '"..."', "heading": "(dx, dy)"}.get(name, "...")
    return error("missing-argument", f"`{shape}` needs `{name}`", span, "", f"add `{name}={value}`")


def repeated_argument(span: Span, shape: str, name: str) -> Diagnostic:
    return error(
        "repeated-argument", f"`{name}` of `{shape}` is given twice", span, "", "leave one of them out"
    )


def wrong_places(span: Span, shape: str, wanted: str, given: int) -> Diagnostic:
    title = f"`{shape}` does not take {given} argument{'s' * (given != 1)} by place"
    return error("wrong-arguments", title, span, "", f"write {wanted}, then what has a name")


def not_a_scene_term(span: Span) -> Diagnostic:
    return error(
        "not-a-term",
        "a shape is drawn from numbers",
        span,
        "this is true or false",
        "write a term over variables and constants",
    )


def not_a_direction(span: Span) -> Diagnostic:
    return error("not-a-direction", "a direction has two components", span, "", "write `heading=(dx, dy)`")
