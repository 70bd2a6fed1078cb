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

from dl2c.commands.monitor import unit_of
from dl2c.diagnostics import CompileError
from dl2c.emit.interval_c import OPERATIONS, enclosing, prelude
from dl2c.emit.monitor_h import Unit
from dl2c.emit.monitor_text import monitor_files
from dl2c.emit.sound_monitor_c import LIMITS
from dl2c.ir.evaluate import evaluate, truth
from dl2c.ir.model import Compare, Symbol
from dl2c.monitor.check import OUT_OF_RANGE, Case, Check, Kind, after
from dl2c.native.program import compile_program

EXAMPLES = sorted({p.stem for p in (REPOSITORY / "examples").glob("*.kyx")} - {"pendulum"})
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
MODELS = {name: f"example:{name}" for name in EXAMPLES} | {"operations": OPERATIONS_USED}
State = dict[str, float]
Row = list[State]


def exactly(check: Check, row: Row) -> bool:
    """What a check is of exact numbers."""
    env: dict[Symbol, Any] = {Symbol(x, "variable"): Fraction(v) for x, v in row[0].items()}
    env |= {Symbol(c, "constant"): Fraction(v) for c, v in row[-1].items()}
    if check.transition:
        env |= {after(x): Fraction(v) for x, v in row[1].items()}
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


@pytest.mark.parametrize("count", [8, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("example", MODELS)
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


def test_functions_without_enclosure_are_refused() -> None:
    with pytest.raises(CompileError) as refused:
        monitor_files(unit_of("example:pendulum", {}, sound=True))
    assert [d.code for d in refused.value.diagnostics] == ["no-enclosure"]
    assert refused.value.diagnostics[0].span.line == 33


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


def test_every_operation_compiles(tmp_path: Path) -> None:
    text = prelude(" ".join(f"{name}(" for name in OPERATIONS))
    limits = "".join(f"#define IV_{n} DBL_{v}\n" for n, v in LIMITS.items())
    limits += "#define IV_TINY 1e-100\n"
    truths = "enum { IV_FALSE, IV_UNKNOWN, IV_TRUE };\n#define IV_SQRT sqrt\ntypedef double real;\n"
    headers = "#include <float.h>\n#include <math.h>\n#include <stdbool.h>\n"
    compile_program({"main.c": f"{headers}{limits}{truths}{text}int main(void) {{ return 0; }}\n"}, tmp_path)
