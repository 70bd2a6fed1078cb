"""An analyser finds nothing in exported monitors that could go wrong, whatever finite numbers they get.

Frama-C's Eva follows all values at once. All finite numbers are those in range, and for each field those
beyond either end of the range, everything else being arbitrary.
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
from dl2c.emit.monitor_h import Unit
from dl2c.emit.monitor_text import monitor_files
from dl2c.ir.model import Bound
from dl2c.monitor.check import Check

EXAMPLES = ("acc", "watertank", "waypoint")
FLAGS = ("-eva-precision", "3", "-eva-split-return", "full", "-machdep", "gcc_x86_64")

FORMS = [(real, sound) for real in ("double", "float") for sound in (False, True)]

REACHED = 90
"""Percent of the statements of the checks and what they call that an analysis reaches at least."""

Ranges = dict[str, tuple[float, float]]


def analysed(unit: Unit, folder: Path, calls: Iterator[tuple[Check, Ranges]]) -> str:
    """What Eva says at the end about a program that asks a check about numbers in ranges, for all `calls`."""
    folder.mkdir()
    for name, text in monitor_files(unit).items():
        if name.startswith(unit.stem):
            (folder / name).write_text(text, encoding="utf-8")
    (folder / "analysed.c").write_text(program(unit, calls), encoding="utf-8")
    sources = [str(folder / name) for name in ("analysed.c", f"{unit.stem}_monitor.c")]
    done = subprocess.run(["frama-c", "-eva", *FLAGS, *sources], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    (folder / "said").write_text(done.stdout, encoding="utf-8")
    return done.stdout.split("ANALYSIS SUMMARY")[1]


def program(unit: Unit, calls: Iterator[tuple[Check, Ranges]]) -> str:
    stem = unit.stem
    between = "Frama_C_float_interval" if unit.single else "Frama_C_double_interval"
    functions: list[str] = []
    for check, ranges in calls:
        lines = [f"  {place} = {between}({low!r}, {high!r});" for place, (low, high) in ranges.items()]
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


def places(unit: Unit, check: Check) -> Iterator[tuple[str, Bound]]:
    """Every number that a check reads, and what is declared of it."""
    for state in ("before", "after") if check.transition else ("before",):
        yield from ((f"{state}.{names.member(v.name)}", v.bound) for v in unit.monitor.model.variables)
    yield from ((f"parameters.{names.member(c.name)}", c.bound) for c in unit.parameters)


def declared(unit: Unit) -> Iterator[tuple[Check, Ranges]]:
    largest = float(unit.largest)
    for check in unit.monitor.checks:
        ends = {
            place: (
                -largest if bound.low is None else float(bound.low),
                largest if bound.high is None else float(bound.high),
            )
            for place, bound in places(unit, check)
        }
        yield check, ends


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


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("example", EXAMPLES)
def test_nothing_can_go_wrong(example: str, form: tuple[str, bool], tmp_path: Path) -> None:
    needed("frama-c", "frama-c-base")
    unit = unit_of(f"example:{example}", {}, real=form[0], sound=form[1])
    for name, calls in (("declared", declared(unit)), ("everything", everything(unit))):
        said = analysed(unit, tmp_path / name, calls)
        assert "0 alarms generated" in said, said
    covered = re.search(r"statements reached \(out of \d+\): (\d+)% coverage", said)
    assert covered is not None and int(covered[1]) >= REACHED, said
