"""Admissible values of `x := *` under the tests that follow (semantics 3), for the interpreter.

Works on a straight line of statements by trying values: a test that depends on one input
is linear in it, so two exact evaluations give its root. In doubles the range then extends
to the outermost values that pass the tests as they are evaluated, whatever the root was
rounded to; the compiled code finds the same ends.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dl2c.ir.evaluate import Undefined, Value, evaluate, truth
from dl2c.ir.logic import conjuncts, symbols
from dl2c.ir.model import Assign, AssignAny, Compare, Evolve, Formula, Symbol, Term, Test


@dataclass(frozen=True, slots=True)
class Range:
    """A non-empty closed interval of values that pass."""

    low: Value
    high: Value

    def nearest(self, value: Value) -> Value:
        """The admissible value closest to the given one; the low end for a NaN."""
        if not value >= self.low:
            return self.low
        return min(value, self.high)


Line = Sequence[Assign | AssignAny | Test | Evolve]
State = Mapping[Symbol, Value | None]


def admissible(
    line: Line, env: State, limits: Mapping[str, tuple[Fraction, Fraction]], exact: bool
) -> dict[str, Range] | None:
    """The range of every input on the line; None where a test cannot be passed."""
    keys = [s.key for s in line if isinstance(s, AssignAny)]
    if not _passes(line, env, None, Fraction(0), exact):
        return None
    ranges: dict[str, Range] = {}
    for key in keys:
        found = _range(line, env, key, limits[key], exact)
        if found is None:
            return None
        ranges[key] = found
    return ranges


def _range(line: Line, env: State, key: str, limits: tuple[Fraction, Fraction], exact: bool) -> Range | None:
    low, high = limits
    for atom, before in _tests(line, env, key):
        root = _root(atom, before)
        low = low if root[0] is None else min(max(low, root[0]), limits[1])
        high = high if root[1] is None else max(min(high, root[1]), limits[0])
    if exact:
        nudge = (high - low) / 2**60
        low, high = low + nudge, high - nudge
        passing = low <= high and _passes(line, env, key, low, True) and _passes(line, env, key, high, True)
        return Range(low, high) if passing else None
    box = rounded_up(limits[0]), rounded_down(limits[1])

    def test(value: float) -> bool:
        return _passes(line, env, key, value, False)

    bottom = outermost(test, float(low), box, -1)
    top = outermost(test, float(high), box, 1)
    return None if bottom is None or top is None else Range(bottom, top)


def outermost(
    test: Callable[[float], bool], start: float, box: tuple[float, float], direction: int
) -> float | None:
    """The passing double furthest in `direction` (-1 down, 1 up), searched from `start` inside the box.

    Where the start does not pass, a passing value is looked for on its inner side, then on its
    outer side. Steps of 1, 2, 4, ... units in the last place bracket the end of the passing
    values, then bisection finds it. None if no tried value passes.
    """
    limits = ordinal(box[0]), ordinal(box[1])
    here = min(max(ordinal(start), limits[0]), limits[1])
    if not test(from_ordinal(here)):
        failing, passing = _bracket(test, here, limits, -direction, True)
        if passing is not None:
            return _bisected(test, passing, failing)
        _, passing = _bracket(test, here, limits, direction, True)
        if passing is None:
            return None
        here = passing
    last, failing_end = _bracket(test, here, limits, direction, False)
    return from_ordinal(last) if failing_end is None else _bisected(test, last, failing_end)


def _bracket(
    test: Callable[[float], bool], here: int, limits: tuple[int, int], direction: int, wanted: bool
) -> tuple[int, int | None]:
    """The last value tried before the test becomes `wanted`, and the first one where it is."""
    step = 1
    while True:
        there = min(max(here + direction * step, limits[0]), limits[1])
        if there == here:
            return here, None
        if test(from_ordinal(there)) == wanted:
            return here, there
        here = there
        step *= 2


def _bisected(test: Callable[[float], bool], inside: int, outside: int) -> float:
    """The passing value next to a failing one, between one of each."""
    while abs(inside - outside) > 1:
        distance = abs(inside - outside) // 2
        middle = outside + (distance if inside > outside else -distance)
        if test(from_ordinal(middle)):
            inside = middle
        else:
            outside = middle
    return from_ordinal(inside)


def ordinal(value: float) -> int:
    """Doubles numbered in order: neighbours differ by one, both zeros are 0."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return bits if bits >= 0 else -(bits & (2**63 - 1))


