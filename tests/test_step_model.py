"""What surrounds the program of a step: flows, constants, initial values, predicates, the episode."""

from fractions import Fraction

import pytest
from generators.kyx_builder import codes, lowered, model_text

from dl2c.diagnostics import CompileError
from dl2c.ir.evaluate import evaluate
from dl2c.ir.model import UNBOUNDED, Bound, Flow, Trigger
from dl2c.ir.printer import print_formula, print_term

# Flows ------------------------------------------------------------------------


def flow(ode: str, options: dict[str, object] | None = None) -> Flow:
    (found,) = lowered(
        f"true -> [{{{{{ode}}}}}*] x > 0",
        "Real e; Real d = 2;",
        "Real x; Real v; Real t; Real s;",
        options={"constants": {"e": 1}, **(options or {})},
    ).flows
    return found


@pytest.mark.parametrize(
    ("ode", "horizons", "watched"),
    [
        ("x' = v, t' = 1 & t <= e", ["t <= e"], "true"),
        ("x' = v, t' = 1 & e >= t", ["t <= e"], "true"),
        ("x' = v, t' = 1 & !(t > e)", ["t <= e"], "true"),
        ("x' = v, t' = 1 & t <= e & v >= 0", ["t <= e"], "v >= 0"),
        ("x' = v, t' = 1 & (v >= 0 & (x >= 0 & t <= s + v^2))", ["t <= s + v^2"], "v >= 0 & x >= 0"),
        ("x' = v, t' = 1, s' = 3/3 & t <= e & s <= d", ["t <= e", "s <= 2"], "true"),
        ("x' = v, v' = 0, t' = 1 & t <= v", ["t <= v"], "true"),
        ("x' = v, t' = 1 & (t <= e | x > 0)", [], "t <= e | x > 0"),
        ("x' = v, t' = 1 & t < e", [], "t < e"),
        ("x' = v, t' = 2 & t <= e", [], "t <= e"),
        ("x' = v, t' = 1 & t <= x", [], "t <= x"),
        ("x' = v, t' = 1 & 2 * t <= e", [], "2 * t <= e"),
        ("x' = v", [], "true"),
    ],
)
def test_horizons_are_clocks_under_conjunctions(ode: str, horizons: list[str], watched: str) -> None:
    found = flow(ode)
    assert [f"{h.clock} <= {print_term(h.bound)}" for h in found.horizons] == horizons
    assert print_formula(found.watched) == watched
    assert (found.cap is None) == bool(horizons)


def test_without_a_clock_a_flow_lasts_a_tenth_of_a_second() -> None:
    assert flow("x' = v").cap == Fraction(1, 10)


def test_an_explicit_dt_is_a_further_cap() -> None:
    assert flow("x' = v", {"dt": "0.05"}).cap == Fraction(1, 20)
    clocked = flow("x' = v, t' = 1 & t <= e", {"dt": 3})
    assert clocked.cap == 3 and len(clocked.horizons) == 1


# Constants and variables ------------------------------------------------------


def test_a_constant_is_bounded_or_fixed() -> None:
    definitions = "/* @const: bound=[1:2] */ Real a;"
    (sampled,) = lowered("true -> [x := a;] x > 0", definitions).constants
    assert (sampled.bound, sampled.value) == (Bound(Fraction(1), Fraction(2)), None)
    model = lowered("true -> [x := a;] x > 0", definitions, options={"constants": {"a": "1.5"}})
    assert model.constants[0].value == Fraction(3, 2)
    assert "a" not in model.sampled


def test_a_constant_in_the_assumptions_may_be_unbounded_so_far() -> None:
    (constant,) = lowered("a = 3 -> [x := a;] x > 0", "Real a;").constants
    assert constant.bound == UNBOUNDED


@pytest.mark.parametrize(
    ("definitions", "constants", "code"),
    [
        ("Real a;", {}, "constant-without-value"),
        ("/* @const: bound=[0:inf] */ Real a;", {}, "constant-without-value"),
        ("Real a = 1;", {"a": 2}, "unknown-constant"),
        ("Real a = 1;", {"x": 2}, "unknown-constant"),
        ("Real a = 1;", {"b": 2}, "unknown-constant"),
    ],
)
def test_constants_that_mean_nothing_are_refused(
    definitions: str, constants: dict[str, int], code: str
) -> None:
    with pytest.raises(CompileError) as refused:
        lowered("true -> [x := a;] x > 0", definitions, options={"constants": constants})
    assert codes(refused.value) == [code]


