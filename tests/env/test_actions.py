"""Inputs under tests: every value taken passes, none that passes is missed, masks say which exist."""

import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from differential import Pair, environment_of, pair_of, run_models
from generators.kyx_builder import lowered
from generators.random_inputs import input_test, random_unions
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.admissible_inputs import grid, holds, of
from selection import few_and_many, few_and_many_examples, quick_among

from dl2c.code import cgen_dir
from dl2c.emit.simulator.model_c import model_sources
from dl2c.interp.inputs import Inputs, nearest, spread
from dl2c.interp.straight import planned
from dl2c.ir.evaluate import truth
from dl2c.ir.logic import atoms
from dl2c.ir.model import AssignAny, Symbol, Test
from dl2c.native.binding import Batch
from dl2c.paths.admission import Unresolved

AUDITED = 4000
TINY = Fraction(1, 10**12)


# Five models ------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """Tests of one input `a` between -2 and 2 in a state x, v, o; `passes` says them once more in Python."""

    tests: str
    passes: Callable[[Any, Any, Any, Any], Any]


CASES = {
    "limits": Case("-o <= a & a <= x", lambda x, v, o, a: (-o <= a) & (a <= x)),
    "braking": Case(
        "v + a / 2 >= 0 & x + v^2 / 4 + (a / 2 + 1) * (a / 8 + v / 2) <= o",
        lambda x, v, o, a: (v + a / 2 >= 0) & (x + v * v / 4 + (a / 2 + 1) * (a / 8 + v / 2) <= o),
    ),
    "quadratic": Case(
        "a^2 + v * a <= x & (a - o) * a >= x - 1",
        lambda x, v, o, a: (a * a + v * a <= x) & ((a - o) * a >= x - 1),
    ),
    "obstacle": Case(
        "x + v + a / 2 <= o - 2 | x + v + a / 2 >= o + 2",
        lambda x, v, o, a: (x + v + a / 2 <= o - 2) | (x + v + a / 2 >= o + 2),
    ),
    "kinks": Case(
        "abs(a - x) >= abs(v) & max(a, o) <= 1 & a != x",
        lambda x, v, o, a: (
            (abs(a - x) >= abs(v)) & (np.maximum(a, o) <= 1) & (a != x)
            if isinstance(a, np.ndarray)
            else (abs(a - x) >= abs(v)) & (a <= 1) & (o <= 1) & ((a < x) | (a > x))
        ),
    ),
}
STATE = "Real x;\nReal v;\nReal o;\n/* @var: bound=[-2:2] */\nReal a;\n/* @var: bound=[-4:4] */\nReal r;"


def numbers(rng: Random, count: int, span: int = 3) -> list[float]:
    """Halves, thirds, and anything between."""
    kinds = (
        lambda: rng.randint(-2 * span, 2 * span) / 2,
        lambda: rng.randint(-3 * span, 3 * span) / 3,
        lambda: rng.uniform(-span, span),
    )
    return [rng.choice(kinds)() for _ in range(count)]


def request(pair: Pair, state: list[float], wanted: list[float]) -> tuple[bool, bool, list[float]]:
    """The mask of the first alternative, whether it is taken when asked for, and the values executed."""
    batch = pair.batch
    batch.set_state(0, state, [])
    offered = bool(batch.mask[0, 0])
    batch.choices[0, 0] = 0
    batch.inputs[0, :] = wanted
    batch.step()
    return offered, not batch.blocked[0], batch.executed_inputs[0].tolist()