def from_ordinal(number: int) -> float:
    (value,) = struct.unpack("<d", struct.pack("<q", abs(number)))
    return math.copysign(value, number)


def rounded_up(value: Fraction) -> float:
    """The least double that is not smaller."""
    near = float(value)
    return near if Fraction(near) >= value else math.nextafter(near, math.inf)


def rounded_down(value: Fraction) -> float:
    return -rounded_up(-value)


def _passes(line: Line, env: State, key: str | None, value: Value, exact: bool) -> bool:
    """Whether the tests that depend on input `key` alone (on no input for None) hold for a value of it."""
    moved: dict[Symbol, Value | None] = dict(env)
    depends: dict[Symbol, frozenset[str]] = {}
    for statement in line:
        match statement:
            case Assign(name, term):
                symbol = Symbol(name, "variable")
                depends[symbol] = _dependence(term, depends)
                try:
                    moved[symbol] = evaluate(term, moved, exact)
                except Undefined:
                    moved[symbol] = None
            case AssignAny(name, other):
                symbol = Symbol(name, "variable")
                depends[symbol] = frozenset({other})
                moved[symbol] = value if other == key else None
            case Test(formula):
                wanted = frozenset({key}) if key else frozenset[str]()
                for part in conjuncts(formula):
                    if _dependence(part, depends) == wanted and not truth(part, moved, exact):
                        return False
            case Evolve():
                raise AssertionError("the line ends before its flow")
    return True


def _dependence(part: Term | Formula, depends: Mapping[Symbol, frozenset[str]]) -> frozenset[str]:
    """The inputs that decide the value of a term or formula."""
    return frozenset[str]().union(*(depends.get(s, frozenset()) for s in symbols(part)))


def _tests(line: Line, env: State, key: str) -> list[tuple[Compare, Callable[[Fraction], Fraction]]]:
    """The atoms that depend on the input alone, each with its exact margin as a function of the value."""

    def margin_of(atom: Compare, stop: int) -> Callable[[Fraction], Fraction]:
        def margin(value: Fraction) -> Fraction:
            moved: dict[Symbol, Value | None] = {
                s: None if v is None else Fraction(v) for s, v in env.items()
            }
            for statement in line[:stop]:
                if isinstance(statement, Assign):
                    try:
                        moved[Symbol(statement.variable, "variable")] = evaluate(statement.term, moved, True)
                    except Undefined:
                        moved[Symbol(statement.variable, "variable")] = None
                elif isinstance(statement, AssignAny):
                    moved[Symbol(statement.variable, "variable")] = value if statement.key == key else None
            return Fraction(evaluate(atom.left, moved, True) - evaluate(atom.right, moved, True))

        return margin

    found: list[tuple[Compare, Callable[[Fraction], Fraction]]] = []
    depends: dict[Symbol, frozenset[str]] = {}
    for k, statement in enumerate(line):
        if isinstance(statement, Assign):
            depends[Symbol(statement.variable, "variable")] = _dependence(statement.term, depends)
        elif isinstance(statement, AssignAny):
            depends[Symbol(statement.variable, "variable")] = frozenset({statement.key})
        elif isinstance(statement, Test):
            for part in conjuncts(statement.formula):
                if _dependence(part, depends) == frozenset({key}):
                    found.append((_atom(part), margin_of(_atom(part), k)))
    return found


def _atom(part: Formula) -> Compare:
    assert isinstance(part, Compare), "path enumeration refuses other tests of inputs"
    return part


def _root(atom: Compare, margin: Callable[[Fraction], Fraction]) -> tuple[Fraction | None, Fraction | None]:
    """Lower and upper limit that an atom sets; none where it does not depend on the value after all."""
    try:
        at0, at1 = margin(Fraction(0)), margin(Fraction(1))
    except Undefined:
        return None, None
    slope = at1 - at0
    if slope == 0:
        return None, None
    rising = (slope > 0) == (atom.op in (">", ">="))
    root = -at0 / slope
    return (root, None) if rising else (None, root)
