"""A test in doubles that proves a formula over the reals.

A formula over drawn doubles comes in, with the range of every name; a formula goes out
that the compiled code evaluates in doubles. Each of its atoms compares with a slack that
bounds the rounding errors of both sides, so that wherever it is true in doubles, the
original formula holds for the exact real values.

Error analysis (Higham, "Accuracy and Stability of Numerical Algorithms", ch. 3): every
operation contributes half a unit in the last place of the largest possible result.
Assumes round to nearest, numbers rounded once, the operation order of the tree.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias, assert_never

from dl2c.interval.arithmetic import WHOLE, Box, Interval, enclosure, evaluate, magnitude, truth
from dl2c.interval.contract import contract
from dl2c.interval.rounding import add_down, add_up, div_up, mul_up, sqrt_down, sqrt_up
from dl2c.ir.logic import conjunction, conjuncts, difference, disjunction, operands, rewritten, sides, symbols
from dl2c.ir.model import (
    FALSE,
    ZERO,
    Add,
    Call,
    Compare,
    Div,
    Formula,
    Mul,
    Neg,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
    Truth,
)
from dl2c.sampling.equalities.root_of import Definition, RootOf
from dl2c.sampling.grid import Grid, granule
from dl2c.sampling.running import NoErrorBound, running_error

Errors: TypeAlias = Mapping[Symbol, float]

UNIT_ROUNDOFF = 2.0**-53
SMALLEST = 2.0**-1074
LARGEST = 1e300
"""Magnitudes beyond this count as overflow."""

SOLVED = "equalities are solved before: no difference proves one"

ALLOWED_ERROR = 2.0**-42
"""Of a computed name, relative to its range; what is drawn where rounding costs more is rejected."""


@dataclass(frozen=True, slots=True)
class Acceptance:
    """`formula` is the test; `errors` bounds |computed - exact| of every name, 0 for drawn ones."""

    formula: Formula
    errors: Mapping[Symbol, float]


def acceptance(
    formula: Formula,
    definitions: Sequence[tuple[Symbol, Definition]],
    bounds: Mapping[Symbol, Formula],
    box: Box,
    between: Sequence[Symbol] = (),
    grid: Grid | None = None,
) -> Acceptance:
    """A test for `formula`, the definedness of the definitions and the bounds of what they define.

    `box` limits the drawn names, and where no initial state is lost by it the defined ones. Those of
    `between` are exact, but only the formula says where they lie. On a `grid`, definitions may be exact.
    """
    known = dict(grid or {})
    defined = dict(definitions)
    ranges = {s: i for s, i in box.items() if s not in defined} | dict.fromkeys(between, WHOLE)
    errors = dict.fromkeys(ranges, 0.0)
    tests: list[Formula] = []
    for limit in [c for c in conjuncts(formula) if len(symbols(c)) == 1 and symbols(c) <= set(between)]:
        tests.append(_proved(limit, ranges, errors))
        if (limited := contract(limit, ranges)) is None:
            return Acceptance(FALSE, errors)
        ranges = limited
    for symbol, definition in definitions:
        exponent = None if isinstance(definition, RootOf) else granule(definition, known, ranges)
        if exponent is not None:
            known[symbol] = exponent
        found = _computed(symbol, definition, exponent is not None, box[symbol], ranges, errors)
        errors[symbol], ranges[symbol] = found.error, found.range
        tests += found.tests
        for limit in (bounds[symbol], *found.limits):
            tests.append(_proved(limit, ranges, errors))
            if ranges[symbol].empty or (limited := contract(limit, ranges)) is None:
                return Acceptance(FALSE, {**dict.fromkeys(defined, 0.0), **errors})
            ranges = limited
    return Acceptance(conjunction([*tests, _proved(formula, ranges, errors)]), errors)


@dataclass(frozen=True, slots=True)
class _Computed:
    """A value off by at most `error` where the `tests` hold; it counts only inside the `limits`."""

    error: float
    range: Interval
    tests: tuple[Formula, ...]
    limits: tuple[Formula, ...] = ()


def _computed(
    symbol: Symbol, definition: Definition, is_exact: bool, around: Interval, ranges: Box, errors: Errors
) -> _Computed:
    allowed = ALLOWED_ERROR * max(1.0, magnitude(around).high)
    if isinstance(definition, RootOf):
        test = _crossed(definition, allowed, errors)
        return _Computed(allowed, Interval(definition.low, definition.high), (test,))
    span = evaluate(definition, ranges)
    try:
        error = 0.0 if is_exact else error_bound(definition, ranges, errors)
        if error > allowed:
            raise NoErrorBound
        return _Computed(error, span, tuple(_defined(definition, ranges, errors)))
    except NoErrorBound:
        running = running_error(definition, errors)
        tests = (*running.conditions, Compare("<=", running.error, Number(Fraction(allowed))))
        return _Computed(allowed, span, tests, tuple(_inside(symbol, around)))


def _crossed(root: RootOf, reach: float, errors: Errors) -> Formula:
    """The polynomial has certainly different signs so far before and after the computed value: there is a
    zero between (intermediate value theorem)."""
    exact = {**errors, root.symbol: 0.0}
    sides: list[tuple[Formula, Formula]] = []
    for value in root.around(reach):
        running = running_error(value, exact)
        below, above = Compare("<", value, Neg(running.error)), Compare(">", value, running.error)
        sides.append((conjunction([*running.conditions, below]), conjunction([*running.conditions, above])))
    (low_before, high_before), (low_after, high_after) = sides
    return disjunction([conjunction([low_before, high_after]), conjunction([high_before, low_after])])


def _inside(symbol: Symbol, around: Interval) -> Iterator[Formula]:
    if math.isfinite(around.low):
        yield Compare(">=", symbol, Number(Fraction(around.low)))
    if math.isfinite(around.high):
        yield Compare("<=", symbol, Number(Fraction(around.high)))


def _proved(formula: Formula, box: Box, errors: Errors) -> Formula:
    """True in doubles only where the formula is true; what is true on the whole box is left out."""

    def proved(atom: Compare) -> Formula:
        verdict = truth(atom, box)
        return _proved_atom(atom, box, errors) if verdict == "unknown" else Truth(verdict == "true")

    return rewritten(formula, proved)


def _proved_atom(atom: Compare, box: Box, errors: Errors) -> Formula:
    atom = _descending(atom)
    try:
        conditions = [f for side in sides(atom) for f in _defined(side, box, errors)]
        return conjunction([*conditions, _separated(atom, box, errors)])
    except NoErrorBound:
        assert atom.op != "=", SOLVED
        running = running_error(difference(atom), errors)
        distance = _distance(atom)
        return conjunction([*running.conditions, Compare(">", distance, running.error, span=atom.span)])


def _descending(atom: Compare) -> Compare:
    """`>` for `<` and `>=` for `<=`."""
    if atom.op not in ("<", "<="):
        return atom
    return Compare(">" if atom.op == "<" else ">=", atom.right, atom.left, span=atom.span)


def _separated(atom: Compare, box: Box, errors: Errors) -> Compare:
    """The sides differ by more than their errors. Rounding the difference itself is monotone."""
    slack = add_up(error_bound(atom.left, box, errors), error_bound(atom.right, box, errors))
    if slack == 0:
        return atom
    assert atom.op != "=", SOLVED
    return Compare(">", _distance(atom), Number(Fraction(slack)), span=atom.span)


def _distance(atom: Compare) -> Term:
    """The difference of the sides, in the direction that the atom asks for."""
    return Call("abs", (difference(atom),)) if atom.op == "!=" else difference(atom)


def _defined(term: Term, box: Box, errors: Errors) -> Iterator[Formula]:
    """Tests that every square root in the term is taken of a nonnegative number."""
    for operand in operands(term):
        yield from _defined(operand, box, errors)
    if isinstance(term, Call) and term.function == "sqrt":
        yield _proved(Compare(">=", term.args[0], ZERO), box, errors)


# Rounding errors --------------------------------------------------------------


def error_bound(term: Term, box: Box, errors: Errors) -> float:
    """A bound of |computed - exact| for all values in the box whose names are off by `errors`.

    Where a square root is undefined the computed value is NaN, which no atom accepts.
    """
    match term:
        case Number(value):
            return _representation_error(value)
        case Symbol():
            return errors[term]
        case Neg(child) | Call("abs", (child,)) | Pow(child, 1):
            return error_bound(child, box, errors)
        case Call("min" | "max", (left, right)):
            return max(error_bound(left, box, errors), error_bound(right, box, errors))
        case Add(left, right) | Sub(left, right):
            inherited = add_up(error_bound(left, box, errors), error_bound(right, box, errors))
            return _rounded(term, inherited, box)
        case Mul(left, right):
            return _product_error(term, left, right, box, errors)
        case Pow(base, exponent) if exponent % 2:
            return _product_error(term, base, Pow(base, exponent - 1), box, errors)
        case Pow(base, exponent):
            half = Pow(base, exponent // 2)
            return _product_error(term, half, half, box, errors)
        case Div(left, right):
            a, b = error_bound(left, box, errors), error_bound(right, box, errors)
            nearest = add_down(_size(right, box).low, -b)
            if nearest <= 0:
                raise NoErrorBound
            return _rounded(term, div_up(add_up(a, mul_up(_size(term, box).high, b)), nearest), box)
        case Call("sqrt", (arg,)):
            a, low = error_bound(arg, box, errors), sqrt_down(max(evaluate(arg, box).low, 0.0))
            inherited = sqrt_up(a) if low == 0 else min(sqrt_up(a), div_up(a, low))
            return _rounded(term, inherited, box)
        case Call():
            raise NoErrorBound
        case _:
            assert_never(term)


def _product_error(term: Term, left: Term, right: Term, box: Box, errors: Errors) -> float:
    a, b = error_bound(left, box, errors), error_bound(right, box, errors)
    crossed = add_up(mul_up(_size(left, box).high, b), mul_up(_size(right, box).high, a))
    return _rounded(term, add_up(crossed, mul_up(a, b)), box)


def _rounded(term: Term, inherited: float, box: Box) -> float:
    """The error after rounding a result whose operands caused an `inherited` one."""
    size = add_up(_size(term, box).high, inherited)
    if size > LARGEST:
        raise NoErrorBound
    return add_up(inherited, add_up(mul_up(size, UNIT_ROUNDOFF), SMALLEST))


def _size(term: Term, box: Box) -> Interval:
    around = evaluate(term, box)
    if around.empty:
        raise NoErrorBound
    return magnitude(around)


def _representation_error(value: Fraction) -> float:
    try:
        return enclosure(abs(Fraction(float(value)) - value)).high
    except OverflowError:
        raise NoErrorBound from None