@pytest.mark.parametrize("count", few_and_many(500, 4000))
@pytest.mark.parametrize("name", CASES)
def test_inputs_taken_pass_and_none_is_missed(count: int, name: str, tmp_path: Path) -> None:
    """The mask offers what has a value, in doubles as in the tests' own words."""
    case = CASES[name]
    pair = pair_of(f"{{a := *; ?({case.tests}); ++ r := 0;}}", tmp_path, STATE)
    rng, seen = Random(name), Counter[str]()
    values = grid(-2.0, 2.0)
    for _ in range(count):
        x, v, o, wanted = numbers(rng, 4)
        passing = values[case.passes(x, v, o, values)]
        offered, taken, executed = request(pair, [x, v, o, 0.0, 0.0], [wanted])
        seen[f"offered {offered}"] += 1
        assert offered == taken
        assert offered or not len(passing), (x, v, o)
        if offered:
            (a,) = executed
            assert -2 <= a <= 2 and case.passes(*map(of, (x, v, o, a))), (x, v, o, a)
            assert abs(a - wanted) <= np.abs(passing - wanted).min(initial=np.inf), (x, v, o, wanted, a)
    assert min(seen["offered True"], seen["offered False"]) >= count / 40


def test_an_equality_decides_a_later_input(tmp_path: Path) -> None:
    """`w := *; r := *; ?r*w = v`: w only where some r is left, then r is the quotient."""
    program = "{a := *; ?(-1 <= a & a <= 1); r := *; ?(r != 0 & r * a = v); ++ x := 0;}"
    pair = pair_of(program, tmp_path, STATE)
    rng, seen = Random(1), Counter[str]()
    values = grid(-1.0, 1.0)
    for _ in range(AUDITED):
        (v,) = numbers(rng, 1, 5)
        wanted = numbers(rng, 2)
        with np.errstate(all="ignore"):
            quotients = v / values
        possible = values == 0.0 if v == 0.0 else (values != 0.0) & (np.abs(quotients) <= 4.0)
        offered, taken, (w, r) = request(pair, [0.0, v, 0.0, 0.0, 0.0], wanted)
        assert offered == taken == possible.any()
        seen[f"offered {offered}"] += 1
        if offered:
            assert -1 <= w <= 1 and -4 <= r <= 4 and r != 0
            assert r == v / w if w != 0 else v == 0 and r == pytest.approx(wanted[1])
            assert abs(w - wanted[0]) <= np.abs(values[possible] - wanted[0]).min()
    assert min(seen.values()) >= AUDITED / 40 and len(seen) == 2


# Any tests --------------------------------------------------------------------


def env_of(rng: Random) -> dict[Symbol, float]:
    x, y, c = numbers(rng, 3)
    return {Symbol("x", "variable"): x, Symbol("y", "variable"): y, Symbol("c", "constant"): abs(c) + 0.5}


LIMITS = {"assign_u": (Fraction(-3), Fraction(3)), "assign_z": (Fraction(-3), Fraction(3))}
U = Symbol("u", "variable")


@few_and_many_examples(75, 300, st.integers(0, 2**32))
def test_values_of_any_test_pass_and_none_is_missed(seed: int) -> None:
    rng = Random(seed)
    formula, env = input_test(rng, "u", ("x", "y")), env_of(rng)
    inputs = Inputs(
        planned((AssignAny("u", "assign_u"), Test(formula)), LIMITS), frozenset(), dict(env), False
    )
    slack = TINY if any(a.op == "=" for a in atoms(formula)) else Fraction(0)
    passing = [g for g in map(float, grid(-3.0, 3.0, 101)) if truth(formula, {**env, U: g})]
    exact = {s: Fraction(v) for s, v in env.items()}  # an equality may hold in doubles by rounding alone
    passing = [g for g in passing if truth(formula, {**exact, U: Fraction(g)})]
    assert inputs.open() or not passing
    for wanted in numbers(rng, 4, 4) if inputs.open() else []:
        taken = float(inputs.nearest("assign_u", wanted))
        at = {s: of(v) for s, v in env.items()} | {U: of(taken)}
        assert -3 <= taken <= 3 and holds(formula, at, slack), (formula, env, wanted, taken)
        missed = [g for g in passing if abs(g - wanted) < abs(taken - wanted) - float(slack)]
        assert not missed, (formula, env, wanted, taken, missed)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32))
