"""An analyser finds nothing in exported monitors that could go wrong, whatever numbers they get.

Frama-C's Eva follows all values at once. Of checks: all finite numbers are those in range, and for each
field those beyond either end of the range, everything else being arbitrary. Nothing that they compute is
infinite or NaN.

Of the controller, its runs, the fallback and `monitored_ctrl` around a controller that returns just any
numbers: nothing is infinite or NaN where what is measured, asked for and given is in declared ranges. For
other numbers the fallback executes its first run unaccepted, whose roots may well be infinite, which the
search for a value expects. There, for any numbers with NaN and infinities among them, infinite and NaN
results are no alarms, but all else that C leaves undefined is: places outside of arrays, values never
written, integers that overflow, floating-point numbers that no integer can hold. The water tank's sound form
in double is only analysed so: in declared ranges, 55 halvings of intervals take Eva too long.
"""

import math
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from target_program import needed

from dl2c.commands.monitor import unit_of
from dl2c.emit import names
from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.ir.model import UNBOUNDED, Bound
from dl2c.monitor.check import Check

EXAMPLES = ("acc", "watertank", "waypoint")
FLAGS = ("-eva-split-return", "full", "-machdep", "gcc_x86_64")
PRECISE = ("-eva-precision", "3")
UNROLLED = ("-eva-precision", "1", "-eva-auto-loop-unroll", "64")
"""The search for a value halves intervals up to 55 times. Where each time is followed, ends are known."""


ANYTHING = ("-eva-precision", "1", "-warn-special-float", "none")
"""Infinite and NaN are values like others, so that ends do not matter."""

FORMS = [(real, sound) for real in ("double", "float") for sound in (False, True)]

REACHED = 90
"""Percent of the statements of the checks and what they call that an analysis reaches at least."""

Ranges = dict[str, tuple[float, float]]


def analysed(unit: Unit, folder: Path, text: str, *flags: str) -> str:
    """What Eva says at the end about a program that uses a monitor."""
    folder.mkdir()
    for name, written in monitor_files(unit).items():
        if name.startswith(unit.stem):
            (folder / name).write_text(written, encoding="utf-8")
    (folder / "analysed.c").write_text(text, encoding="utf-8")
    sources = [str(folder / name) for name in ("analysed.c", f"{unit.stem}_monitor.c")]
    command = ["frama-c", "-eva", *FLAGS, *flags, *sources]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    (folder / "said").write_text(done.stdout, encoding="utf-8")
    return done.stdout.split("ANALYSIS SUMMARY")[1]


def program(unit: Unit, calls: Iterator[tuple[Check, Ranges]]) -> str:
    """One that asks a check about numbers in ranges, for all `calls`."""
    stem = unit.stem
    functions: list[str] = []
    for check, ranges in calls:
        lines = list(drawn(unit, ranges))
        states = "&before, &after" if check.transition else "&before"
        lines += [f"  found = {stem}_check_{check.kind}({states}, &parameters).id;"]
        functions.append("\n".join([f"static void call{len(functions)}(void)", "{", *lines, "}\n"]))
    return "\n".join(
        [
            f'#include "{stem}_monitor.h"',
            '#include "__fc_builtin.h"',
            f"static {stem}_state before, after;\nstatic {stem}_parameters parameters;\nvolatile int found;",
            *functions,
            "int main(void)\n{",
            *(f"  call{k}();" for k in range(len(functions))),
            "  return 0;\n}\n",
        ]
    )


def drawn(unit: Unit, ranges: Ranges) -> Iterator[str]:
    between = "Frama_C_float_interval" if unit.single else "Frama_C_double_interval"
    for place, (low, high) in ranges.items():
        yield f"  {place} = {between}({low!r}, {high!r});"


def places(unit: Unit, check: Check) -> Iterator[tuple[str, Bound]]:
    """Every number that a check reads, and what is declared of it."""
    for state in ("before", "after") if check.transition else ("before",):
        yield from ((f"{state}.{names.member(v.name)}", v.bound) for v in unit.monitor.model.variables)
    yield from ((f"parameters.{names.member(c.name)}", c.bound) for c in unit.parameters)


def ends(unit: Unit, bound: Bound) -> tuple[float, float]:
    largest = float(unit.largest)
    low = -largest if bound.low is None else float(bound.low)
    return low, largest if bound.high is None else float(bound.high)


