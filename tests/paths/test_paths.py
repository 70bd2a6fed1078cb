"""Guarded paths do what the program does, statement by statement; inputs have the limits that tests imply."""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from random import Random

import pytest
from generators.kyx_builder import codes, lowered, paths_of
from generators.random_models import random_model, random_state
from hypothesis import strategies as st
from selection import few_and_many_examples

from dl2c.diagnostics import CompileError
from dl2c.ir.evaluate import Undefined, Value, evaluate, truth
from dl2c.ir.model import Assign, AssignAny, Block, Choice, Evolve, If, Model, Symbol, Term, Test
from dl2c.ir.printer import print_formula, print_term
from dl2c.paths import enumerate as enumeration
from dl2c.paths.enumerate import enumerate_paths
from dl2c.paths.path import END, Path, Paths
from dl2c.paths.printer import print_paths

State = dict[Symbol, Value | None]

# Paths against sequential execution -------------------------------------------


class Blocked(Exception):
    """A test failed."""


def execute(
    model: Model, block: Block, state: State, choices: dict[str, int], inputs: dict[str, float]
) -> tuple[int | None, Block]:
    """Run a block in place, statement by statement, up to its first flow: the flow, and what is left."""
    for k, statement in enumerate(block):
        rest = block[k + 1 :]
        match statement:
            case Assign(variable, term):
                state[Symbol(variable, "variable")] = value(term, state)
            case AssignAny(variable, key):
                state[Symbol(variable, "variable")] = inputs[key]
            case Test(formula):
                if not truth(formula, state):
                    raise Blocked
            case If(condition, otherwise, then, orelse):
                if not truth(condition, state) and not truth(otherwise, state):
                    raise Blocked
                return execute(
                    model, (then if truth(condition, state) else orelse) + rest, state, choices, inputs
                )
            case Choice(key, alternatives):
                return execute(model, alternatives[choices[key]].body + rest, state, choices, inputs)
            case Evolve(flow):
                if not truth(model.flows[flow].domain, state):
                    raise Blocked
                return flow, rest
    return None, ()


def value(term: Term, state: State) -> Value | None:
    try:
        return evaluate(term, state)
    except Undefined:
        return None


def passing(
    paths: Paths, point: int, state: State, choices: dict[str, int], inputs: dict[str, float]
) -> list[Path]:
    """The paths from a point that these decisions take and whose tests all hold."""
    here = state | {Symbol(key, "input"): number for key, number in inputs.items()}
    return [
        path
        for path in paths.of(point)
        if all(a in (-1, choices[d.key]) for d, a in zip(paths.decisions, path.decisions, strict=True))
        and truth(path.guard, here)
        and all(truth(a.tests, here) for a in path.admissions)
    ]


def assert_paths_agree(model: Model, paths: Paths, rng: Random) -> None:
    """One random step: at every point at most one path passes, and it does what execution does."""
    variables, constants = random_state(rng)
    state: State = {Symbol(n, "variable"): v for n, v in variables.items()}
    state |= {Symbol(n, "constant"): v for n, v in constants.items()}
    choices = {d.key: rng.randrange(len(d.alternatives)) for d in paths.decisions}
    inputs = {i.key: rng.choice((rng.uniform(-3, 3), float(rng.randint(-3, 3)))) for i in paths.inputs}
    point, block = 0, model.body
    while True:
        found = passing(paths, point, state, choices, inputs)
        before = state | {Symbol(key, "input"): number for key, number in inputs.items()}
        try:
            flow, block = execute(model, block, state, choices, inputs)
        except Blocked:
            assert found == []
            return
        (path,) = found
        assert path.flow == flow
        moved = {**before, **{Symbol(x, "variable"): value(term, before) for x, term in path.updates}}
        assert {s: moved[s] for s in state} == state
        assert (path.target == END) == (block == ())
        if path.target == END:
            return
        point = path.target
        state |= {Symbol(x, "variable"): rng.uniform(-3, 3) for x in variables}


