"""The exported monitor: what the model does satisfies it, what it does not do violates it."""

import csv
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from monitor_program import Program, program_of
from selection import quick_among

from dl2c import cli
from dl2c.commands.monitor import unit_of
from dl2c.diagnostics import CompileError
from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.build import monitor_of
from dl2c.monitor.check import Kind
from dl2c.native.toolchain import EXACT_FLAGS, STRICT_FLAGS
from dl2c.options import Options
from dl2c.pipeline import Compilation, emit
from dl2c.report.trace import replayed, rows_of, unseen
from dl2c.source import Source
from dl2c.training.rollout import rollout

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
QUICK = ("acc", "pendulum")
CLOSED_FORM = {
    "acc",
    "bouncing_ball",
    "etcs",
    "evasion",
    "forced_acceleration",
    "static_safety_line",
    "watertank",
    "waypoint",
}
STEPS = 2000

Rows = list[dict[str, Any]]


@pytest.fixture(scope="module")
def traces(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """`traces(example)` is a file with at least `STEPS` steps of the random masked policy."""
    folder = tmp_path_factory.mktemp("traces")

    def recorded(example: str) -> Path:
        path = folder / f"{example}.csv"
        if not path.exists():
            rows: Rows = []
            while sum(row["step"] > 0 for row in rows) < STEPS:
                rows += rollout("random", f"example:{example}", 6, seed=len(rows))
            written(rows, path)
        return path

    return recorded


def written(rows: Rows, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, tuple(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def read(path: Path) -> Rows:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("example", quick_among(EXAMPLES, QUICK))
def test_steps_of_the_simulator_satisfy_the_monitor(example: str, traces: Any) -> None:
    unit = unit_of(f"example:{example}", {})
    kinds = {check.kind for check in unit.monitor.checks}
    assert kinds == {"init", "controller", "safety"} | ({"model"} if example in CLOSED_FORM else set())
    found, steps = replayed(unit, rows_of(traces(example), unit))
    assert steps >= STEPS
    rows = read(traces(example))
    ends = [v for v in found if v.kind == "safety" and rows[v.row - 1]["status"] == "failure"]
    assert found == ends, found[0]


LIBM = ("cos", "exp", "frexp", "ldexp", "log", "sin", "sqrt", "tan")
OF_LIBM = {f"{name}{end}" for name in LIBM for end in ("", "f")}
FORMS = [(real, sound) for real in ("double", "float") for sound in (False, True)]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("example", quick_among(EXAMPLES, ("pendulum",)))
def test_exported_files_compile_without_warnings(example: str, compiler: str, tmp_path: Path) -> None:
    for real, sound in FORMS:
        unit = unit_of(f"example:{example}", {}, real=real, sound=sound)
        for standard in ("c99", "c11"):
            compiled(unit, tmp_path / f"{real}-{sound}-{standard}", compiler, standard)


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("example", EXAMPLES)
def test_each_kind_compiles_alone(example: str, compiler: str, tmp_path: Path) -> None:
    kinds = [check.kind for check in unit_of(f"example:{example}", {}).monitor.checks]
    for real, sound in FORMS:
        for kind in kinds:
            unit = unit_of(f"example:{example}", {}, (kind,), real=real, sound=sound)
            compiled(unit, tmp_path / f"{real}-{sound}-{kind}", compiler, "c99")


def compiled(unit: Unit, folder: Path, compiler: str, standard: str) -> None:
    """The monitor asks for nothing but functions of libm."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    folder.mkdir()
    for name, text in monitor_files(unit).items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = sorted(p.name for p in folder.glob("*.c"))
    command = [compiler, f"-std={standard}", "-O1", *STRICT_FLAGS, *EXACT_FLAGS, "-c", *sources]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    listed = ["nm", "-u", f"{unit.stem}_monitor.o"]
    wanted = subprocess.run(listed, cwd=folder, capture_output=True, text=True, check=True).stdout.split()
    assert set(wanted) - {"U", "w"} <= OF_LIBM


@pytest.mark.parametrize("example", ["acc", "static_safety_line", "bouncing_ball"])
def test_conditions_are_those_of_the_simulator(example: str) -> None:
    """The expression of every guard and safety predicate without inputs is in the simulator's C too."""
    unit = unit_of(f"example:{example}", {})
    exported = monitor_files(unit)[f"{unit.stem}_monitor.c"].replace(f"{unit.stem}_", "")
    path = REPOSITORY / "examples" / f"{example}.kyx"
    simulator = " ".join(emit(Source.read(path), "c", Options()).split())
    wanted = [c for _, _, c in unit.monitor.conditions if ">=" in c.about or "<" in c.about]
    found = 0
    for condition in wanted:
        head = f"bool condition_n{condition.number}("
        if head in exported and "post" not in exported.split(head)[1].split(")")[0]:
            text = " ".join(exported.split(head)[1].split("return ")[1].split(";")[0].split())
            found += text in simulator
    assert found >= 3


# What is no step of the model ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Program:
    return program_of(unit_of("example:static_safety_line", {}), tmp_path_factory.mktemp("line"))


STATE = {"x": 1.0, "v": 2.0, "a": 0.0, "xo": 60.0, "t": 0.25}
PARAMETERS = {"ep": 0.25, "b": 4.0, "A": 2.0, "gap": 3.0}


def test_every_control_path_is_recognised(line: Program) -> None:
    """With what of its inequalities is left: of the time `t <= ep` here, of the velocity `v >= 0` there."""
    for a in (-4.0, 0.0, 2.0):
        assert line.verdicts("controller", [(STATE, STATE | {"a": a, "t": 0.0}, PARAMETERS)]) == [(0, 0.25)]
    slow = STATE | {"v": 0.125}
    assert line.verdicts("controller", [(slow, slow | {"a": -4.0, "t": 0.0}, PARAMETERS)]) == [(0, 0.125)]


def test_room_shrinks_to_nothing_towards_a_boundary(line: Program) -> None:
    """Far from the obstacle the velocity, 2, has least room; at the distance to stop there is none."""
    most = 1 + 4 / 8
    rows = [(STATE | {"xo": most + off}, PARAMETERS) for off in (2.0, 0.5, 0.25, 0.0, -0.5)]
    found = line.verdicts("safety", rows)
    assert [value for number, value in found if number == 0] == [2.0, 0.5, 0.25]
    assert found[3][1] == -sys.float_info.min and found[4][1] == -0.5


def test_a_violated_condition_is_named_with_its_margin(line: Program) -> None:
    """Accelerating right in front of the obstacle violates the test of that pedal by what is missing."""
    before = STATE | {"xo": 1.75}
    [(number, value)] = line.verdicts("controller", [(before, before | {"a": 2.0, "t": 0.0}, PARAMETERS)])
    condition = next(c for _, _, c in line.unit.monitor.conditions if c.number == number)
    assert condition.span.line == 48 and "A / 2 * ep^2" in condition.about
    assert value == 1.75 - (1 + 4 / 8 + (2 / 4 + 1) * (2 / 2 * 0.25**2 + 0.25 * 2))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e101, -1e101])
def test_no_verdict_is_given_for_numbers_out_of_range(line: Program, bad: float) -> None:
    after = STATE | {"a": -4.0, "t": 0.0}
    checks: list[tuple[Kind, list[dict[str, float]]]] = [
        ("controller", [STATE, after, PARAMETERS]),
        ("model", [STATE, after, PARAMETERS]),
        ("safety", [STATE, PARAMETERS]),
        ("init", [STATE, PARAMETERS]),
    ]
    for kind, parts in checks:
        rows = [
            [*parts[:k], part | {name: bad}, *parts[k + 1 :]] for k, part in enumerate(parts) for name in part
        ]
        for number, value in line.verdicts(kind, rows):
            assert number == 1 and value < 0


def test_denormal_numbers_are_numbers(line: Program) -> None:
    state = STATE | {"v": 5e-324}
    assert line.verdicts("safety", [(state, PARAMETERS), (state | {"v": -5e-324}, PARAMETERS)])[0] == (
        0,
        5e-324,
    )
    assert line.verdicts("safety", [(state | {"v": -5e-324}, PARAMETERS)])[0][0] != 0


def test_parameters_outside_their_bounds_are_refused(line: Program) -> None:
    assert line.verdicts("safety", [(STATE, PARAMETERS | {"ep": 0.51})])[0][0] == 1


@pytest.mark.parametrize("name", ["x", "v", "xo"])
def test_the_controller_may_not_change_what_only_moves(line: Program, name: str) -> None:
    after = STATE | {"a": -4.0, "t": 0.0}
    changed = after | {name: math.nextafter(after[name], math.inf)}
    [(number, value)] = line.verdicts("controller", [(STATE, changed, PARAMETERS)])
    assert number > 1 and value < 0


def test_safety_is_what_is_annotated_and_what_is_proved() -> None:
    """Each condition once: the water tank's predicate is also its postcondition and its invariant."""
    found = {}
    for example in ("acc", "watertank"):
        [check] = unit_of(f"example:{example}", {}, ("safety",)).monitor.checks
        found[example] = [c.about.partition(":")[0] for case in check.cases for c in case.conditions]
    assert found["acc"] == ["apart", *["invariant"] * 4]
    assert found["watertank"] == ["inTank", "inTank"]


# Mutants of whole steps ----------------------------------------------------------------------------

MUTANTS = {
    "x' = v,": "x' = 1.01 * v,",
    "v' = a,": "v' = -a,",
    "{ ?x + stopDist(v) + accComp(v) < xo; a := A; }": "a := A;",
    "a := -b;": "a := -0.99 * b;",
    "& t <= ep}": "& t <= 1.01 * ep}",
}


@pytest.mark.parametrize("mutant", MUTANTS.items(), ids=str)
def test_a_system_that_is_not_the_model_is_caught(mutant: tuple[str, str], tmp_path: Path) -> None:
    text = (REPOSITORY / "examples" / "static_safety_line.kyx").read_text(encoding="utf-8")
    assert mutant[0] in text
    rows: Rows = list(rollout("random", text.replace(*mutant), 6, max_episode_steps=300))
    written(rows, path := tmp_path / "trace.csv")
    unit = unit_of("example:static_safety_line", {}, ("controller", "model"))
    found, _ = replayed(unit, rows_of(path, unit))
    assert found


# The command ---------------------------------------------------------------------------------------


def run(capsys: Any, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["dl2c", *arguments])
    try:
        cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_command_writes_a_complete_folder(capsys: Any, monkeypatch: Any, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    code, out, err = run(capsys, monkeypatch, "monitor", "example:pendulum", "-o", str(folder), "--json")
    assert code == 0 and "no model monitor" in err
    names = ["Pendulum_monitor.c", "Pendulum_monitor.h", "README.md", "conditions.json", "main.c"]
    assert json.loads(out) == {"directory": str(folder), "files": names}
    assert sorted(p.name for p in folder.iterdir()) == names
    assert "sin(" not in (folder / names[0]).read_text(encoding="utf-8")
    assert "(pendulum.kyx:34)" in (folder / names[1]).read_text(encoding="utf-8")


def test_a_tampered_trace_is_reported_with_its_place(
    capsys: Any, monkeypatch: Any, tmp_path: Path, traces: Any
) -> None:
    rows = read(traces("watertank"))[:40]
    rows[30]["u"] = str(float(rows[30]["U"]) * 1.01)
    written(rows, path := tmp_path / "trace.csv")
    arguments = ["monitor", "example:watertank", "--check", str(path)]
    code, out, _ = run(capsys, monkeypatch, *arguments, "--json", "--kind", "controller")
    found = json.loads(out)["violation"]
    assert (code, found["row"], found["step"], found["kind"]) == (1, 31, rows[30]["step"], "controller")
    assert found["where"].startswith("watertank.kyx:")
    code, out, _ = run(capsys, monkeypatch, *arguments)
    assert code == 1 and out.startswith("row 31 (episode ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["example:waypoint"], "nothing to do"),
        (["example:waypoint", "-o", "x", "--kind", "all"], "no kind 'all'"),
        (["example:waypoint", "-o", "x", "--real", "half"], "no kind of number"),
        (["example:waypoint", "-o", "x", "--eps", "speed=1"], "no variable `speed`"),
        (["example:waypoint", "-o", "x", "--eps", "much"], "takes VALUE or NAME=VALUE"),
        (["example:waypoint", "-o", "x", "--eps", "1e99999999"], "takes VALUE or NAME=VALUE"),
        (["example:pendulum", "-o", "x", "--kind", "model"], "no solution polynomial in time"),
    ],
)
def test_mistakes_are_refused(
    capsys: Any, monkeypatch: Any, tmp_path: Path, arguments: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, monkeypatch, "monitor", *arguments)
    assert code != 0 and words in err and not list(tmp_path.iterdir())


# Values that no variable shows ------------------------------------------------------------------------


def program(body: str) -> str:
    return f"ProgramVariables Real x; Real y; End.\nProblem x = 0 & y = 0 -> [{{{body}}}*]y >= 0 End.\n"


def test_an_overwritten_choice_is_eliminated(tmp_path: Path) -> None:
    text = program("x := *; ?1 <= x & x <= 2; y := 2 * x; x := 0;")
    asked = program_of(unit_of(text, {}, ("controller",)), tmp_path)
    start = {"x": 7.0, "y": 7.0}
    rows = [(start, {"x": 0.0, "y": y}, {}) for y in (1.9, 2.0, 3.0, 4.0, 4.1)]
    numbers = [number for number, _ in asked.verdicts("controller", rows)]
    assert [n == 0 for n in numbers] == [False, True, True, True, False]


def test_a_value_that_solves_an_equality_is_met_closely(tmp_path: Path) -> None:
    asked = program_of(unit_of(program("x := *; ?x * x = 2;"), {}, ("controller",)), tmp_path)
    start = {"x": 7.0, "y": 7.0}
    rows = [(start, {"x": x, "y": 7.0}, {}) for x in (math.sqrt(2), -math.sqrt(2), 1.4142)]
    assert [number == 0 for number, _ in asked.verdicts("controller", rows)] == [True, True, False]


def test_choices_that_a_trace_does_not_show_are_named() -> None:
    body = "x := *; ?-1 <= x & x <= 1; {x' = y}"
    model = Compilation(Source("m", program(body)), Options()).unbounded
    [found] = unseen(model, {"x": 0.0, "y": 0.0})
    assert (found.code, found.span.text) == ("not-replayed", "x := *")
    assert "`assign_x`" in found.help and not unseen(model, {"x": 0.0, "y": 0.0, "assign_x": 1.0})


def test_of_what_the_environment_does_first_the_beginning_is_not_seen() -> None:
    text = program("x := *; ?x^2 <= 2; y := *").replace("Real x;", "/* @var: role=env */ Real x;")
    [found] = unseen(Compilation(Source("m", text), Options()).unbounded, {"x": 0.0, "y": 0.0})
    assert (found.code, found.span.text) == ("not-replayed", "x := *")


@pytest.mark.parametrize("role", ["agent", "env"])
def test_a_choice_that_then_moves_is_replayed_from_its_column(role: str, tmp_path: Path) -> None:
    text = program("y := *; ?0 <= y & y <= 1; x := *; ?x^2 <= 2; {x' = 1 + y, y' = 1 & x <= 2}")
    text = text.replace("Real x;", f"/* @var: role={role} */ Real x;")
    rows: Rows = list(rollout("random", text, 3, max_episode_steps=20, default_bound=(-3, 3)))
    unit = unit_of(text, {"default_bound": (-3, 3)}, ("controller",))
    written(rows, tmp_path / "trace.csv")
    trace = rows_of(tmp_path / "trace.csv", unit)
    assert not unseen(unit.monitor.model, trace[0])
    assert replayed(unit, trace) == ([], 60)
    outside = [row | {"assign_x": "1.5"} for row in trace]
    found, steps = replayed(unit, outside)
    assert len(found) == steps and found[0].about == "x_post^2 <= 2"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("x := *; ?x^3 <= 2; y := x^3 - x; x := 0;", "quantifier"),
        ("{?x < 3; x := x + 1;}*; ?!(x < 3); y := x;", "monitor-loop"),
    ],
)
def test_what_has_no_monitor_is_refused_with_its_place(body: str, code: str) -> None:
    model = Compilation(Source("m", program(body)), Options()).unbounded
    with pytest.raises(CompileError) as refused:
        monitor_of(model, ("controller",))
    assert {d.code for d in refused.value.diagnostics} == {code}
    assert all(d.span.source.name == "m" for d in refused.value.diagnostics)