def declared(unit: Unit) -> Iterator[tuple[Check, Ranges]]:
    for check in unit.monitor.checks:
        yield check, {place: ends(unit, bound) for place, bound in places(unit, check)}


def everything(unit: Unit) -> Iterator[tuple[Check, Ranges]]:
    """All finite numbers: those in range, and those of which one is not."""
    kind = np.float32 if unit.single else np.float64
    most = float(np.finfo(kind).max)
    largest = kind(float(unit.largest))
    beyond = float(np.nextafter(largest, kind(math.inf)))
    for check in unit.monitor.checks:
        read = [place for place, _ in places(unit, check)]
        yield check, dict.fromkeys(read, (-float(largest), float(largest)))
        for out in read:
            for side in ((-most, -beyond), (beyond, most)):
                yield check, dict.fromkeys(read, (-most, most)) | {out: side}


def controlling(unit: Unit, anything: bool) -> str:
    """A program in which everything that a controller is for is called, with numbers in declared ranges or
    with any.
    """
    stem, controller, model = unit.stem, unit.monitor.controller, unit.monitor.model
    assert controller is not None
    bounds = {f"curr.{names.member(v.name)}": v.bound for v in model.variables}
    bounds |= {f"parameters.{names.member(c.name)}": c.bound for c in unit.parameters}
    bounds |= {f"input.{unit.field(i.key)}": Bound(i.low, i.high) for i in controller.inputs}
    states = [f"state.{names.member(v.name)}" for v in model.variables]
    given = list(drawn(unit, {place: ends(unit, bound) for place, bound in bounds.items()}))
    led = list(drawn(unit, {place: ends(unit, UNBOUNDED) for place in states}))
    if anything:
        given, led = ([f"  {place} = number;" for place in p] for p in (bounds, states))
    decisions = range(len(controller.decisions))
    called = "(curr, &parameters, &input, "
    return "\n".join(
        [
            f'#include "{stem}_monitor.h"',
            '#include "__fc_builtin.h"',
            f"static {stem}_state curr, led;\nstatic {stem}_parameters parameters;",
            f"static {stem}_input input;\nstatic int choices[{len(decisions) + 1}];",
            f"static volatile {unit.real} number;\nstatic volatile int whole;\nvolatile int found;",
            f"static {stem}_state any({stem}_state state, const {stem}_parameters *p, const {stem}_input *i)",
            "{\n  (void)p;\n  (void)i;",
            *led,
            "  return state;\n}\n",
            "int main(void)\n{",
            *given,
            *(f"  choices[{k}] = whole;" for k in decisions),
            *(f"  input.{unit.measured(d)} = whole;" for d in controller.measured),
            f"  led = {stem}_monitored_ctrl{called}any, 0);",
            f"  led = {stem}_monitored_ctrl{called}0, any);",
            f"  found = {stem}_run{called}choices, &led);",
            "  return 0;\n}\n",
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("example", EXAMPLES)
def test_nothing_can_go_wrong_in_a_controller(example: str, form: tuple[str, bool], tmp_path: Path) -> None:
    needed("frama-c", "frama-c-base")
    unit = unit_of(f"example:{example}", {}, ("controller",), real=form[0], sound=form[1])
    lengthy = (example, *form) == ("watertank", "double", True)
    for name, flags in (("declared", UNROLLED), ("anything", ANYTHING))[lengthy:]:
        said = analysed(unit, tmp_path / name, controlling(unit, name == "anything"), *flags)
        assert "0 alarms generated" in said, said
    covered = re.search(r"statements reached \(out of \d+\): (\d+)% coverage", said)
    assert covered is not None and int(covered[1]) >= REACHED, said


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("example", EXAMPLES)
def test_nothing_can_go_wrong(example: str, form: tuple[str, bool], tmp_path: Path) -> None:
    needed("frama-c", "frama-c-base")
    unit = unit_of(f"example:{example}", {}, real=form[0], sound=form[1])
    for name, calls in (("declared", declared(unit)), ("everything", everything(unit))):
        said = analysed(unit, tmp_path / name, program(unit, calls), *PRECISE)
        assert "0 alarms generated" in said, said
    covered = re.search(r"statements reached \(out of \d+\): (\d+)% coverage", said)
    assert covered is not None and int(covered[1]) >= REACHED, said
