"""The discrete part in C: guards, inputs and assignments of every path.

Sections, in order: leaf functions (through `Leaves`), `model_guards`, `model_update`, `model_assign`,
and the tables DECISIONS, MASK_START, PATHS, SAME_TESTS, POINT_START, INPUT_LOW, INPUT_HIGH,
CHOICE_DRAW, INPUT_DRAW, FLOW_DRAW.
"""

from dl2c.emit.cexpr import number
from dl2c.emit.cfile import LANES, each_flag, function, place, row, table, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.names import index, lane
from dl2c.emit.plan import BuildPlan
from dl2c.ir.doubles import rounded_down, rounded_up
from dl2c.ir.model import Symbol
from dl2c.ir.printer import print_formula, print_term
from dl2c.paths.admission import Admission
from dl2c.paths.path import Path, Paths

STATE = "const real *x, const real *p"


def path_functions(build: BuildPlan, leaves: Leaves) -> list[str]:
    """What the runtime asks about paths, but for the values of inputs."""
    return [
        _guards(build, leaves),
        _update(build, leaves),
        _assign(build, leaves),
    ]


def _guards(build: BuildPlan, leaves: Leaves) -> str:
    paths = build.paths
    body: list[str] = []
    for point in range(paths.points):
        lines = each_flag(guard_conditions(build, point, leaves))
        body += lines if paths.points == 1 else [f"if (point == {point}) {{", *(f"  {x}" for x in lines), "}"]
    return function(
        f"DL2C_INLINE void model_guards(int point, {LANES}, uint8_t *restrict enabled)",
        body,
        "Which paths of a point pass the tests that no input decides.   enabled: (paths, stride)",
    )


def guard_conditions(build: BuildPlan, point: int, leaves: Leaves) -> list[tuple[str, str]]:
    """Which flag says that a path of a point passes these tests, and when it does."""
    conditions: list[tuple[str, str]] = []
    for k, path in enumerate(build.paths.of(point)):
        about = f"{place(path.span)}  {print_formula(path.guard)}"
        name = f"path{build.paths.paths.index(path)}_guard"
        guard = leaves.derived.in_formula(path.guard)
        conditions.append((f"enabled[{k} * stride + i]", leaves.condition(name, guard, about, lane)))
    return conditions


def _update(build: BuildPlan, leaves: Leaves) -> str:
    body = ["switch (path) {"]
    for k, path in enumerate(build.paths.paths):
        lines = _assignments(k, path, leaves)
        body += [f"case {k}:", *(f"  {line}" for line in lines)]
    body += ["default:", "  return true;", "}"]
    return function(
        f"static inline bool model_update(int path, {STATE}, const real *u, real *y)",
        body,
        "Executes the assignments of a path from x into y. False where a value is undefined.",
    )


def _assignments(k: int, path: Path, leaves: Leaves) -> list[str]:
    lines: list[str] = []
    for variable, term in path.updates:
        target = index(Symbol(variable, "variable"))
        about = f"{place(path.span)}  {variable} := {print_term(term)}"
        lines.append(f"y[{target}] = {leaves.term(f'path{k}_set_{variable}', term, about)};")
    defined = leaves.defined(f"path{k}_defined", [t for _, t in path.updates], "all of these have a value")
    return [*lines, f"return {defined or 'true'};"]


def _selected(target: str, by_value: dict[str, list[int]], paths: int) -> list[str]:
    """An assignment of the value that belongs to the path taken; unchanged where a path sets none."""
    cases = sorted(by_value.items(), key=lambda case: len(case[1]))
    chosen = cases.pop()[0] if sum(map(len, by_value.values())) == paths else target
    for value, taken in cases:
        condition = " | ".join(f"(path == {k})" for k in taken)
        chosen = f"dl2c_select({condition}, {value}, {chosen})"
    return wrapped(f"{target} = {chosen};")


LANE_PATHS = 16
"""With more paths, computing the assignments of all of them costs more than branching."""


def few_paths(build: BuildPlan) -> bool:
    """Whether lanes select among the assignments of all paths."""
    return len(build.paths.paths) <= LANE_PATHS


def alternative_type(paths: Paths) -> str:
    """The narrowest type of C for numbers of paths, alternatives and their orders, in lanes."""
    largest = max((d for path in paths.paths for d in path.decisions), default=0)
    agents = sum(decision.role == "agent" for decision in paths.decisions)
    return "int8_t" if max(len(paths.paths) - 1, largest, 2 * agents + 2) <= 127 else "int16_t"


def decides_in_lanes(build: BuildPlan) -> bool:
    """Whether paths, inputs and assignments of many environments can be computed at once: one point, nothing
    drawn, and every input that is requested where it may be passes its own tests.
    """
    paths = build.paths
    simple = paths.points == 1 and not paths.draws and not paths.looks_ahead and build.monitor is None
    alone = all(a.following is None and not a.solved for path in paths.paths for a in path.admissions)
    return simple and alone and build.model.duration == "max"


def steps_in_lanes(build: BuildPlan) -> bool:
    """Whether whole steps can be made for many environments at once: with one simple flow at most."""
    if not decides_in_lanes(build) or any(plan.quick is None for plan in build.flows):
        return False
    return len({p.flow for p in build.paths.paths}) == 1


LANE_VARIABLES = 32
"""With more variables, what lanes need no longer fits registers and the first cache."""


