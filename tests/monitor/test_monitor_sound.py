"""The sound monitor: no verdict is wrong over the reals, however close the state is to a boundary."""

import math
import random
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from monitor_program import program_of
from selection import quick_among

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.interval_c import COMPARISONS, enclosing, prelude
from dl2c.emit.monitor.monitor_h import Unit, roundings_of, with_fixed
from dl2c.ir.evaluate import evaluate, truth
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import atoms, operands
from dl2c.ir.model import Add, Call, Compare, Div, Formula, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.monitor.check import OUT_OF_RANGE, Case, Check, Kind, after
from dl2c.native.program import compile_program

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
OPERATIONS_USED = """ProgramVariables
  /* @var: bound=[-5:5] */ Real x;
  /* @var: bound=[-5:5] */ Real y;
  /* @var: bound=[-5:5] */ Real z;
End.
Problem
  min(x*y, z) <= max(x/z, abs(y) - 1/3) & (sqrt(x^2 - y) < 3 + y^3 | -z^5 - x > 0.1 & z != y)
  -> [{x := *; ?x^2 <= 4; z := min(x, y);}*](x - y <= 10)
End.
"""
FUNCTIONS_USED = """ProgramVariables
  /* @var: bound=[-3:3] */ Real x;
  /* @var: bound=[-3:3] */ Real y;
  /* @var: bound=[-3:3] */ Real z;
End.
Problem
  sin(x) + cos(y) <= 1 + z/5 & exp(x) < y^2 + 4 & tanh(y*z) > -1/2 & arctan(x/2) - arcsin(y/4) < z + 3
  -> [{x := *; ?sin(x)*x <= 4 & tan(x/4) <= 0.8; z := exp(y/2);}*](cos(x) - y <= 10)
End.
"""
MODELS = {name: f"example:{name}" for name in EXAMPLES} | {
    "operations": OPERATIONS_USED,
    "functions": FUNCTIONS_USED,
}
QUICK = ("functions", "operations", "static_safety_line", "watertank")
SOMETIMES_UNDECIDED = ("operations", "functions", "pendulum")
"""Some of their boundaries are where no rounding is exact."""

State = dict[str, float]
Row = list[State]


def exactly(check: Check, row: Row) -> bool:
    """What a check is of exact numbers."""
    env = environment(row)
    return any(all(truth(c.formula, env, exact=True) for c in case.conditions) for case in check.cases)


def random_row(check: Check, case: Case, unit: Unit, rng: random.Random, kept: bool = False) -> Row:
    """States and parameters inside their bounds, or near numbers of small size; equalities of a case hold,
    and what none of them fixes is `kept` or drawn anew for the state after.
    """
    model = unit.monitor.model

    def inside(bound: Any) -> float:
        low = -10.0 if bound.low is None else float(bound.low)
        high = 10.0 if bound.high is None else float(bound.high)
        return rng.uniform(low, high)

    before, free = ({v.name: inside(v.bound) for v in model.variables} for _ in range(2))
    constants = {c.name: inside(c.bound) for c in unit.parameters}
    if not check.transition:
        return [before, constants]
    return [before, (before if kept else free) | explained(case, before, constants), constants]


def explained(case: Case, before: State, constants: State) -> State:
    """Values afterwards that equalities ask for, in doubles."""
    env: dict[Symbol, Any] = {Symbol(x, "variable"): v for x, v in before.items()}
    env |= {Symbol(c, "constant"): v for c, v in constants.items()}
    found: State = {}
    for condition in case.conditions:
        match condition.formula:
            case Compare("=", Symbol(new, "input"), value):
                with suppress(ArithmeticError, KeyError):
                    found[new.removesuffix("_post")] = float(evaluate(value, env))
            case _:
                pass
    return found


def boundaries(row: Row, check: Check, rng: random.Random) -> Iterator[Row]:
    """Rows around a point where the check changes its truth, as close as doubles are, by bisection.

    `row` satisfies it; each number of the state before and of the parameters is changed in turn.
    """
    for part in (0, len(row) - 1):
        for name in row[part]:

            def at(value: float, part: int = part, name: str = name) -> Row:
                changed = [*row[:part], row[part] | {name: value}, *row[part + 1 :]]
                if check.transition and part == 0 and row[1][name] == row[0][name]:
                    changed[1] = changed[1] | {name: value}
                return changed

            start = row[part][name]
            for end in (start + rng.uniform(0, 30), start - rng.uniform(0, 30)):
                yield from map(at, bisected(lambda value: exactly(check, at(value)), start, end))