def test_exact_values_are_near_those_in_doubles(seed: int) -> None:
    rng = Random(seed)
    formula = input_test(rng, "u", ("x", "y"))
    line = (AssignAny("u", "assign_u"), Test(formula))
    env = {s: Fraction(round(4 * v), 4) for s, v in env_of(rng).items()}
    plan = planned(line, LIMITS)
    exact = Inputs(plan, frozenset(), dict(env), True)
    near = Inputs(plan, frozenset(), {s: float(v) for s, v in env.items()}, False)
    if exact.open() and near.open():
        for wanted in numbers(rng, 3, 4):
            a, b = exact.nearest("assign_u", Fraction(wanted)), near.nearest("assign_u", wanted)
            assert truth(formula, {**env, U: a}, True) or any(a.op == "=" for a in atoms(formula))
            assert abs(abs(float(a) - wanted) - abs(float(b) - wanted)) < 1e-7, (formula, env, wanted, a, b)


@few_and_many_examples(20, 100, st.integers(0, 2**32))
def test_an_earlier_input_leaves_a_value_for_a_later_one(seed: int) -> None:
    rng = Random(seed)
    formula, env = input_test(rng, "z", ("u", "x"), 1), env_of(rng)
    line = (AssignAny("u", "assign_u"), AssignAny("z", "assign_z"), Test(formula))
    try:
        plan = planned(line, LIMITS)
    except Unresolved:
        return
    inputs = Inputs(plan, frozenset(), dict(env), False)
    slack = TINY if any(a.op == "=" for a in atoms(formula)) else Fraction(0)
    values = [float(g) for g in grid(-3.0, 3.0, 25)]
    passing = {u for u in values for z in values if truth(formula, {**env, U: u, Symbol("z", "variable"): z})}
    assert inputs.open() or not passing
    for wanted in numbers(rng, 2, 4) if inputs.open() else []:
        u, z = inputs.nearest("assign_u", wanted), inputs.nearest("assign_z", wanted)
        if 0 < abs(u) < 1e-300:
            continue  # next to an excluded zero a root is rounded to few digits
        at = {**env, U: float(u), Symbol("z", "variable"): float(z)}
        assert holds(formula, {s: of(v) for s, v in at.items()}, slack), (formula, at)
        missed = [g for g in passing if abs(g - wanted) < abs(float(u) - wanted) - float(slack)]
        assert not missed, (formula, env, wanted, u, missed)


@pytest.mark.parametrize("seeds", few_and_many((2, 4, 11, 14), range(16)))
def test_interpreter_and_compiled_code_agree_on_tests_of_inputs(seeds: Sequence[int], tmp_path: Path) -> None:
    pairs, seen = run_models(seeds, 8, tmp_path, random_unions, episodes=True)
    admissions = [a for pair in pairs for p in pair.environment.paths.paths for a in p.admissions]
    assert sum(not a.is_interval for a in admissions) >= 5 / 8 * len(seeds)
    assert any(a.following is not None for a in admissions) and any(a.solved for a in admissions)
    assert min(seen["steps"], seen["blocked"]) > 0


JOINED = {
    "a loop": "{?x > 0; v := *; o := *; ?(0 <= o & o <= 1 & v + o >= 1/2); x := x - o - 1/2;}* ?x <= 0;",
    "three inputs": "v := *; o := *; ?(v^2 + o^2 <= 1 & v + o >= x); x := *; ?(x + o <= v & abs(x) <= 4);",
    "a flow between": "{v := *; ?v^2 >= 1/4; {x' = v} ++ v := 0;} o := *; ?(o * v = x / 4 | o <= -1);",
}


@pytest.mark.parametrize("name", quick_among(JOINED, ("a loop", "a flow between")))
def test_joined_inputs_agree_wherever_they_stand(name: str, tmp_path: Path) -> None:
    limits = {"x": "-5:5", "v": "-1:1", "o": "-2:2"}
    bounds = (f"/* @var: bound=[{limits[n]}] */\nReal {n};" for n in limits)
    pair = pair_of(JOINED[name], tmp_path, "\n".join(bounds))
    rng = Random(name)
    for _ in range(60):
        state = dict(zip("xvo", numbers(rng, 3), strict=True))
        pair.step_from(state, {}, *pair.actions(rng))
    assert any(a.following is not None for p in pair.environment.paths.paths for a in p.admissions) == (
        name != "a flow between"
    )


