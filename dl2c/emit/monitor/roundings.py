"""How close to a boundary a sound monitor may leave a comparison undecided.

An enclosure (cgen/monitor) of a term is off its value by at most N times epsilon times the term's size,
and N counts the roundings on the way. Sizes are what `SIZES` says, which the header of a monitor prints.
A comparison is undecided only where its sides differ by no more than that.
"""

from collections.abc import Sequence
from typing import assert_never

from dl2c.emit.monitor.interval_c import is_number_of_machine, precision_of
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import sides
from dl2c.ir.model import Add, Call, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term

PER_OPERATION = 3
"""Of one operation, in multiples of epsilon: its rounding, and the bound that intervals are widened by."""


def _listed(names: Sequence[str], last: str) -> str:
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _sizes_of_functions() -> str:
    """The rules of the table's rows, each with the functions that it is for."""
    rows = FUNCTIONS.items()
    rules = dict.fromkeys(row.size for _, row in rows if row.size)
    named = {rule: [name for name, row in rows if row.size == rule] for rule in rules}
    return ", ".join(f"of {_listed(names, 'and')} {rule}" for rule, names in named.items())


SIZES = (
    "The size of a number is its magnitude, of a sum or a difference the sum of both sizes, of a product "
    "their product, of a/b size(a)*size(b)/b^2, of sqrt(a) size(a)/sqrt(a), of min and max the larger one, "
    f"{_sizes_of_functions()}, of pow(a, b) "
    "pow(a, b)*(1 + size(b)*(1 + abs(log(a)) + size(a)/a))."
)

LIMITED = _listed([n for n, row in FUNCTIONS.items() if row.domain and not row.has_poles], "or")
"""Functions that have values for some arguments only."""


def roundings(formula: Formula, single: bool) -> int:
    """N for all comparisons of a formula; 0 where each is between numbers that are not computed."""
    return max((_of(side, single) for side in sides(formula)), default=0)


def _of(term: Term, single: bool) -> int:
    match term:
        case Number(value):
            return 0 if is_number_of_machine(value, single) else 1
        case Symbol():
            return 0
        case Neg(child) | Pow(child, 1):
            return _of(child, single)
        case Add(left, right) | Sub(left, right):
            return max(_of(left, single), _of(right, single)) + PER_OPERATION
        case Mul(left, right):
            return _of(left, single) + _of(right, single) + PER_OPERATION
        case Div(left, right):
            return 2 * (_of(left, single) + _of(right, single)) + 2 * PER_OPERATION
        case Pow(base, exponent):
            half = exponent - 1 if exponent % 2 else exponent // 2
            return _of(Pow(base, half), single) + _of(Pow(base, exponent - half), single) + PER_OPERATION
        case Call(function, args):
            return _of_function(function, [_of(a, single) for a in args])
        case _:
            assert_never(term)


def _of_function(name: str, args: list[int]) -> int:
    function = FUNCTIONS[name]
    if name == "sqrt":
        return args[0] + PER_OPERATION
    if function.exact:
        return max(args)
    own = sum(args) + function.width
    return 2 * own if function.steep else own


def explained(single: bool) -> str:
    """What a header says of conditions with a number of roundings."""
    precision = precision_of(single)
    epsilon, angle = f"{precision.kind}_EPSILON", precision.angle_most
    return (
        "`unknown within N`: a comparison in it is decided unless its sides differ by at most N * "
        f"{epsilon} * (size of the left side + size of the right side), or a divisor, an argument of "
        f"{LIMITED} is that close to where there is no value, or an angle is beyond {angle}, or numbers "
        f"are too large. {SIZES}"
    )