@few_and_many_examples(15, 60, st.integers(0, 10**6))
def test_paths_agree_with_sequential_execution(seed: int) -> None:
    model, rng = random_model(seed), Random(seed)
    try:
        paths = enumerate_paths(model)
    except CompileError as refused:
        assert set(codes(refused)) <= {"unresolved-test", "unbounded-input", "too-many-paths"}
        return
    for _ in range(10):
        assert_paths_agree(model, paths, rng)


WALK = """
  /* @const: bound=[1:2] */ Real A;
  HP turn ::= { { v := A; ++ ?x > 0; v := -A; ++ if (x > 1) { v := 0; } else { v := v / x; } } };
"""


def test_paths_agree_on_a_program_written_out() -> None:
    program = (
        "turn; x := x + v; { ?v > 0; turn; ++ x := *; ?-1 <= x & x <= v & x <= 3; }"
        " t := 0; {x' = v, t' = 1 & t <= A} x := x^2; turn;"
    )
    model = lowered(f"true -> [{{{program}}}*] x > 0", WALK, "Real x; Real v; Real t;")
    paths = enumerate_paths(model)
    names = ("x", "v", "t")
    for x, v, alternatives, u in product(
        (-1.0, 0.0, 0.5, 2.0), (-1.0, 1.0), product(range(3), range(2), range(3), range(3)), (-0.5, 0.5)
    ):
        state: State = {Symbol(n, "variable"): number for n, number in zip(names, (x, v, 0.0), strict=True)}
        state[Symbol("A", "constant")] = 1.5
        choices = {f"choice_{k}": a for k, a in enumerate(alternatives)}
        found = passing(paths, 0, dict(state), choices, {"assign_x": u})
        try:
            flow, rest = execute(model, model.body, after := dict(state), choices, {"assign_x": u})
        except Blocked:
            assert found == []
            continue
        (path,) = found
        here = state | {Symbol("assign_x", "input"): u}
        assert (path.flow, path.target) == (flow, 1) and rest
        assert {s.name: after[s] for s in after if s.kind == "variable"} == {
            n: state[Symbol(n, "variable")] for n in names
        } | {n: value(term, here) for n, term in path.updates}


# What paths look like ---------------------------------------------------------


def test_assignments_are_substituted_into_guards_and_updates() -> None:
    (path,) = paths_of("true -> [{x := x + v; ?x > 1; v := x * x; x := v;}*] x > 0").paths
    assert print_formula(path.guard) == "x + v > 1"
    assert [(x, print_term(t)) for x, t in path.updates] == [
        ("x", "(x + v) * (x + v)"),
        ("v", "(x + v) * (x + v)"),
    ]


def test_a_variable_that_keeps_its_value_is_not_updated() -> None:
    (path,) = paths_of("true -> [{x := x; v := 1;}*] x > 0").paths
    assert [x for x, _ in path.updates] == ["v"]


def test_the_domain_is_tested_where_its_flow_starts() -> None:
    (path,) = paths_of("true -> [{v := -1; {x' = v & x >= v}}*] x > 0").paths
    assert print_formula(path.guard) == "x >= -1"


def test_branches_add_their_tests_to_guards() -> None:
    found = paths_of("true -> [{if (x > 0) { v := 1; } else { v := 2; }}*] x > 0").paths
    assert [print_formula(p.guard) for p in found] == ["x > 0", "x <= 0"]
    assert all(p.decisions == () and p.met == () for p in found)


def test_a_decision_that_is_not_met_is_minus_one() -> None:
    paths = paths_of("true -> [{{x := 1; ++ {v := 1; ++ v := 2; ++ v := 3;} x := 2;}}*] x > 0")
    assert [p.decisions for p in paths.paths] == [(0, -1), (1, 0), (1, 1), (1, 2)]
    assert [p.met for p in paths.paths] == [(0,), (0, 1), (0, 1), (0, 1)]
    assert paths.runs == ((0, -1), (1, 0), (1, 1), (1, 2))


