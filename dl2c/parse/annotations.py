"""What annotations say, typed.

In: raw `Annotation`s as comments.py finds them. Out: one frozen record per annotation, numbers
exact, expressions parsed with spans in the source. Mistakes are collected and raised together.
Names inside expressions are not looked up here. `options.py` reads `@episode`, `resolve.scene` `@scene`.
"""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeAlias, TypeVar, cast

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import errors
from dl2c.parse.build import MAX_DIGITS
from dl2c.parse.options import Value, read_option
from dl2c.parse.parser import parse_annotated
from dl2c.parse.tree import Annotation, Declaration, Formula, Term
from dl2c.source import Span

Bound: TypeAlias = Fraction | None
"""One end of a bound; None is infinite: minus infinity as a lower end, infinity as an upper."""

Plot: TypeAlias = Literal["line", "hist", "scatter", "none"]
Role: TypeAlias = Literal["agent", "env"]
Category: TypeAlias = Literal["safety", "progress", "stability"]
Action: TypeAlias = Literal["terminate", "truncate", "continue"]
Status: TypeAlias = Literal["success", "failure", "none"]
Place: TypeAlias = Literal["definition", "variable"]
Attribute: TypeAlias = tuple[str, str, Span]

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class VariableAnnotation:
    """`@var` on a program variable: it is observed, within `bound` if given."""

    bound: tuple[Bound, Bound] | None
    description: str
    plot: Plot
    role: Role | None
    unit: str
    observe: bool
    span: Span


@dataclass(frozen=True, slots=True)
class ConstantAnnotation:
    """`@const` on a constant: sampled within `bound` once per episode."""

    bound: tuple[Bound, Bound] | None
    description: str
    plot: Plot
    unit: str
    observe: bool
    span: Span


@dataclass(frozen=True, slots=True)
class Trigger:
    """What becomes of the episode when a predicate holds or fails."""

    action: Action
    status: Status
    span: Span


@dataclass(frozen=True, slots=True)
class PredicateAnnotation:
    """`@safety`, `@progress` or `@stability`; an absent reward is None."""

    category: Category
    reward: Term | Formula | None
    penalty: Term | Formula | None
    shape: Term | Formula | None
    on_success: Trigger | None
    on_failure: Trigger | None
    span: Span


@dataclass(frozen=True, slots=True)
class ChoiceAnnotation:
    """`@choice` before a choice: who decides, and under which name ("" for the default key)."""

    role: Role | None
    name: str
    span: Span


@dataclass(frozen=True, slots=True)
class FallbackAnnotation:
    """`@fallback` before the alternative to take first when a requested one blocks."""

    span: Span


@dataclass(frozen=True, slots=True)
class EpisodeAnnotation:
    """`@episode` above Problem: (option, value, span of the value), in the order written."""

    options: tuple[tuple[str, Value, Span], ...]
    span: Span


DeclarationAnnotation: TypeAlias = VariableAnnotation | ConstantAnnotation | PredicateAnnotation
ProgramAnnotation: TypeAlias = ChoiceAnnotation | FallbackAnnotation

_VARIABLE = ("bound", "def", "plot", "role", "unit", "observe")
_CONSTANT = ("bound", "def", "plot", "unit", "observe")
_PREDICATE = ("reward", "penalty", "shape", "on_success", "on_failure")
_CHOICE = ("role", "name")
_BOUND = re.compile(r"\[\s*([^:\]]*?)\s*:\s*([^:\]]*?)\s*\]")
_DECIMAL = re.compile(r"[+-]?\s*[0-9]+(\.[0-9]+)?")
_TRIGGER = re.compile(r"(\w+)\s*(?::\s*(?:status\s*=\s*)?(\w+))?")


def decode_declaration(declaration: Declaration, place: Place) -> tuple[DeclarationAnnotation, ...]:
    """The annotations of one declaration of Definitions (`definition`) or ProgramVariables (`variable`)."""
    problems: list[Diagnostic] = []
    decoded: list[DeclarationAnnotation] = []
    seen: set[str] = set()
    for annotation in declaration.annotations:
        if annotation.name in seen:
            problems.append(errors.repeated_annotation(annotation.span, annotation.name))
        elif wrong := _wrong_kind(annotation, declaration, place):
            problems.append(wrong)
        else:
            decoded.append(_declared(annotation, problems))
            if annotation.name == "const" and declaration.body is not None:
                problems += [
                    errors.bound_of_defined(_name_span(a), declaration.name)
                    for a in annotation.attributes
                    if a[0] == "bound"
                ]
        seen.add(annotation.name)
    return _checked(tuple(decoded), problems)


