"""Exported monitors of controllers against an interpreter of the programs that shares no code with them.

Every verdict is compared with the conditions that the monitor prints, evaluated over the reals; and these
with the relation that the program itself makes between states, where a monitor is exported without
tolerances. States are true transitions and others around where a verdict changes.

A quick form runs with all tests; the slow one asks DL2C_STATES states of each model in all, a million if
that is not set. DL2C_SEED says which.
"""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY, shared
from oracles.controller_relation import FALSE_, TRUE, UNDECIDED, Relation
from oracles.near_states import States
from oracles.one_unknown import satisfiable
from oracles.printed_conditions import Printed, judged, read
from oracles.rigorous_arrays import Doubles

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.files import monitor_files
from dl2c.ir.model import Model
from dl2c.native.program import answers, compile_program

STATES = int(os.environ.get("DL2C_STATES", "1000000"))
SEED = int(os.environ.get("DL2C_SEED", "7"))
QUICK, CHUNK, FEW = 2000, 20_000, 4000
PASSES = 5
"""Among which the states of a model are divided: sound and plain monitors in doubles and in floats, and those
without tolerances.
"""
UNKNOWN_SHARE = 0.02
UNDECIDED_SHARE = 0.001
UNITS = {"double": Fraction(1, 2**53), "float": Fraction(1, 2**24)}
TOLERANCES = {"double": 1e-9, "float": 1e-5}

EXAMPLES = sorted(path.stem for path in (REPOSITORY / "examples").glob("*.kyx"))
RELEASE = "LS-Lab__KeYmaeraX-release/keymaerax-webui/src"
CASES = f"{RELEASE}/main/resources/examples/casestudies"
COMPONENTS = f"{RELEASE}/test/resources/examples/casestudies/components"
PUBLIC = {
    "followers": f"{COMPONENTS}/llc/multiport_system.kyx",
    "train": f"{COMPONENTS}/etcs/multiport_train.kyx",
    "block centre": f"{COMPONENTS}/etcs/multiport_rbc.kyx",
    "robots": f"{COMPONENTS}/robix/system.kyx",
    "chilled water": f"{RELEASE}/test/resources/examples/casestudies/chilledwater/chilled-m1.kyx",
    "roundabout": f"{CASES}/roundabout/TRM-essentials.kyx",
    "disturbed train": f"{CASES}/etcs/rephrased/safety-lemma-disturbed-simplified-piecewise.kyx",
    "essential train": f"{CASES}/etcs/ETCS-essentials.kyx",
    "stop sign": f"{CASES}/modelplex/pldi16/stopsignvdistchange.kyx",
    "parachute": "LS-Lab__KeYmaeraX-projects/lfcps-tutorial/parachute-nonaero.kyx",
}
FOUND = ("o2", "o5")
HIDDEN = {
    "a root": "?u^2 = x & u > y;",
    "a parabola": "?u^2 - x * u + y <= 0 & u != x;",
    "magnitudes": "?abs(u - x) <= y & u * y >= 1;",
    "a line": "?x * u >= y & u < 2;",
    "two values": "w := *; ?u + w = x & u >= y & w >= y; w := 0;",
    "a sum": "x := x + u; ?u^2 <= y;",
    "a square": "x := u^2 + y; ?u <= x;",
    "between": "?min(u, x) > y | max(u, y) < x;",
}
"""What is done with a value that no variable shows afterwards."""