def flows_in_lanes(build: BuildPlan) -> bool:
    """Whether many environments follow their flow together: every path ends in the same one, which
    `dopri5.h` follows for as long as it may last.
    """
    paths = build.paths
    if [plan.kernel for plan in build.flows] != ["dopri5"] or build.monitor is not None:
        return False
    if len(build.model.variables) > LANE_VARIABLES or build.model.flows[0].reach is not None:
        return False
    simple = paths.points == 1 and not paths.draws and not paths.looks_ahead
    return simple and all(p.flow == 0 for p in paths.paths) and build.model.duration == "max"


def _assign(build: BuildPlan, leaves: Leaves) -> str:
    """All assignments of all paths as selections."""
    body: list[str] = []
    if decides_in_lanes(build) and few_paths(build):
        defined: list[str] = []
        values: dict[str, dict[str, list[int]]] = {}
        for k, path in enumerate(build.paths.paths):
            for variable, term in path.updates:
                value = leaves.term(f"path{k}_set_{variable}", term, "")
                values.setdefault(variable, {}).setdefault(value, []).append(k)
            condition = leaves.defined(f"path{k}_defined", [t for _, t in path.updates], "")
            if condition is not None:
                defined.append(f"((path != {k}) | {condition})")
        for variable, by_value in values.items():
            assigned = f"y[{index(Symbol(variable, 'variable'))}]"
            body += _selected(assigned, by_value, len(build.paths.paths))
            defined.append(f"dl2c_finite({assigned})")
        body += wrapped(f"return {' & '.join(defined) or 'true'};")
    else:
        body.append("return true;")
    return function(
        f"static inline bool model_assign(int64_t path, {STATE}, const real *u, real *y)",
        body,
        "The assignments of a path as selections, from x into its copy y. False where a value is undefined "
        "or not finite.",
    )


def path_tables(build: BuildPlan) -> list[str]:
    """Everything about paths that is data."""
    paths = build.paths
    starts = [0]
    for point in range(paths.points):
        starts.append(starts[-1] + len(paths.of(point)))
    masks = [0]
    for decision in paths.decisions:
        if decision.role == "agent":
            masks.append(masks[-1] + len(decision.alternatives))
    lows = [number(rounded_up(i.low)) for i in paths.inputs]
    highs = [number(rounded_down(i.high)) for i in paths.inputs]
    width = max(1, len(paths.decisions))
    return [
        table("int32_t", "POINT_START", f"[{len(starts)}]", [str(s) for s in starts]),
        table("int32_t", "MASK_START", f"[{len(masks)}]", [str(m) for m in masks]),
        table(
            "int16_t",
            "DECISIONS",
            f"[{max(1, len(paths.paths))}][{width}]",
            [row(p.decisions) for p in paths.paths] or ["{0}"],
        ),
        table("real", "INPUT_LOW", f"[{max(1, len(lows))}]", lows or ["0.0"]),
        table("real", "INPUT_HIGH", f"[{max(1, len(highs))}]", highs or ["0.0"]),
        *_draws(build),
        *(_lists(k, p) for k, p in enumerate(paths.paths)),
        table(
            "dl2c_path",
            "PATHS",
            f"[{max(1, len(paths.paths))}]",
            [_path(k, p) for k, p in enumerate(paths.paths)] or ["{0}"],
        ),
        _same_tests(build),
    ]


def _same_tests(build: BuildPlan) -> str:
    """By path the first one of its point that asks the same of the same inputs. Lanes use it."""
    paths = build.paths.paths
    first: dict[tuple[int, tuple[Admission, ...]], int] = {}
    rows = [first.setdefault((p.point, p.admissions), k) for k, p in enumerate(paths) if few_paths(build)]
    return table("int16_t", "SAME_TESTS", f"[{max(1, len(rows))}]", [str(k) for k in rows] or ["0"])


def _draws(build: BuildPlan) -> list[str]:
    """Where the numbers drawn for each decision, input and flow begin; -1 for none."""
    paths = build.paths
    place: dict[str, int] = {}
    count = 0
    for key, numbers in (*paths.draws, *paths.reset_draws):
        place[key] = count
        count += numbers
    tables = {
        "CHOICE_DRAW": [d.key for d in paths.decisions],
        "INPUT_DRAW": [i.key for i in paths.inputs],
        "FLOW_DRAW": [f"flow_{k}" for k in range(len(build.flows))],
    }
    return [
        table("int32_t", name, f"[{max(1, len(keys))}]", [str(place.get(k, -1)) for k in keys] or ["-1"])
        for name, keys in tables.items()
    ]


def _lists(k: int, path: Path) -> str:
    """The decisions and inputs a path meets."""
    followers = [a.following for a in path.admissions]
    inputs = [
        row(
            (a.input, int(a.is_interval), -1 if a.following is None else a.following, int(j not in followers))
        )
        for j, a in enumerate(path.admissions)
    ]
    return (
        f"static const int16_t PATH{k}_MET[] = {row(path.met)};\n"
        f"static const int16_t PATH{k}_MARKED[] = {row([*map(int, path.marks), 0])};\n"
        f"static const dl2c_input PATH{k}_INPUTS[] = {row(inputs or ['{0}'])};\n"
    )


def _path(k: int, path: Path) -> str:
    flow = -1 if path.flow is None else path.flow
    return (
        f"{{{flow}, {path.target}, {len(path.met)}, PATH{k}_MET, PATH{k}_MARKED, "
        f"{len(path.admissions)}, PATH{k}_INPUTS, {int(path.enters)}}}"
    )