@pytest.mark.slow
def test_interpreter_and_compiled_code_agree_on_many_tests_of_inputs(tmp_path: Path) -> None:
    run_models(range(1000, 1200), 10, tmp_path, random_unions, episodes=True)


# What is done with pieces -----------------------------------------------------

UNION = "/* @var: bound=[-2:3] */\nReal a;\nReal x;"


def test_requests_go_to_the_nearest_piece() -> None:
    pieces = [(-2.0, -1.0), (0.5, 0.5), (1.0, 3.0)]
    taken = [nearest(pieces, w)[1] for w in (-9, -1.5, -0.25, -0.2, 0.7, 0.75, 0.76, 2.0, 9.0, float("nan"))]
    assert taken == [-2.0, -1.5, -1.0, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0, -2.0]


def test_single_values_have_no_length() -> None:
    pieces = [(-2.0, -1.0), (0.5, 0.5), (1.0, 3.0)]
    assert [spread(pieces, t)[1] for t in (0.0, 0.25, 0.5, 1.0)] == [-2.0, -1.25, 1.5, 3.0]
    points = [(-1.0, -1.0), (2.0, 2.0)]
    assert [spread(points, t)[1] for t in (0.0, 0.49, 0.5, 1.0)] == [-1.0, -1.0, 2.0, 2.0]


def test_a_request_that_is_no_number_takes_the_lowest_value(tmp_path: Path) -> None:
    pair = pair_of("a := *; ?(a <= -1 | a >= 1); x := a;", tmp_path, UNION)
    pair.batch.set_state(0, [0.0, 0.0], [])
    pair.batch.inputs[0, 0] = float("nan")
    pair.batch.step()
    assert pair.batch.executed_inputs[0, 0] == -2.0


@pytest.mark.parametrize(
    ("tests", "expected"),
    [
        ("(a <= -1 | a >= 1)", lambda t: -2 + 3 * t if 3 * t <= 1 else 3 * t),
        ("(a = -1 | a = 2 | a^2 = 2)", lambda t: (-(2**0.5), -1, 2**0.5, 2)[min(int(4 * t), 3)]),
    ],
)
def test_a_squashed_action_runs_over_all_pieces(
    tests: str, expected: Callable[[float], float], tmp_path: Path
) -> None:
    pair = pair_of(f"a := *; ?{tests}; x := a;", tmp_path, UNION)
    pair.batch = pair.library.batch(1, action_map="squash", max_steps=0)
    for t in np.linspace(0, 1, 41):
        pair.batch.set_state(0, [0.0, 0.0], [])
        pair.batch.inputs[0, 0] = 2 * t - 1
        pair.batch.step()
        _, x = pair.batch.get_state(0)[0].tolist()
        assert x == pytest.approx(expected(float(t)))
        encoded = float(pair.batch.executed_inputs[0, 0])
        pair.batch.inputs[0, 0] = encoded
        pair.batch.step()
        assert pair.batch.get_state(0)[0].tolist()[1] == pytest.approx(x, abs=1e-12)
        assert encoded == pytest.approx(2 * t - 1) or "=" in tests.replace("<=", "").replace(">=", "")