def bisected(holds: Callable[[float], bool], low: float, high: float) -> Iterator[float]:
    if holds(low) == holds(high):
        return
    left = holds(low)
    while (middle := (low + high) / 2) not in (low, high):
        low, high = (middle, high) if holds(middle) == left else (low, middle)
    for value in (low, high):
        yield value
        yield math.nextafter(value, math.inf)
        yield math.nextafter(value, -math.inf)


def to_single(row: Row) -> Row:
    """The nearest floats."""
    return [{n: struct.unpack("f", struct.pack("f", v))[0] for n, v in part.items()} for part in row]


@pytest.mark.parametrize("count", [3, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("example", quick_among(MODELS, QUICK))
def test_no_verdict_near_a_boundary_is_wrong(example: str, real: str, count: int, tmp_path: Path) -> None:
    unit = unit_of(MODELS[example], {}, real=real, sound=True)
    program = program_of(unit, tmp_path)
    rng = random.Random(example)
    decided = satisfied = total = 0
    for check in unit.monitor.checks:
        rows: list[Row] = []
        for k in range(count):
            tries = [random_row(check, rng.choice(check.cases), unit, rng, k % 2 == 0) for _ in range(40)]
            row = next((row for row in tries if exactly(check, row)), tries[0])
            rows += [row, *(boundaries(row, check, rng) if exactly(check, row) else ())]
        rows = list(map(to_single, rows)) if unit.single else rows
        for row, (number, unknown) in zip(rows, program.verdicts(check.kind, rows), strict=True):
            if number != OUT_OF_RANGE:
                total += 1
                decided += not unknown
                satisfied += number == 0
                assert unknown or exactly(check, row) == (number == 0), (check.kind, row)
    generic = count * len(unit.monitor.checks)
    assert total > 4 * count and decided > generic / 2 and satisfied, (decided, satisfied, total)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("value", ["0.1", "1/3", "2", "-0.7", "100000001", "16777217", "1e-9"])
def test_numbers_are_enclosed(value: str, single: bool) -> None:
    text = enclosing(Fraction(value), single)
    ends = [Fraction(float(t.rstrip("f"))) for t in text.split("(")[1].rstrip(")").split(", ")]
    assert ends[0] <= Fraction(value) <= ends[-1]
    assert ends[-1] - ends[0] <= abs(Fraction(value)) * Fraction(2) ** (-22 if single else -51)


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e101"])
def test_what_is_no_number_is_not_satisfied(bad: str, tmp_path: Path) -> None:
    unit = unit_of("example:watertank", {}, sound=True)
    program = program_of(unit, tmp_path)
    state = {v.name: 1.0 for v in unit.monitor.model.variables}
    constants = {"U": 0.5, "q": 0.1}
    kinds: tuple[Kind, ...] = ("safety", "init", "controller", "model")
    for kind in kinds:
        good = [state, constants] if kind in ("safety", "init") else [state, state, constants]
        rows = [
            [*good[:k], part | {n: float(bad)}, *good[k + 1 :]] for k, part in enumerate(good) for n in part
        ]
        assert {number for number, _ in program.verdicts(kind, rows)} == {OUT_OF_RANGE}


@pytest.mark.parametrize("single", [False, True])
def test_every_operation_compiles(single: bool, tmp_path: Path) -> None:
    names = [
        *(row.enclosure for row in FUNCTIONS.values()),
        *COMPARISONS.values(),
        "iv_both",
        "iv_either",
        "iv_quotient",
        "iv_product",
    ]
    largest = Fraction(10**12 if single else 10**100)
    text = prelude(" ".join(names), single, largest)
    real = f"typedef {'float' if single else 'double'} real;\n"
    headers = "#include <float.h>\n#include <math.h>\n#include <stdbool.h>\n"
    compile_program({"main.c": f"{headers}{real}{text}int main(void) {{ return 0; }}\n"}, tmp_path)


# How close to a boundary it is undecided ----------------------------------------


def sized(term: Term, env: dict[Symbol, Any], room: float) -> tuple[float, float]:
    """A term's value and its size, as the header explains it; infinite where an argument is within `room`
    times its size of having no value.
    """
    match term:
        case Number(value):
            return float(value), abs(float(value))
        case Symbol():
            return float(env[term]), abs(float(env[term]))
        case Pow(base, exponent):
            value, size = sized(base, env, room)
            return value**exponent, size**exponent
        case _:
            return joined(term, [sized(t, env, room) for t in operands(term)], room)


def joined(term: Term, parts: list[tuple[float, float]], room: float) -> tuple[float, float]:
    (a, size), (b, other) = parts[0], parts[-1]
    match term:
        case Neg():
            return -a, size
        case Add() | Sub():
            return a + b if isinstance(term, Add) else a - b, size + other
        case Mul():
            return a * b, size * other
        case Div():
            return a / b, size * other / b**2 if abs(b) > room * other else math.inf
        case Call("abs"):
            return abs(a), size
        case Call("min" | "max" as which):
            return {"min": min, "max": max}[which](a, b), max(size, other)
        case Call("sqrt"):
            return math.sqrt(a), size / math.sqrt(a) if a > room * size else math.inf
        case Call("sin" | "cos" | "tanh" | "arctan" as which):
            return getattr(math, {"arctan": "atan"}.get(which, which))(a), 1 + size
        case Call("exp"):
            return math.exp(a), math.exp(a) * (1 + size)
        case Call("tan"):
            return math.tan(a), (1 + size) * (1 + math.tan(a) ** 2)
        case Call("arcsin"):
            return math.asin(a), 1 + size / math.sqrt(1 - a * a) if 1 - abs(a) > room * size else math.inf
        case _:
            raise AssertionError(term)


def undecided(formula: Formula, env: dict[Symbol, Any], roundings: int, epsilon: float) -> bool:
    """Whether a comparison in the formula may be, by what the header says."""
    for atom in atoms(formula):
        try:
            sides = [sized(side, env, roundings * epsilon) for side in (atom.left, atom.right)]
            apart = abs(float(exact(atom.left, env) - exact(atom.right, env)))
        except (ArithmeticError, ValueError):
            return True
        if apart <= roundings * epsilon * sum(size for _, size in sides) + 1e-280:
            return True
    return False


def exact(term: Term, env: dict[Symbol, Any]) -> Fraction:
    return Fraction(evaluate(term, env, exact=True))


@pytest.mark.parametrize("real", ["double", pytest.param("float", marks=pytest.mark.slow)])
@pytest.mark.parametrize("example", quick_among(MODELS, ("functions", "operations", "watertank")))
def test_what_is_undecided_is_as_close_as_the_header_says(example: str, real: str, tmp_path: Path) -> None:
    unit = unit_of(MODELS[example], {}, real=real, sound=True)
    program = program_of(unit, tmp_path)
    rng = random.Random(example)
    epsilon = 2.0 ** (-23 if unit.single else -52)
    formulas = {c.number: c for _, _, c in unit.monitor.conditions}
    seen = 0
    for check in unit.monitor.checks:
        found = [random_row(check, rng.choice(check.cases), unit, rng, k % 2 == 0) for k in range(60)]
        good = [row for row in found if exactly(check, row)][:3]
        rows = [near for row in good for near in (row, *boundaries(row, check, rng))]
        rows = list(map(to_single, rows)) if unit.single else rows
        for row, (number, unknown) in zip(rows, program.verdicts(check.kind, rows), strict=True):
            if unknown:
                seen += 1
                count = roundings_of(unit, formulas[number])
                formula = with_fixed(unit, formulas[number].formula)
                assert count and undecided(formula, environment(row), count, epsilon), (number, row)
    assert seen or example not in SOMETIMES_UNDECIDED


def environment(row: Row) -> dict[Symbol, Any]:
    env: dict[Symbol, Any] = {Symbol(x, "variable"): Fraction(v) for x, v in row[0].items()}
    env |= {after(x): Fraction(v) for x, v in row[1].items() if len(row) == 3}
    return env | {Symbol(c, "constant"): Fraction(v) for c, v in row[-1].items()}