MODELS = (*EXAMPLES, *PUBLIC, *FOUND, *HIDDEN)
BRIEF = ("watertank", "o5", "a parabola")
COUNTED = [
    *(pytest.param(name, QUICK, id=f"{name}-quick") for name in BRIEF),
    *(pytest.param(name, STATES // PASSES, marks=pytest.mark.slow, id=name) for name in MODELS),
]


@dataclass(frozen=True, slots=True)
class Subject:
    """A model, and its exported monitor."""

    model: Model
    relation: Relation
    printed: Printed
    files: dict[str, str]
    single: bool

    def states(self, seed: int) -> States:
        return States(self.model, self.relation, np.random.default_rng([SEED, seed]), self.single)

    def rows(self, count: int) -> Iterator[tuple[Doubles, int]]:
        """Chunks of rows, the true transitions first, and how many these are."""
        tolerance = TOLERANCES["float" if self.single else "double"]
        for k in range(-(-count // CHUNK)):
            states = self.states(k)
            true = states.true(min(count, CHUNK) // 2)
            near = states.near(true, self.printed.in_doubles, tolerance)
            yield np.concatenate([true, near]), len(true)


def text_of(name: str) -> str:
    """A model as a user names it."""
    if name in EXAMPLES:
        return f"example:{name}"
    if name in HIDDEN:
        body = f"u := *; {HIDDEN[name]} u := 0;"
        variables = "".join(f"  /* @var: bound=[-4:4] */\n  Real {x};\n" for x in "xyuw")
        return f"ProgramVariables\n{variables}End.\nProblem\n  x >= y -> [{{{body}}}*] x >= y\nEnd.\n"
    return str(
        shared("corpus") / PUBLIC[name] if name in PUBLIC else shared("findings/models") / f"{name}.kyx"
    )


@cache
def subject(name: str, real: str = "double", sound: bool = False, eps: tuple[str, ...] = ()) -> Subject:
    """A model's monitor."""
    options = {"default_bound": "-10:10"} if name in PUBLIC or name in FOUND else {}
    unit = unit_of(text_of(name), options, ("controller",), real, sound, eps)
    model = unit.monitor.model
    files = dict(monitor_files(unit))
    relation = Relation(model)
    after = [f"{x}_post" for x in relation.variables]
    printed = Printed(files, "controller", [*relation.variables, *after, *relation.parameters])
    return Subject(model, relation, printed, files, unit.single)


def verdicts(program: Path, rows: Doubles) -> "tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]":
    """The numbers that a compiled monitor answers, and what it says beside them."""
    found = answers(program, ["controller " + " ".join(map(repr, row)) for row in rows.tolist()])
    table = np.array([line.split() for line in found], dtype=np.float64).reshape(-1, 2)
    return table[:, 0].astype(np.int64), table[:, 1]


def some(rows: Doubles, where: "np.ndarray[Any, Any]", printed: Printed) -> list[dict[str, float]]:
    """A few of the rows, to be shown."""
    names = [s.name for s in printed.symbols]
    return [dict(zip(names, row, strict=True)) for row in rows[where][:2].tolist()]


def mistakes(one: Subject, program: Path, rows: Doubles, bare: list[int]) -> dict[str, Any]:
    """What a sound monitor says that is not so, with a few rows each; `bare` are cases without tolerances."""
    ids, unknown = verdicts(program, rows)
    decided, accepted = unknown == 0, (ids == 0) & (unknown == 0)
    by_case, related = one.printed.by_case(rows), one.relation.judged(rows)
    told = judged(by_case)
    wrong = {
        "out of range": ids == 1,
        "accepted": accepted & (told == FALSE_),
        "rejected": ~accepted & decided & (told == TRUE),
        "rejected, and related": ~accepted & decided & (related == TRUE),
        "related, but not by what is printed": (told == FALSE_) & (related == TRUE),
        "printed without tolerances, but not related": (by_case[bare] == TRUE).any(0) & (related == FALSE_),
        "satisfied, and unknown": (ids == 0) & ~decided,
        "named, though it holds": decided & one.printed.surely(rows, ids),
    }
    return {what: some(rows, where, one.printed) for what, where in wrong.items() if where.any()}


def unexplained(one: Subject, program: Path, rows: Doubles) -> tuple[int, list[dict[str, float]]] | None:
    """The first verdict of a plain monitor that rounding does not explain, and its row."""
    ids, _ = verdicts(program, rows)
    unit = UNITS["float" if one.single else "double"]
    for k in np.flatnonzero((ids == 0) != (judged(one.printed.by_case(rows)) == TRUE)).tolist():
        if not one.printed.may_be(bool(ids[k] == 0), rows[k].tolist(), unit):
            return int(ids[k]), some(rows, np.array([k]), one.printed)
    return None


@pytest.mark.parametrize("real", UNITS)
@pytest.mark.parametrize(("name", "count"), COUNTED)
def test_sound_verdicts_are_those_of_what_is_printed(
    name: str, count: int, real: str, tmp_path: Path
) -> None:
    one = subject(name, real, sound=True)
    strict = subject(name, real, eps=("0",)).printed.shape()
    bare = [k for k, case in enumerate(one.printed.shape()) if case in strict]
    program = compile_program(one.files, tmp_path)
    seen = 0
    for rows, _ in one.rows(count):
        assert mistakes(one, program, rows, bare) == {}
        seen += len(rows)
    assert seen > 0.5 * count


@pytest.mark.parametrize(("name", "count"), COUNTED)
def test_true_transitions_are_decided(name: str, count: int, tmp_path: Path) -> None:
    one = subject(name, sound=True)
    program = compile_program(one.files, tmp_path)
    states = replace(one.states(0), simple=0.0)
    unknown = verdicts(program, states.true(min(count, CHUNK)))[1]
    share = float(unknown.mean())
    print(f"{name}: {share:.4f} unknown")
    assert share < UNKNOWN_SHARE


@pytest.mark.parametrize("real", UNITS)
@pytest.mark.parametrize(("name", "count"), COUNTED)
def test_plain_verdicts_are_off_by_rounding_alone(name: str, count: int, real: str, tmp_path: Path) -> None:
    """Each verdict that differs from what is printed is explained by errors of so many units in the last
    place of the magnitudes of all terms.
    """
    one = subject(name, real)
    program = compile_program(one.files, tmp_path)
    for rows, _ in one.rows(count):
        assert unexplained(one, program, rows) is None


@pytest.mark.parametrize(("name", "count"), COUNTED)
def test_what_is_printed_without_tolerance_is_the_relation(name: str, count: int) -> None:
    one = subject(name, eps=("0",))
    undecided = seen = 0
    for rows, _ in one.rows(count):
        related, told = one.relation.judged(rows), judged(one.printed.by_case(rows))
        clear = (related != UNDECIDED) & (told != UNDECIDED)
        differs = clear & (related != told)
        assert not differs.any(), (related[differs][:2], some(rows, differs, one.printed))
        assert 0.01 < (related == TRUE).mean() < 0.99
        undecided, seen = undecided + int((~clear).sum()), seen + len(rows)
    assert undecided <= UNDECIDED_SHARE * seen


FLIPS = ((r" <= ", " >= "), (r" >= ", " <= "), (r" < ", " > "), (r" > ", " < "), (r" == ", " <= "))
SWAPS = ((r"(is_at_most|is_less)\((\w+), (\w+)\)", r"\1(\3, \2)"), (r"is_equal\(", "is_at_most("))
CONDITION = re.compile(r"\w+_condition_n\d+\([^)]*\)\n\{\n.*?\n\}", re.DOTALL)


def changes(text: str, sound: bool) -> Iterator[str]:
    """A monitor with another comparison in a condition, each in turn."""
    for function in CONDITION.finditer(text):
        for pattern, instead in SWAPS if sound else FLIPS:
            for place in re.finditer(pattern, function[0]):
                start, end = (function.start() + k for k in place.span())
                yield text[:start] + place.expand(instead) + text[end:]


@pytest.mark.parametrize("sound", [False, True])
@pytest.mark.parametrize("name", ["watertank", pytest.param("static_safety_line", marks=pytest.mark.slow)])
def test_a_comparison_other_than_printed_is_noticed(name: str, sound: bool, tmp_path: Path) -> None:
    """Each comparison of the monitor in turn, the other way round."""
    one = subject(name, sound=sound)
    (file,) = (f for f in one.files if f.endswith("_monitor.c"))
    rows, _ = next(one.rows(FEW))
    texts = [one.files[file], *changes(one.files[file], sound)]
    noticed: list[bool] = []
    for k, text in enumerate(texts):
        (tmp_path / str(k)).mkdir()
        program = compile_program(one.files | {file: text}, tmp_path / str(k))
        noticed.append(bool(mistakes(one, program, rows, []) if sound else unexplained(one, program, rows)))
    assert len(texts) > 5 and noticed == [False, *[True] * (len(texts) - 1)]


@pytest.mark.parametrize(
    ("text", "answer"),
    {
        "h^2 = 2": True,
        "h^2 < 0": False,
        "h^2 = 2 & h < -1.5": False,
        "h^2 = 2 & h > 1.4142135623730950": True,
        "h^2 <= 2 & h >= 1.4142135623730951": False,
        "abs(h) + h = 0 & h^2 = 1": True,
        "h / h = 1 & h = 0": False,
        "1 / h > 5 & h >= 0.2": False,
        "1 / h >= 5 & h >= 0.2": True,
        "(h - 1)^2 <= 0 & h != 1": False,
        "h^2 = 2 & 1 / (h - 1) = h + 1": True,
        "h + k = 1 & h^2 + k^2 = 0.5": True,
        "h + k = 1 & h^2 + k^2 < 0.5": False,
        "min(h, 1) > 0 & max(h, -1) < 0 | h = 3": True,
        "h^3 - h = 0.3": None,
        "h^2 + k^2 < 1": None,
    }.items(),
)
def test_whether_a_value_exists(text: str, answer: bool | None) -> None:
    assert satisfiable([read(text)]) is answer
