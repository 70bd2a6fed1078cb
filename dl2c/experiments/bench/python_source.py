"""Terms and formulas as Python expressions, as fast as plain Python evaluates them.

The state, the constants and the inputs are local variables `X_v`, `P_A`, `U_assign_v`. What is
undefined becomes NaN, for which every comparison written here is false; overflow is not
looked for. `NAMESPACE` holds what the expressions call.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, assert_never

from dl2c.emit.python.expr import Writer, flat
from dl2c.ir.model import And, Compare, Formula, Or, Symbol, Term, Truth

PREFIX = {"variable": "X_", "constant": "P_", "input": "U_", "time": "tau_"}


def _divide(a: float, b: float) -> float:
    return a / b if b else math.nan


def _least(a: float, b: float) -> float:
    return a if a < b else b if b <= a else math.nan


def _greatest(a: float, b: float) -> float:
    return a if a > b else b if b >= a else math.nan


def _value_of(function: Callable[..., float], *args: float) -> float:
    try:
        return function(*args)
    except (ValueError, ArithmeticError):
        return math.nan


NAMESPACE: dict[str, Any] = {
    "divide": _divide,
    "least": _least,
    "greatest": _greatest,
    "sqrt": partial(_value_of, math.sqrt),
    "exp": partial(_value_of, math.exp),
    "value_of": _value_of,
    "math": math,
}


def symbol_source(symbol: Symbol) -> str:
    """The local variable that holds a symbol."""
    return PREFIX[symbol.kind] + symbol.name


WRITER = Writer(symbol_source)


def term_source(term: Term) -> str:
    """An expression for the value of a term, in parentheses."""
    return f"({flat(WRITER.term(term))})"


def formula_source(formula: Formula) -> str:
    """An expression for the truth of a formula, in parentheses."""
    return f"({flat(WRITER.formula(formula))})"


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
