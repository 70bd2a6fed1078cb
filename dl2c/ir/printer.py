"""The IR as text: dL syntax for terms and formulas, one line per statement for programs.

What a person reads in `dl2c emit --stage ir` and in the comments of generated C.
"""

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import assert_never

from dl2c.ir.model import (
    Add,
    And,
    Assign,
    AssignAny,
    Binary,
    Block,
    Bound,
    Call,
    Choice,
    Compare,
    Div,
    Evolve,
    Flow,
    Formula,
    If,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Repeat,
    Shape,
    Sub,
    Symbol,
    Term,
    Test,
    Truth,
    While,
)

ATOM, POWER, PRODUCT, SUM = 4, 3, 2, 1
SIGNS: Mapping[type, str] = {Add: "+", Sub: "-", Mul: "*", Div: "/"}
SHORT = 17
"""Decimals with more digits after the point are printed as the double they stand for, if they do."""


def print_number(value: Fraction) -> str:
    """A decimal where the number has a short one, else the double it is, else a quotient."""
    if value.denominator == 1:
        return str(value.numerator)
    places = decimal_places(value)
    if places is None:
        return f"{value.numerator}/{value.denominator}"
    if places > SHORT and Fraction(float(value)) == value:
        return repr(float(value))
    whole = str(abs((value * 10**places).numerator)).rjust(places + 1, "0")
    sign = "-" if value < 0 else ""
    return f"{sign}{whole[:-places]}.{whole[-places:]}"


def decimal_places(value: Fraction) -> int | None:
    """How many digits after the point the number has as a decimal; None where it is none."""
    rest, places = value.denominator, 0
    for prime in (2, 5):
        times = 0
        while rest % prime == 0:
            rest, times = rest // prime, times + 1
        places = max(places, times)
    return places if rest == 1 else None


def print_term(term: Term) -> str:
    return _term(term)[0]


def _term(term: Term) -> tuple[str, int]:
    """The text and how tightly it binds."""
    match term:
        case Number(value):
            text = print_number(value)
            return text, ATOM if text.replace(".", "").isdigit() else SUM
        case Symbol(name):
            return name, ATOM
        case Neg(child):
            return f"-{_wrapped(child, POWER)}", SUM
        case Add() | Sub():
            return _infix(term, SUM, PRODUCT)
        case Mul() | Div():
            return _infix(term, PRODUCT, POWER)
        case Pow(base, exponent):
            return f"{_wrapped(base, ATOM)}^{exponent}", POWER
        case Call(function, args):
            return f"{function}({', '.join(print_term(a) for a in args)})", ATOM
        case _:
            assert_never(term)


def _infix(term: Binary, level: int, right: int) -> tuple[str, int]:
    return f"{_wrapped(term.left, level)} {SIGNS[type(term)]} {_wrapped(term.right, right)}", level


def _wrapped(term: Term, level: int) -> str:
    text, binds = _term(term)
    return text if binds >= level else f"({text})"


def print_formula(formula: Formula) -> str:
    match formula:
        case Truth(value):
            return "true" if value else "false"
        case Compare(op, left, right):
            return f"{print_term(left)} {op} {print_term(right)}"
        case And(children) | Or(children):
            other = Or if isinstance(formula, And) else And
            parts = (f"({print_formula(c)})" if isinstance(c, other) else print_formula(c) for c in children)
            return (" & " if isinstance(formula, And) else " | ").join(parts)
        case _:
            assert_never(formula)


def print_flow(flow: Flow) -> str:
    """The ODE in dL syntax."""
    equations = ", ".join(f"{x}' = {print_term(rate)}" for x, rate in flow.equations)
    domain = "" if flow.domain == Truth(True) else f" & {print_formula(flow.domain)}"
    return f"{{{equations}{domain}}}"