def test_paths_that_no_state_can_take_are_dropped() -> None:
    assert len(paths_of("true -> [{?1 > 2; x := 1; ++ x := 2; ++ ?false;}*] x > 0").paths) == 1
    twice = "if (x > 0) {v := 1;} else {v := 2;} if (0 < x & v > 0) {v := 3;} else {v := 4;}"
    found = paths_of(f"true -> [{{{twice} ?0 < x | v > 3;}}*] x > 0").paths
    assert [print_formula(p.guard) for p in found] == ["x > 0", "x <= 0"]


def test_a_flow_in_the_middle_is_a_point() -> None:
    paths = paths_of("true -> [{{x := 1; ++ x := 2;} {x' = 1} {v := 1; ++ v := 2;}}*] x > 0")
    assert paths.points == 2
    assert [(p.point, p.target) for p in paths.paths] == [(0, 1), (0, 1), (1, END), (1, END)]


def test_the_same_rest_is_one_point() -> None:
    paths = paths_of("true -> [{{x := 1; {x' = 1} ++ x := 2; {x' = 2}} v := x;}*] x > 0")
    assert paths.points == 2 and len(paths.of(1)) == 1


def test_alternatives_are_shown_as_written() -> None:
    paths = paths_of("true -> [{{x := 1; ++ v := x\n  + 1;}}*] x > 0")
    assert paths.decisions[0].alternatives == ("x := 1", "v := x + 1")
    assert print_paths(paths).startswith(
        "choice_0 (agent)\n  0: x := 1\n  1: v := x + 1\n\npath 0 from point 0 to end when choice_0=0\n"
    )


def test_too_many_paths_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(enumeration, "MAX_PATHS", 8)
    three = "{x := 1; ++ x := 2;}" * 3
    assert len(paths_of(f"true -> [{{{three}}}*] x > 0").paths) == 8
    for more in (three + "{x := 1; ++ x := 2;}", three + "{x := 1; ++ ?false;}"):
        with pytest.raises(CompileError) as refused:
            paths_of(f"true -> [{{{more}}}*] x > 0")
        assert codes(refused.value) == ["too-many-paths"]


def test_values_that_grow_without_measure_are_refused() -> None:
    doubling = "x := x * x; v := v + x;" * 20
    with pytest.raises(CompileError) as refused:
        paths_of(f"true -> [{{{doubling}}}*] x > 0")
    assert codes(refused.value) == ["too-large"]


# Inputs -----------------------------------------------------------------------


def limits(
    program: str, variable: str = "Real a;", definitions: str = "/* @const: bound=[0.1:5] */\nReal A;"
) -> tuple[Fraction, Fraction]:
    (found,) = paths_of(f"true -> [{{{program}}}*] x > 0", definitions, f"Real x;\n{variable}").inputs
    return found.low, found.high


BOUNDED = "/* @var: bound=[-0.1:0.3] */\nReal a;"


@pytest.mark.parametrize(
    ("program", "variable", "low", "high"),
    [
        ("a := *; ?-1 <= a & a <= 2;", "Real a;", -1, 2),
        ("a := *; ?-A <= a; ?a < A;", "Real a;", -5, 5),
        ("a := *; ?-1 <= 2 * a & 2 * a + 1 <= 5;", "Real a;", Fraction(-1, 2), 2),
        ("a := *;", BOUNDED, Fraction(-1, 10), Fraction(3, 10)),
        ("a := *; ?a <= 0.25;", BOUNDED, Fraction(-1, 10), Fraction(1, 4)),
        ("a := *; ?-7 <= a & a <= 7;", BOUNDED, Fraction(-1, 10), Fraction(3, 10)),
        ("a := *; ?a <= x;", BOUNDED, Fraction(-1, 10), Fraction(3, 10)),
        ("a := *; {?0 <= a & a <= 1; ++ ?2 <= a & a <= 3;}", "Real a;", 0, 3),
        ("a := *; {x' = a & -2 <= a & a <= 1}", "Real a;", -2, 1),
    ],
)
def test_limits_are_what_bound_and_tests_imply(
    program: str, variable: str, low: Fraction, high: Fraction
) -> None:
    found = limits(program, variable)
    assert found[0] <= low and high <= found[1]
    assert (float(found[0]), float(found[1])) == (pytest.approx(float(low)), pytest.approx(float(high)))