def test_what_the_environment_draws_is_uniform_over_all_pieces(tmp_path: Path) -> None:
    """chi^2 over bins of equal length in both pieces; 99.9 % of uniform samples give less."""
    variables = "Real x;\n/* @var: role=env, bound=[-2:3] */\nReal w;"
    pair = pair_of("w := *; ?(w <= -1 | w >= 1); x := w;", tmp_path, variables)
    pair.batch.reset_to(0, 3, [0.0, 2.0], [])
    drawn: list[float] = []
    for _ in range(3000):
        pair.batch.step()
        drawn.append(float(pair.batch.drawn_inputs[0, 0]))
    counts, _ = np.histogram(drawn, [-2, -1.5, -1, 1, 1.5, 2, 2.5, 3])
    assert counts[2] == 0 and counts.sum() == 3000
    assert ((np.delete(counts, 2) - 500) ** 2 / 500).sum() < 20.5


# What it costs ----------------------------------------------------------------

COSTS = {
    "bare": "a := *; v := a;",
    "limits": "a := *; ?-2 <= a & a <= x; v := a;",
    "square": "a := *; ?a^2 + v * a <= x + 1; v := a;",
    "obstacle": f"a := *; ?{CASES['obstacle'].tests}; v := a;",
    "joint": "a := *; ?(-1 <= a & a <= 1); r := *; ?(r != 0 & r * a = x); v := a;",
}


@pytest.mark.slow
def test_a_test_costs_a_few_times_a_bare_input(tmp_path: Path) -> None:
    """Nanoseconds for mask and request together (tests/bench/resolve_inputs.c), all in one run; beside them
    those of a function that only clips."""
    least = dict.fromkeys(COSTS, float("inf"))
    clip = float("inf")
    programs = {name: resolving_program(name, text, tmp_path) for name, text in COSTS.items()}
    for _ in range(5):
        for name, program in programs.items():
            done = subprocess.run([program], capture_output=True, text=True, check=True)
            resolved, clipped = map(float, done.stdout.split()[:2])
            least[name], clip = min(least[name], resolved), min(clip, clipped)
    for name, time in least.items():
        print(f"{name}: {time:.1f} ns, {time / least['bare']:.1f} x bare, {time / clip:.1f} x a C function")
    assert least["limits"] <= 5 * least["bare"]
    assert least["square"] <= 10 * least["bare"]


@pytest.mark.slow
def test_a_step_with_a_test_costs_a_few_times_one_with_a_bare_input(tmp_path: Path) -> None:
    """Whole steps of a batch; the least of many, in turn."""
    rng, count = np.random.default_rng(0), 4096
    batches: dict[str, Batch] = {}
    for name in ("bare", "limits", "square"):
        (tmp_path / name).mkdir()
        batches[name] = pair_of(COSTS[name], tmp_path / name, STATE).library.batch(count, max_steps=0)
        for i in range(count):
            batches[name].set_state(i, (4 * rng.random(5) - 1).tolist(), [])
        batches[name].inputs[:] = 6 * rng.random(batches[name].inputs.shape) - 3
    least = dict.fromkeys(batches, float("inf"))
    for _ in range(200):
        for name, batch in batches.items():
            begun = perf_counter()
            batch.step()
            least[name] = min(least[name], perf_counter() - begun)
    print({name: f"{1e9 * t / count:.1f} ns, {t / least['bare']:.1f} x" for name, t in least.items()})
    assert least["limits"] <= 5 * least["bare"]
    assert least["square"] <= 10 * least["bare"]


def resolving_program(name: str, text: str, folder: Path) -> Path:
    model = lowered(f"true -> [{{{text}}}*] x > -99", "", STATE)
    environment = environment_of(replace(model, name=f"{name}cost"))
    assert environment is not None
    for file, source in model_sources(environment).items():
        (folder / file).write_text(source, encoding="utf-8")
    cgen, main = cgen_dir(), Path(__file__).parents[1] / "bench" / "resolve_inputs.c"
    folders = [f"-I{cgen / 'include'}", f"-I{cgen / 'runtime'}", f"-I{folder}"]
    flags = ["-O2", "-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno", "-DDL2C_NO_TARGET_CLONES"]
    command = ["cc", "-std=c11", *flags, *folders, f'-DMODEL="{name}cost.c"', "-o", str(folder / name)]
    subprocess.run([*command, str(main), "-lm"], check=True)
    return folder / name
