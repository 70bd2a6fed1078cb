"""Exported monitors: what their headers promise, and who may compile and link them."""

import json
import random
import re
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from conftest import shared
from monitor_program import program_of
from selection import quick_rows

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.ir.printer import print_formula
from dl2c.native.program import answers

BOUNDS = {"default_bound": "-10:10"}
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Werror")
EXAMPLES = ("waypoint", "static_safety", "bouncing_ball", "etcs")


def found(name: str) -> str:
    return str(shared("findings") / "models" / name)


def written(unit: Unit, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in monitor_files(unit).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def compiled(folder: Path, *words: str) -> str:
    """What a compiler says; "" where it is content."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    return done.stderr if done.returncode else ""


def test_inputs_without_limits_have_monitors_in_floats(tmp_path: Path) -> None:
    """An infinite end of a range was cast to a float."""
    folder = written(unit_of(found("crash.kyx"), {}, real="float"), tmp_path)
    (source,) = folder.glob("*_monitor.c")
    assert not compiled(folder, "cc", "-std=c99", *STRICT, "-c", source.name, "-o", "out.o")


def test_eliminated_equalities_are_not_relaxed(tmp_path: Path) -> None:
    """They separate cases: relaxed, with sides of 1e9, they accepted what the header denies."""
    unit = unit_of(found("o2.kyx"), BOUNDS, kinds=("controller",), sound=True)
    program = program_of(unit, tmp_path)
    before, after = "2.5 0 0 0", "3 0 {} 0"
    (wrong,) = answers(program.path, [f"controller {before} {after.format(repr(2.5 + 12e-9))} 1"])
    assert wrong.split()[0] != "0"
    (right,) = answers(program.path, [f"controller {before} 2.5 0 2.5 0 1"])
    assert right == "0 0"
    formulas = [print_formula(c.formula) for _, _, c in unit.monitor.conditions]
    assert not any("abs(1000000000 *" in text for text in formulas)


@pytest.mark.parametrize("sound", [False, True])
@pytest.mark.parametrize("example", EXAMPLES)
def test_the_header_prints_what_is_evaluated(example: str, sound: bool) -> None:
    unit = unit_of(f"example:{example}", {}, sound=sound)
    files = monitor_files(unit)
    header = " ".join(re.sub(r"\n \*\s*", " ", files[f"{unit.stem}_monitor.h"]).split())
    told = json.loads(files["conditions.json"])
    by_id = {c["id"]: c for c in told["conditions"]}
    for _, _, condition in unit.monitor.conditions:
        text = print_formula(condition.formula)
        assert " ".join(text.split()) in header
        assert by_id[condition.number]["evaluated"] == text
    assert len(by_id) == 1 + sum(1 for _ in unit.monitor.conditions) and told["sha256"]
    spans = [c for c in told["conditions"] if c.get("span")]
    assert spans and all(c["source"] for c in spans)


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
@pytest.mark.parametrize("sound", [False, True])
def test_fast_arithmetic_is_refused(flag: str, sound: bool, tmp_path: Path) -> None:
    """NaN was accepted where a compiler may assume that there is none."""
    unit = unit_of("example:waypoint", {}, sound=sound)
    folder = written(unit, tmp_path)
    source = f"{unit.stem}_monitor.c"
    assert "NaN" in compiled(folder, "cc", "-std=c99", flag, "-c", source, "-o", "out.o")
    assert not compiled(folder, "cc", "-std=c99", "-c", source, "-o", "out.o")


FORMS = [*product(EXAMPLES, (False, True), ("double", "float"))]


@pytest.mark.parametrize(("example", "sound", "real"), quick_rows(FORMS, FORMS[::7]))
def test_monitors_are_cpp_and_compile_as_one(example: str, sound: bool, real: str, tmp_path: Path) -> None:
    """Two builds of one model, and of two, in one file and in one program."""
    unit = unit_of(f"example:{example}", {}, real=real, sound=sound)
    other = replace(unit, prefix="second", sound=not sound)
    third = unit_of("example:acc", {}, real="float")
    for one in (unit, other, third):
        written(one, tmp_path)
    sources = [f"{u.stem}_monitor.c" for u in (unit, other, third)]
    for source in sources:
        command = ("c++", "-x", "c++", "-std=c++11", *STRICT, "-c", source, "-o", "out.o")
        assert not compiled(tmp_path, *command)
    (tmp_path / "all.c").write_text("".join(f'#include "{s}"\n' for s in sources), encoding="utf-8")
    assert not compiled(tmp_path, "cc", "-std=c99", *STRICT, "-c", "all.c", "-o", "all.o")
    (tmp_path / "calls.cpp").write_text(
        "".join(f'#include "{s[:-1]}h"\n' for s in sources)
        + "int main() { return 0 "
        + "".join(f"+ ({u.stem}_check_init == 0)" for u in (unit, other, third))
        + "; }\n",
        encoding="utf-8",
    )
    for source in sources:
        assert not compiled(tmp_path, "cc", "-std=c99", "-c", source)
    objects = [s.replace(".c", ".o") for s in sources]
    assert not compiled(tmp_path, "c++", "-std=c++11", "calls.cpp", *objects, "-lm", "-o", "calls")


def test_the_program_refuses_what_it_cannot_read(tmp_path: Path) -> None:
    """It printed `0 0`, satisfied, for an unknown word, and for a line that lacks numbers."""
    program = program_of(unit_of("example:static_safety_line", {}), tmp_path)
    good = "init 1 2 0 60 0 0.25 4 2 3\n"
    path = tmp_path / "program"

    def ran(text: str, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([path, *words], input=text, capture_output=True, text=True, check=False)

    assert program.unit.stem and ran(good).returncode == 0
    for bad in ("foo 1\n", "init\n", "init 1 2\n", good[:-1] + " 7\n", "init 1 2 0 60 0 0.25 4 2 x\n", "1\n"):
        done = ran(good + bad + good)
        assert done.returncode == 2 and len(done.stdout.splitlines()) == 1, bad
        assert done.stderr.startswith("line 2: ") and "  init x v a xo t ep b A gap\n" in done.stderr
    assert ran("init" + " 1" * 100_000 + "\n").returncode == 2
    assert ran("\n \n" + good).returncode == 0 and ran("", "--help").stdout.startswith("  init x v")


@pytest.mark.parametrize("real", ["double", "float"])
def test_zeros_and_short_numbers_are_decided(real: str, tmp_path: Path) -> None:
    """Of true transitions whose `w` is 0, all were unknown: 0 >= 0 with room for rounding on both sides."""
    unit = unit_of(found("o5.kyx"), {}, kinds=("controller",), sound=True, real=real)
    program = program_of(unit, tmp_path)
    rng = random.Random(5)
    lines: list[str] = []
    while len(lines) < 4000:
        r, ep, m = rng.uniform(0.5, 3), rng.uniform(0.01, 2), rng.uniform(1, 10)
        x, y = rng.randint(0, 80) / 8, rng.uniform(0, 10)
        u, w = rng.choice((0, rng.randint(-12, 12) / 4)), rng.choice((0, rng.uniform(-3, 3)))
        if u * u + w * w < r * r and u * w >= 0:
            numbers = [x, y, 0, 0, 0.5, 0, x + u, y + w, w, w, 0.5, 0, r, ep, m]
            lines.append(f"controller {' '.join(repr(float(v)) for v in numbers)}")
    told = [line.split() for line in answers(program.path, lines)]
    unknown = sum(int(words[1]) for words in told)
    assert unknown < 0.02 * len(lines)
    assert all(words[0] == "0" or words[1] == "1" for words in told) or real == "float"