def decode_program(annotations: Sequence[Annotation]) -> tuple[ProgramAnnotation, ...]:
    """The annotations inside programs, in source order."""
    problems: list[Diagnostic] = []
    decoded: list[ProgramAnnotation] = []
    for annotation in annotations:
        if annotation.name == "fallback":
            _attributes(annotation, (), problems)
            decoded.append(FallbackAnnotation(annotation.span))
        else:
            assert annotation.name == "choice"
            given = _attributes(annotation, _CHOICE, problems)
            role: Role | None = _get(given, "role", _role, None, problems)
            name = _get(given, "name", string, "", problems)
            decoded.append(ChoiceAnnotation(role, name, annotation.span))
    return _checked(tuple(decoded), problems)


def decode_problem(annotations: Sequence[Annotation]) -> EpisodeAnnotation | None:
    """The one `@episode` above Problem, or None."""
    annotations = [a for a in annotations if a.name == "episode"]
    if not annotations:
        return None
    problems = [errors.repeated_annotation(again.span, again.name) for again in annotations[1:]]
    options: list[tuple[str, Value, Span]] = []
    for attribute in annotations[0].attributes:
        name, text, span = attribute
        option = read_option(name, text, _name_span(attribute), span)
        if isinstance(option, Diagnostic):
            problems.append(option)
        elif any(option[0] == other for other, _, _ in options):
            problems.append(errors.repeated_attribute(_name_span(attribute), name))
        else:
            options.append((*option, span))
    return _checked(EpisodeAnnotation(tuple(options), annotations[0].span), problems)


def decode_conclusion(annotations: Sequence[Annotation]) -> tuple[PredicateAnnotation, ...]:
    """`@safety` and `@progress` above Problem: of what its box and its diamond promise."""
    problems: list[Diagnostic] = []
    decoded: dict[str, PredicateAnnotation] = {}
    for annotation in annotations:
        if annotation.name in decoded:
            problems.append(errors.repeated_annotation(annotation.span, annotation.name))
        elif annotation.name not in ("episode", "scene"):
            found = _declared(annotation, problems)
            assert isinstance(found, PredicateAnnotation)
            decoded[annotation.name] = found
    return _checked(tuple(decoded.values()), problems)


def _checked(value: _T, problems: Sequence[Diagnostic]) -> _T:
    if problems:
        raise CompileError(problems)
    return value


def _wrong_kind(annotation: Annotation, declaration: Declaration, place: Place) -> Diagnostic | None:
    """The error if the annotation does not fit what is declared below it."""
    name, kind, defined = annotation.name, _kind(declaration, place), declaration.body is not None
    match name:
        case "var":
            fits, wanted = kind == "program variable", "program variables"
        case "const":
            fits, wanted = kind == "constant", "constants"
        case "stability":
            defined = defined and not declaration.implicit
            fits, wanted = kind in ("predicate", "function") and defined, "definitions of sort Bool or Real"
        case _:
            fits, wanted = kind == "predicate" and defined, "definitions of sort Bool"
    instead = {"program variable": "var", "constant": "const"}.get(kind, "")
    if fits:
        return None
    return errors.wrong_kind(annotation.span, name, declaration.name, kind, wanted, instead)


def _kind(declaration: Declaration, place: Place) -> str:
    if place == "variable":
        return "program variable"
    match declaration.sort:
        case "Real":
            return "function" if declaration.parameters else "constant"
        case "Bool":
            return "predicate"
        case "HP":
            return "program"


def _declared(annotation: Annotation, problems: list[Diagnostic]) -> DeclarationAnnotation:
    match annotation.name:
        case "var":
            given = _attributes(annotation, _VARIABLE, problems)
            return VariableAnnotation(
                _get(given, "bound", _bound, None, problems),
                _get(given, "def", string, "", problems),
                _get(given, "plot", _plot, "none", problems),
                _get(given, "role", _role, None, problems),
                _get(given, "unit", string, "", problems),
                _get(given, "observe", _boolean, True, problems),
                annotation.span,
            )
        case "const":
            given = _attributes(annotation, _CONSTANT, problems)
            return ConstantAnnotation(
                _get(given, "bound", _bound, None, problems),
                _get(given, "def", string, "", problems),
                _get(given, "plot", _plot, "none", problems),
                _get(given, "unit", string, "", problems),
                _get(given, "observe", _boolean, True, problems),
                annotation.span,
            )
        case category:
            given = _attributes(annotation, _PREDICATE, problems)
            return PredicateAnnotation(
                cast("Category", category),
                _get(given, "reward", _expression, None, problems),
                _get(given, "penalty", _expression, None, problems),
                _get(given, "shape", _expression, None, problems),
                _get(given, "on_success", _trigger, None, problems),
                _get(given, "on_failure", _trigger, None, problems),
                annotation.span,
            )


