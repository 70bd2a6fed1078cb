"""Terms and formulas for many states at once, in numpy: for pictures and for searches.

Values are arrays of one shape, or single numbers, by symbol. What is undefined is NaN, and an atom that
has such a side is false. Nothing that must agree with compiled code to the last bit is computed here.
"""

import operator
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any, TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray

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

Columns: TypeAlias = Mapping[Symbol, NDArray[np.float64] | float]
"""Values of symbols; arrays of them have one shape."""

FUNCTIONS: Mapping[Function, Callable[..., Any]] = {
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "arcsin": np.arcsin,
    "arctan": np.arctan,
    "tanh": np.tanh,
    "pow": np.power,
}

COMPARISONS: Mapping[Comparison, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def values(term: Term, columns: Columns) -> Any:
    """The term's value in each state; NaN or infinite where it has none."""
    with np.errstate(all="ignore"):
        return _value(term, columns)


def truths(formula: Formula, columns: Columns) -> Any:
    """Whether the formula holds, in each state."""
    with np.errstate(all="ignore"):
        return _truth(formula, columns)


def margins(formula: Formula, columns: Columns) -> Any:
    """How far the formula is from its boundary in each state: not negative where it holds, but for rounding.

    Of an atom the difference of its sides over 1 and their sizes; `&` is min, `|` is max.
    """
    with np.errstate(all="ignore"):
        return _margin(formula, columns)


def _value(term: Term, columns: Columns) -> Any:
    match term:
        case Number(value):
            return np.float64(value)
        case Symbol():
            return columns[term]
        case Neg(child):
            return -_value(child, columns)
        case Add(left, right):
            return _value(left, columns) + _value(right, columns)
        case Sub(left, right):
            return _value(left, columns) - _value(right, columns)
        case Mul(left, right):
            return _value(left, columns) * _value(right, columns)
        case Div(left, right):
            divisor = _value(right, columns)
            return _value(left, columns) / np.where(divisor == 0, np.nan, divisor)
        case Pow(base, exponent):
            return np.power(_value(base, columns), exponent)
        case Call(function, args):
            return FUNCTIONS[function](*(_value(a, columns) for a in args))
        case _:
            assert_never(term)


def _truth(formula: Formula, columns: Columns) -> Any:
    match formula:
        case Truth(value):
            return np.bool_(value)
        case Compare(op, left, right):
            a, b = _value(left, columns), _value(right, columns)
            return COMPARISONS[op](a, b) & np.isfinite(a) & np.isfinite(b)
        case And(children):
            return reduce(np.logical_and, (_truth(c, columns) for c in children))
        case Or(children):
            return reduce(np.logical_or, (_truth(c, columns) for c in children))
        case _:
            assert_never(formula)


def _margin(formula: Formula, columns: Columns) -> Any:
    match formula:
        case Truth(value):
            return np.float64(np.inf if value else -np.inf)
        case Compare(op, left, right):
            a, b = _value(left, columns), _value(right, columns)
            gap = (a - b) / (1 + np.abs(a) + np.abs(b))
            signed = {"<": -gap, "<=": -gap, "=": -np.abs(gap), "!=": np.abs(gap)}.get(op, gap)
            return np.where(np.isfinite(signed), signed, -np.inf)
        case And(children):
            return reduce(np.minimum, (_margin(c, columns) for c in children))
        case Or(children):
            return reduce(np.maximum, (_margin(c, columns) for c in children))
        case _:
            assert_never(formula)
