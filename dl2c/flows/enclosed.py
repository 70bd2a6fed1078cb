"""Terms over what encloses the state: intervals (hull.py) or Taylor models (taylor.py).

Evaluated as they are written; what does not move is computed in doubles. The same operations in the
same order as the C that dl2c/emit/simulator/enclosed_c.py prints.
"""

import math
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

from dl2c.ir.evaluate import Valuation, value_of
from dl2c.ir.logic import operands
from dl2c.ir.model import Add, Call, Div, Mul, Neg, Pow, Sub, Symbol, Term

Enclosure = TypeVar("Enclosure")

OPERATIONS: dict[type, str] = {Neg: "neg", Add: "add", Sub: "sub", Mul: "mul", Div: "div"}


class Enclosed(Generic[Enclosure]):
    """Terms along one flow, each different subterm computed once.

    `functions` are the operations by name, `number` makes an enclosure of a double, `moving` are the
    enclosures of what moves, `env` the state where the flow began.
    """

    def __init__(
        self,
        functions: Mapping[str, Callable[..., Enclosure]],
        number: Callable[[float], Enclosure],
        moving: Mapping[Symbol, Enclosure],
        env: Valuation,
        moves: Callable[[Term], bool],
    ) -> None:
        self.functions, self.number, self.moving, self.env, self.moves = functions, number, moving, env, moves
        self.made: dict[Term, Enclosure] = {}

    def term(self, term: Term) -> Enclosure:
        if term not in self.made:
            self.made[term] = self._value(term)
        return self.made[term]

    def _value(self, term: Term) -> Enclosure:
        if not self.moves(term):
            return self.number(in_doubles(term, self.env))
        match term:
            case Symbol():
                return self.moving[term]
            case Pow(base, 1):
                return self.term(base)
            case _:
                operation, args = last_operation(term)
                return self.functions[operation](*(self.term(a) for a in args))


def last_operation(term: Term) -> tuple[str, tuple[Term, ...]]:
    """The name of the outermost operation of a term, as enclosures compute it, and its operands."""
    match term:
        case Pow(base, exponent) if exponent % 2 == 0:
            return "square", (Pow(base, exponent // 2) if exponent > 2 else base,)
        case Pow(base, exponent):
            return "mul", (base, Pow(base, exponent - 1))
        case Mul(left, right) if left == right:
            return "square", (left,)
        case Call(function, args):
            return function, args
        case _:
            return OPERATIONS[type(term)], tuple(operands(term))


def in_doubles(term: Term, env: Valuation) -> float:
    """The value of a term; NaN where it has none."""
    value = value_of(term, env)
    return math.nan if value is None else float(value)
