"""Terms and formulas as Python expressions, as fast as plain Python evaluates them.

The state, the constants and the inputs are local variables `X_v`, `P_A`, `U_assign_v`. What is
undefined becomes NaN, for which every comparison written here is false; overflow is not
looked for. `NAMESPACE` holds what the expressions call.
"""

import math
from collections.abc import Callable
from typing import Any, assert_never

from dl2c.ir.model import (
    Add,
    And,
    Call,
    Compare,
    Comparison,
    Div,
    Formula,
    Function,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)

PREFIX = {"variable": "X_", "constant": "P_", "input": "U_", "time": "tau_"}

NAMES: dict[Function, str] = {
    "abs": "abs",
    "min": "least",
    "max": "greatest",
    "sqrt": "sqrt",
    "exp": "exp",
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "arcsin": "arcsin",
    "arctan": "atan",
    "tanh": "tanh",
    "pow": "pow",
}

OPERATORS: dict[Comparison, str] = {"=": "==", "!=": "!=", "<": "<", "<=": "<=", ">": ">", ">=": ">="}


def _divide(a: float, b: float) -> float:
    return a / b if b else math.nan


def _least(a: float, b: float) -> float:
    return a if a < b else b if b <= a else math.nan


def _greatest(a: float, b: float) -> float:
    return a if a > b else b if b >= a else math.nan


def _or_nan(function: Callable[..., float]) -> Callable[..., float]:
    def total(*args: float) -> float:
        try:
            return function(*args)
        except (ValueError, ArithmeticError):
            return math.nan

    return total


NAMESPACE: dict[str, Any] = {
    "divide": _divide,
    "least": _least,
    "greatest": _greatest,
    "sqrt": _or_nan(math.sqrt),
    "exp": _or_nan(math.exp),
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": _or_nan(math.asin),
    "atan": math.atan,
    "tanh": math.tanh,
    "pow": _or_nan(math.pow),
}


def symbol_source(symbol: Symbol) -> str:
    """The local variable that holds a symbol."""
    return PREFIX[symbol.kind] + symbol.name


def term_source(term: Term) -> str:
    """An expression for the value of a term."""
    match term:
        case Number(value):
            return repr(float(value)) if value >= 0 else f"({float(value)!r})"
        case Symbol():
            return symbol_source(term)
        case Neg(child):
            return f"(-{term_source(child)})"
        case Add(left, right):
            return f"({term_source(left)} + {term_source(right)})"
        case Sub(left, right):
            return f"({term_source(left)} - {term_source(right)})"
        case Mul(left, right):
            return f"({term_source(left)} * {term_source(right)})"
        case Div(left, Number(value)) if value != 0:
            return f"({term_source(left)} / {float(value)!r})"
        case Div(left, right):
            return f"divide({term_source(left)}, {term_source(right)})"
        case Pow(base, exponent):
            return f"({term_source(base)} ** {exponent})"
        case Call(function, args):
            return f"{NAMES[function]}({', '.join(map(term_source, args))})"
        case _:
            assert_never(term)


def formula_source(formula: Formula) -> str:
    """An expression for the truth of a formula."""
    match formula:
        case Truth(value):
            return str(value)
        case Compare("!=", left, right):
            a, b = term_source(left), term_source(right)
            return f"({a} < {b} or {a} > {b})"
        case Compare(op, left, right):
            return f"({term_source(left)} {OPERATORS[op]} {term_source(right)})"
        case And(children):
            return f"({' and '.join(map(formula_source, children))})"
        case Or(children):
            return f"({' or '.join(map(formula_source, children))})"
        case _:
            assert_never(formula)


def margin_source(formula: Formula) -> str:
    """An expression that is positive inside a formula and crosses zero where a flow leaves it.

    For `!=` and `=` the margin has either sign inside: events on it look both ways.
    """
    match formula:
        case Truth(value):
            return "1.0" if value else "-1.0"
        case Compare("<" | "<=", left, right):
            return f"({term_source(right)} - {term_source(left)})"
        case Compare(_, left, right):
            return f"({term_source(left)} - {term_source(right)})"
        case And(children):
            return f"min({', '.join(map(margin_source, children))})"
        case Or(children):
            return f"max({', '.join(map(margin_source, children))})"
        case _:
            assert_never(formula)