# ---------------------------------------------------------------- attributes


def _attributes(
    annotation: Annotation, known: Sequence[str], problems: list[Diagnostic]
) -> dict[str, Attribute]:
    """The attributes by name; unknown and repeated ones are reported."""
    given: dict[str, Attribute] = {}
    for attribute in annotation.attributes:
        name = attribute[0]
        if name not in known:
            problems.append(errors.unknown_attribute(_name_span(attribute), annotation.name, name, known))
        elif name in given:
            problems.append(errors.repeated_attribute(_name_span(attribute), name))
        else:
            given[name] = attribute
    return given


def _name_span(attribute: Attribute) -> Span:
    """The span of an attribute's name, which stands before its value."""
    name, value, span = attribute
    start = span.source.text.rindex(name, 0, span.start) if value else span.start
    return Span(span.source, start, start + len(name))


def _get(
    given: dict[str, Attribute],
    name: str,
    decode: Callable[[str, Span], _T],
    default: _T,
    problems: list[Diagnostic],
) -> _T:
    if name not in given:
        return default
    _, text, span = given[name]
    if not text:
        problems.append(errors.no_value(span, name))
        return default
    try:
        return decode(text, span)
    except CompileError as found:
        problems.extend(found.diagnostics)
        return default


def _bound(text: str, span: Span) -> tuple[Bound, Bound]:
    """`[lo:hi]`, exact; `-inf` and `inf` are None."""
    ends = _BOUND.fullmatch(text)
    if ends is None:
        raise CompileError(errors.malformed_bound(span))
    low, high = (
        _decimal(end, span, infinity) for end, infinity in zip(ends.groups(), ("-inf", "inf"), strict=True)
    )
    if low is not None and high is not None and low > high:
        raise CompileError(errors.empty_bound(span))
    return low, high


def _decimal(text: str, span: Span, infinity: str) -> Bound:
    if text == infinity:
        return None
    if not _DECIMAL.fullmatch(text):
        raise CompileError(errors.malformed_bound(span))
    if len(text) > MAX_DIGITS:
        raise CompileError(errors.too_many_digits(span, MAX_DIGITS))
    value = Fraction("".join(text.split()))
    if abs(value) > sys.float_info.max:
        raise CompileError(errors.beyond_doubles(span))
    return value


def string(text: str, span: Span) -> str:
    """What stands between quotes. Raises `CompileError`."""
    if len(text) < 2 or text[0] != '"' or text.find('"', 1) != len(text) - 1:
        raise CompileError(errors.not_a_string(span))
    return text[1:-1].strip()


def _boolean(text: str, span: Span) -> bool:
    return one_of(text, span, ("true", "false")) == "true"


def _plot(text: str, span: Span) -> Plot:
    return cast("Plot", one_of(text, span, ("line", "hist", "scatter", "none")))


def _role(text: str, span: Span) -> Role:
    return cast("Role", one_of(text, span, ("agent", "env")))


def one_of(text: str, span: Span, known: Sequence[str]) -> str:
    """One of some words, with or without quotes. Raises `CompileError`."""
    word = text.strip('"')
    if word not in known:
        raise CompileError(errors.unknown_value(span, word, known))
    return word


def _trigger(text: str, span: Span) -> Trigger:
    """`terminate`, `truncate:failure` or `truncate:status=failure`; the status is `none` by default."""
    found = _TRIGGER.fullmatch(text)
    if found is None:
        raise CompileError(errors.malformed_trigger(span))
    action = one_of(found.group(1), span, ("terminate", "truncate", "continue"))
    status = one_of(found.group(2) or "none", span, ("success", "failure", "none"))
    return Trigger(cast("Action", action), cast("Status", status), span)


def _expression(text: str, span: Span) -> Term | Formula:
    """A term or formula; braces around all of it are dropped."""
    if text.startswith("{") and text.endswith("}"):
        span = Span(span.source, span.start + 1, span.end - 1)
    return parse_annotated(span)