def print_block(block: Block, indent: str = "") -> Iterator[str]:
    """One line per statement, alternatives indented."""
    for statement in block:
        match statement:
            case Assign(variable, term):
                yield f"{indent}{variable} := {print_term(term)};"
            case AssignAny(variable, key, role):
                yield f"{indent}{variable} := *;  /* {key}, {role} */"
            case Test(formula):
                yield f"{indent}?{print_formula(formula)};"
            case If(condition, _, then, orelse):
                yield f"{indent}if ({print_formula(condition)})"
                yield from print_block(then, indent + "  ")
                yield f"{indent}else"
                yield from print_block(orelse, indent + "  ")
            case Choice(key, alternatives, role):
                yield f"{indent}{key} /* {role} */"
                for k, alternative in enumerate(alternatives):
                    yield f"{indent}{k}:{'  /* fallback */' if alternative.fallback else ''}"
                    yield from print_block(alternative.body, indent + "  ")
            case While(condition, _, body):
                yield f"{indent}while ({print_formula(condition)})"
                yield from print_block(body, indent + "  ")
            case Repeat(key, body, most, role):
                yield f"{indent}{key} /* {role}, at most {most} times */"
                yield from print_block(body, indent + "  ")
            case Evolve(flow):
                yield f"{indent}flow {flow}"
            case _:
                assert_never(statement)


def print_bound(bound: Bound) -> str:
    low = "-inf" if bound.low is None else print_number(bound.low)
    high = "inf" if bound.high is None else print_number(bound.high)
    return f"[{low}:{high}]"


def print_shape(shape: Shape) -> str:
    """A shape of a scene, its arguments in parentheses where they are several terms."""
    given = (
        f"{name}={text}" if len(terms) == 1 else f"{name}=({text})"
        for name, terms in shape.arguments
        for text in [", ".join(map(print_term, terms))]
    )
    return f"@scene {shape.role} {shape.kind}({', '.join(given)}) {shape.name}".rstrip()


def print_model(model: Model) -> str:
    """The whole step model."""
    lines = [f"model {model.name}", ""]
    for constant in model.constants:
        fixed = f" = {print_number(constant.value)}" if constant.value is not None else ""
        lines.append(f"constant {constant.name} {print_bound(constant.bound)}{fixed}")
    for variable in model.variables:
        observed = " observed" if variable.observed else ""
        lines.append(f"variable {variable.name} {print_bound(variable.bound)} {variable.initial}{observed}")
    lines += ["", f"precondition {print_formula(model.precondition)}"]
    for k, flow in enumerate(model.flows):
        horizons = ", ".join(f"{h.clock} <= {print_term(h.bound)}" for h in flow.horizons)
        cap = "" if flow.cap is None else f" cap {print_number(flow.cap)}"
        cap += "" if flow.reach is None else f" reach {print_number(flow.reach)}"
        cap += " drawn" if flow.drawn else ""
        lines += ["", f"flow {k} {print_flow(flow)}", f"  horizon {horizons or 'none'}{cap}"]
    for title, block in (("before the first step", model.prefix), ("before each step", model.lead)):
        if block:
            lines += ["", title, *print_block(block, "  ")]
    lines += ["", "step" if model.loops else "step (once)", *print_block(model.body, "  ")]
    for p in model.predicates:
        lines += ["", f"@{p.category} {p.name} {print_formula(p.formula)}"]
        for word, term in (("reward", p.reward), ("penalty", p.penalty), ("shape", p.shape)):
            if term is not None:
                lines.append(f"  {word} {print_term(term)}")
        for word, trigger in (("on_success", p.on_success), ("on_failure", p.on_failure)):
            if trigger is not None:
                lines.append(f"  {word} {trigger.action}:{trigger.status}")
        if p.due is not None:
            lines.append(f"  due {print_formula(p.due)}")
    if model.postcondition is not None:
        lines += ["", f"postcondition {print_formula(model.postcondition)}"]
    lines += ["", *map(print_shape, model.scene.shapes)] if model.scene.shapes else []
    return "\n".join(lines) + "\n"
