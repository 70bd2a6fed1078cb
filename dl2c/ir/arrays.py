"""Terms and formulas for many states at once, in numpy.

Values are arrays of one shape, or single numbers, by symbol. Every operation rounds once, in the order of
the tree, as the compiled code does; only functions of the C library may differ from numpy's. What is
undefined or infinite is NaN, and an atom that has such a side is false.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial, reduce
from typing import Any, TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import ARITHMETIC, COMPARISONS, fold
from dl2c.ir.model import Binary, Call, Compare, Formula, Neg, Number, Pow, Symbol, Term

Columns: TypeAlias = Mapping[Symbol, NDArray[np.float64] | float]
"""Values of symbols; arrays of them have one shape."""


def values(term: Term, columns: Columns) -> Any:
    """The term's value in each state; NaN where it has none."""
    return Evaluation(columns.__getitem__).value(term)


def truths(formula: Formula, columns: Columns) -> Any:
    """Whether the formula holds, in each state."""
    return Evaluation(columns.__getitem__).truth(formula)


def margins(formula: Formula, columns: Columns) -> Any:
    """How far the formula is from its boundary in each state: not negative where it holds, but for rounding.

    Of an atom the difference of its sides over 1 and their sizes; `&` is min, `|` is max.
    """
    return Evaluation(columns.__getitem__).margin(formula)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Terms and formulas over the values of symbols that `column` gives. Values of terms are `known` by
    identity, so that what the terms of a formula share is computed once.
    """

    column: Callable[[Symbol], NDArray[np.float64] | float]
    known: dict[int, Any] = field(default_factory=dict[int, Any])

    def value(self, term: Term) -> Any:
        with np.errstate(all="ignore"):
            return self._value(term)

    def truth(self, formula: Formula) -> Any:
        both, either = partial(reduce, np.logical_and), partial(reduce, np.logical_or)
        with np.errstate(all="ignore"):
            return fold(formula, np.bool_, self._compared, both, either)

    def margin(self, formula: Formula) -> Any:
        least, most = partial(reduce, np.minimum), partial(reduce, np.maximum)
        with np.errstate(all="ignore"):
            return fold(formula, lambda true: np.float64(np.inf if true else -np.inf), self._gap, least, most)

    def _compared(self, atom: Compare) -> Any:
        a, b = self._value(atom.left), self._value(atom.right)
        return (a < b) | (a > b) if atom.op == "!=" else COMPARISONS[atom.op](a, b)

    def _gap(self, atom: Compare) -> Any:
        a, b = self._value(atom.left), self._value(atom.right)
        gap = (a - b) / (1 + np.abs(a) + np.abs(b))
        signed = {"<": -gap, "<=": -gap, "=": -np.abs(gap), "!=": np.abs(gap)}.get(atom.op, gap)
        return np.where(np.isfinite(signed), signed, -np.inf)

    def _value(self, term: Term) -> Any:
        found = self.known.get(id(term))
        if found is None:
            found = self.known[id(term)] = self._computed(term)
        return found

    def _computed(self, term: Term) -> Any:
        match term:
            case Number(value):
                return np.asarray(float(value))
            case Symbol():
                return np.asarray(self.column(term))
            case Neg(child):
                return -self._value(child)
            case Binary():
                return _finite(ARITHMETIC[type(term)](self._value(term.left), self._value(term.right)))
            case Pow(base, exponent):
                return _power(self._value(base), exponent)
            case Call("min" | "max" as function, (left, right)):
                a, b = self._value(left), self._value(right)
                chosen = a < b if function == "min" else a > b
                return _where(np.isnan(a) | chosen, a, b)
            case Call(function, args):
                return _finite(FUNCTIONS[function].array(*map(self._value, args)))
            case _:
                assert_never(term)


def _power(base: Any, exponent: int) -> Any:
    """By the order of multiplications that `Pow` says."""
    if exponent == 1:
        return base
    if exponent % 2:
        return _finite(base * _power(base, exponent - 1))
    half = _power(base, exponent // 2)
    return _finite(half * half)


def _finite(a: Any) -> Any:
    return _where(np.isfinite(a), a, np.nan)


_where: Callable[[Any, Any, Any], Any] = np.where