@pytest.mark.parametrize("program", ["a := *;", "a := *; ?a <= 1;", "a := *; ?x <= a & a <= x + 1;"])
def test_an_input_without_limits_is_refused(program: str) -> None:
    with pytest.raises(CompileError) as refused:
        limits(program)
    assert codes(refused.value) == ["unbounded-input"]


def test_a_declared_bound_stays_exact() -> None:
    assert limits("a := *; ?a <= x;", BOUNDED) == (Fraction(-1, 10), Fraction(3, 10))
    low, _ = limits("a := *; ?-0.1 <= a;", BOUNDED)
    assert low == Fraction(-1, 10)


def test_limits_hold_for_every_value_that_passes() -> None:
    """The Box contains every admissible value, for all constants and states."""
    definitions = "/* @const: bound=[0.3:0.7] */\nReal A;"
    low, high = limits("a := *; ?-A <= 3 * a & a <= A^2 + 0.1;", definitions=definitions)
    assert low <= -Fraction(7, 10) / 3 and high >= Fraction(49, 100) + Fraction(1, 10)


def test_tests_of_an_input_are_limits_over_the_state() -> None:
    (path,) = paths_of(
        "true -> [{v := x; a := *; v := a + v; ?v <= 3 & -1 <= a & x > 0;}*] x > 0",
        "",
        "Real x; Real v;\n/* @var: bound=[-1:9] */\nReal a;",
    ).paths
    (admission,) = path.admissions
    assert print_formula(path.guard) == "x > 0"
    assert print_formula(admission.tests) == "assign_a + x <= 3 & -1 <= assign_a"
    assert [(print_term(m.offset), print_term(m.slope)) for m in admission.limits] == [
        ("3 - x", "-1"),
        ("1", "1"),
    ]


UNRESOLVED = {
    "a cube of two inputs": "a^3 * x <= 1",
    "a high power": "a^13 <= 1",
    "a function": "sin(a) <= 1/2",
    "a root": "x > 0 | sqrt(a) <= 1",
}
RESOLVED = {
    "a cube": "a^3 <= 1",
    "a condition of degree 4 for an earlier input": "a^2 + x^2 <= 1 & 50*a*x >= 1",
    "a disjunction": "a <= 1 | a >= 2",
    "two inputs": "a + x <= 1",
    "a square": "a^2 <= 1",
    "an equality": "8*a*x = 1",
    "an inequality": "a != 1",
    "a quotient": "1/a <= 1",
    "kinks": "abs(a - x) <= min(1, 2*a)",
}


def inputs_of(test: str) -> Paths:
    program = f"x := *; ?0 <= x & x <= 1; a := *; ?{test};"
    return paths_of(f"true -> [{{{program}}}*] x > 0", "", f"Real x;\n{BOUNDED}")


@pytest.mark.parametrize("kind", UNRESOLVED)
def test_tests_of_too_high_a_degree_are_refused(kind: str) -> None:
    with pytest.raises(CompileError) as refused:
        inputs_of(UNRESOLVED[kind])
    assert codes(refused.value) == ["unresolved-test"]


@pytest.mark.parametrize("kind", RESOLVED)
def test_other_tests_have_a_union_of_intervals(kind: str) -> None:
    (path,) = inputs_of(RESOLVED[kind]).paths
    first, second = path.admissions
    joined = "x" in RESOLVED[kind]
    assert first.following == (1 if joined else None)
    assert second.criticals or second.is_interval
    assert bool(second.solved) == (kind == "an equality")


def test_an_earlier_input_changes_where_a_later_one_loses_its_last_value() -> None:
    """`8*a*x = 1` has a root in a unless x is 0, and one between 1/8 and 0.3 up to where it is an end."""
    (path,) = inputs_of("8*a*x = 1").paths
    shown = {tuple(print_term(c) for c in p) for p in path.admissions[0].criticals}
    assert {("0", "1"), ("-1", "1"), ("-1", "2.4")} <= shown


def test_paths_are_a_function_of_the_model() -> None:
    model = random_model(7)
    assert enumerate_paths(model) == enumerate_paths(replace(model))