@pytest.mark.parametrize(
    ("program", "initial"),
    [
        ("t := 0; x := t;", "zero"),
        ("x := t; t := 0;", "sampled"),
        ("{t := 0; ++ t := 1;} x := t;", "zero"),
        ("{t := 0; ++ x := 1;}", "sampled"),
        ("{t := 0; ++ x := 1;} x := t;", "sampled"),
        ("t := *; ?t < 1 & t > 0; x := t;", "zero"),
        ("?t > 0; t := 0;", "sampled"),
        ("{t' = 1 & t <= 1}", "sampled"),
        ("t := 0; {t' = 1 & t <= 1}", "zero"),
        ("{x' = t}", "sampled"),
        ("if (x > 0) {t := 1;} else {t := 2;} x := t;", "zero"),
        ("if (x > 0) {t := 1;}", "sampled"),
        ("x := 1;", "sampled"),
    ],
)
def test_a_variable_starts_at_zero_only_if_every_path_overwrites_it(program: str, initial: str) -> None:
    model = lowered(f"x = 0 -> [{{{program}}}*] x > 0", "", "Real x; Real t;")
    assert {v.name: v.initial for v in model.variables} == {"x": "sampled", "t": initial}


def test_a_bounded_or_assumed_variable_is_sampled() -> None:
    bounded = lowered("true -> [{t := 0;}*] t = 0", "", "/* @var: bound=[0:1] */\nReal t;")
    assumed = lowered("t > 0 -> [{t := 0;}*] t = 0", "", "Real t;")
    assert bounded.variables[0].initial == assumed.variables[0].initial == "sampled"


# Episodes ---------------------------------------------------------------------


def test_a_model_without_annotations_is_judged_by_its_postcondition() -> None:
    model = lowered("true -> [{x := v;}*] x > 0 & <{x := v;}*> x > 5")
    (predicate,) = model.predicates
    assert (predicate.category, print_formula(predicate.formula)) == ("safety", "x > 0")
    assert predicate.penalty is not None and evaluate(predicate.penalty, {}) == -1
    assert (predicate.on_failure, predicate.on_success) == (Trigger("terminate", "failure"), None)
    assert all(v.observed and v.bound == UNBOUNDED for v in model.variables)


def test_a_diamond_alone_is_progress() -> None:
    model = lowered("true -> <{x := v;}*> x > 5")
    (predicate,) = model.predicates
    assert (predicate.category, print_formula(predicate.formula)) == ("progress", "x > 5")
    assert predicate.reward is not None and evaluate(predicate.reward, {}) == 1
    assert predicate.on_success == Trigger("terminate", "success")
    assert model.postcondition is None


def test_with_annotations_postconditions_add_nothing() -> None:
    problem = "true -> [{x := v;}*] x > 0 & <{x := v;}*> x > 5"
    model = lowered(problem, "", "/* @var: bound=[0:1] */\nReal x; Real v;")
    assert model.predicates == ()
    assert [v.observed for v in model.variables] == [True, False]
    assert model.postcondition is not None


def test_observe_false_hides_a_constant() -> None:
    definitions = "/* @const: bound=[1:2], observe=false */\nReal a;\n/* @const: bound=[1:2] */\nReal b;"
    constants = lowered("true -> [x := a + b;] x > 0", definitions).constants
    assert [c.observed for c in constants] == [False, True]


def test_observe_false_hides_a_variable() -> None:
    (x,) = lowered(
        "true -> [{x := 1;}*] x > 0", "", "/* @var: bound=[0:1], observe=false */\nReal x;"
    ).variables
    assert not x.observed


def test_a_problem_without_loop_is_one_step() -> None:
    model = lowered("true -> [x := v; v := x;] x > 0")
    assert not model.loops and len(model.body) == 2
    assert lowered("true -> [{x := v; v := x;}*] x > 0").loops


def test_what_follows_the_loop_is_not_run() -> None:
    definitions = "/* @safety: penalty=-1 */\nBool p(Real x) <-> x > 0;"
    model = lowered("true -> [{x := v;}* v := 1; ?x > 0;] (p(x) & v > 0)", definitions)
    assert len(model.body) == 1 and model.postcondition is None
    assert lowered("true -> [{x := v;}* v := 1;] p(x)", definitions).postcondition is not None
    with pytest.raises(CompileError) as refused:
        lowered("true -> [{x := v;}* v := 1;] v > 0")
    assert codes(refused.value) == ["program-after-loop"]


def test_lowering_is_a_function_of_the_text() -> None:
    text = model_text("true -> [{x := v;}*] x > 0")
    assert text == model_text("true -> [{x := v;}*] x > 0")
    assert lowered("true -> [{x := v;}*] x > 0") == lowered("true -> [{x := v;}*] x > 0")
