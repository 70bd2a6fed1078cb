"""What a step model says: branches and decisions, horizons, constants, initial values, episodes."""

from collections.abc import Iterator
from fractions import Fraction

import pytest
from hypothesis import given, settings
from kyx_builder import codes, holds, lowered, model_text
from test_resolve import BODIES, expansion, formulas, points

from dl2c.diagnostics import CompileError
from dl2c.ir.evaluate import evaluate, truth
from dl2c.ir.lower_terms import lower_formula
from dl2c.ir.model import UNBOUNDED, Assign, AssignAny, Block, Bound, Choice, Flow, If, Symbol, Test, Trigger
from dl2c.ir.printer import print_block, print_formula, print_term
from dl2c.parse import tree

SCOPE = {"x": Symbol("x", "variable"), "v": Symbol("v", "variable"), "A": Symbol("A", "constant")}

# Formulas and terms -----------------------------------------------------------


@settings(max_examples=40)
@given(formulas, points)
def test_normal_forms_keep_the_meaning(formula: tree.Formula, at: dict[str, Fraction]) -> None:
    """An atom with an undefined subterm is false under any number of negations (semantics 5)."""
    lowered_formula = lower_formula(expansion(formula), SCOPE)
    where = {SCOPE[name]: number for name, number in at.items()}
    assert truth(lowered_formula, where, exact=True) == holds(formula, at, BODIES)


@settings(max_examples=40)
@given(formulas, points)
def test_the_normal_form_of_a_negation_holds_where_the_formula_is_false(
    formula: tree.Formula, at: dict[str, Fraction]
) -> None:
    lowered_formula = lower_formula(expansion(tree.Not(formula)), SCOPE)
    where = {SCOPE[name]: number for name, number in at.items()}
    assert truth(lowered_formula, where, exact=True) == holds(formula, at, BODIES, wanted=False)


def assigned(text: str) -> str:
    (statement,) = lowered(f"true -> [x := {text};] x > 0").body
    assert isinstance(statement, Assign)
    return print_term(statement.term)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("1/3 + 1/6", "0.5"),
        ("2 * 3 * v", "6 * v"),
        ("v^2^2", "v^4"),
        ("v^-2", "1 / v^2"),
        ("v^(1/2)", "sqrt(v)"),
        ("v^1.5", "pow(v, 1.5)"),
        ("v^100", "pow(v, 100)"),
        ("2^v", "pow(2, v)"),
        ("v^0", "1"),
        ("(1/v)^0", "pow(1 / v, 0)"),
        ("v/0", "v / 0"),
        ("0 * v", "0 * v"),
        ("-2", "-2"),
        ("v/-v/v", "v / (-(v / v))"),
        ("min(2, 1) + abs(-3)", "4"),
    ],
)
def test_numbers_fold_and_nothing_else_does(written: str, meant: str) -> None:
    assert assigned(written) == meant


def test_powers_keep_the_definedness_of_their_base() -> None:
    (test, _) = lowered("true -> [?(1/v)^0 = 1; x := 1;] x > 0").body
    assert isinstance(test, Test)
    for v, expected in ((2.0, True), (0.0, False)):
        assert truth(test.formula, {SCOPE["v"]: v}) is expected


def test_a_number_beyond_the_doubles_is_refused() -> None:
    for text in ("10^64 * 10^64 * 10^64 * 10^64 * 10^64", "x + (9^64)^64", "-((2^64)^16)"):
        with pytest.raises(CompileError) as refused:
            assigned(text)
        assert codes(refused.value) == ["number-out-of-range"]


def test_a_value_without_distance_is_refused() -> None:
    with pytest.raises(CompileError) as refused:
        lowered("true -> [{x := v;}*] p(x)", "/* @safety: shape={1 < 2} */\nBool p(Real y) <-> y > 0;")
    assert codes(refused.value) == ["no-distance"]


# Branches and choices ---------------------------------------------------------


def shape_of(block: Block) -> list[object]:
    """Names of statements; a choice as the list of its key and its alternatives."""
    shown: list[object] = []
    for statement in block:
        match statement:
            case Choice(key, found):
                shown.append([key, *(shape_of(a.body) for a in found)])
            case If(_, _, then, orelse):
                shown.append(("if", shape_of(then), shape_of(orelse)))
            case AssignAny(_, key):
                shown.append(key)
            case _:
                shown.append(type(statement).__name__)
    return shown


def step(program: str, definitions: str = "", variables: str = "Real x; Real v;") -> Block:
    return lowered(f"true -> [{{{program}}}*] x > 0", definitions, variables).body


IF = "if (x > 0 & v = 1) { x := 1; } else { x := 2; }"


@pytest.mark.parametrize(
    "written",
    [
        "{ ?x > 0 & v = 1; x := 1; } ++ { ?!(x > 0 & v = 1); x := 2; }",
        "{ ?x > 0 & v = 1; x := 1; ++ ?x <= 0 | v != 1; x := 2; }",
        "{ ?0 < x & v = 1; x := 1; ++ ?(0 >= x | v != 1); x := 2; }",
        "{ ?p(x); x := 1; } ++ { ?!p(x); x := 2; }",
        "{ ?!(0 >= x | v != 1); { x := 1; } ++ ?!p(x); x := 2; }",
    ],
)
def test_complementary_tests_are_a_branch_however_written(written: str) -> None:
    definitions = "Bool p(Real y) <-> y > 0 & w = 1;"
    variables = "Real x; Real v;"
    macro = step(IF, variables=variables)
    hand = step(written, definitions.replace("w", "1"), variables) if "p(" not in written else None
    if hand is not None:
        assert shape_of(macro) == [("if", ["Assign"], ["Assign"])]
        assert shape_of(hand) == shape_of(macro)
        return
    expanded = step(written, "Bool p(Real y) <-> y > 0;")
    wanted = (
        [("if", ["Assign"], ["Assign"])]
        if written.startswith("{ ?p")
        else [["choice_0", ["Test", "Assign"], ["Test", "Assign"]]]
    )
    assert shape_of(expanded) == wanted


def test_an_if_without_else_has_an_empty_branch() -> None:
    assert shape_of(step("if (x > 0) { x := 1; } v := 2;")) == [("if", ["Assign"], []), "Assign"]


def test_branches_nest() -> None:
    program = "if (x > 0) { if (v > 0) { x := 1; } } else { x := 1; ++ x := 2; ++ x := 3; }"
    assert shape_of(step(program)) == [
        ("if", [("if", ["Assign"], [])], [["choice_0", ["Assign"], ["Assign"], ["Assign"]]])
    ]


@pytest.mark.parametrize(
    "program",
    [
        "?x > 0; x := 1; ++ ?x < 0; x := 2;",
        "?x > 0; x := 1; ++ x := 2; ?x <= 0;",
        "?x > 0; x := 1; ++ ?v <= 0; x := 2;",
        "x := 1; ++ ?x <= 0; x := 2;",
    ],
)
def test_tests_that_do_not_exclude_each_other_leave_a_choice(program: str) -> None:
    (choice,) = step(program)
    assert isinstance(choice, Choice) and len(choice.alternatives) == 2


def test_three_alternatives_are_always_a_choice() -> None:
    assert shape_of(step("{ ?x > 0; x := 1; ++ ?x <= 0; x := 2; } ++ x := 3;")) == [
        ["choice_0", ["Test", "Assign"], ["Test", "Assign"], ["Assign"]]
    ]


def test_nested_choices_are_one() -> None:
    for program in (
        "{x := 1; ++ x := 2;} ++ x := 3; ++ x := 4;",
        "x := 1; ++ {{x := 2; ++ x := 3;} ++ x := 4;}",
    ):
        assert shape_of(step(program)) == [["choice_0", *[["Assign"]] * 4]]
    assert len(shape_of(step("{x := 1; ++ x := 2;} v := 1; ++ x := 3;"))[0]) == 3  # pyright: ignore


def test_choices_are_numbered_in_program_order() -> None:
    program = "{{x := 1; ++ x := 2;} v := 1; ++ x := 3;} {v := 1; ++ v := 2;}"
    inner = ["choice_1", ["Assign"], ["Assign"]]
    assert shape_of(step(program)) == [
        ["choice_0", [inner, "Assign"], ["Assign"]],
        ["choice_2", ["Assign"], ["Assign"]],
    ]


def test_branches_take_no_number() -> None:
    assert shape_of(step(f"{IF} {{x := 1; ++ x := 2;}}"))[1] == ["choice_0", ["Assign"], ["Assign"]]


def keys(block: Block) -> Iterator[str]:
    for item in shape_of(block):
        if isinstance(item, str) and item.startswith("assign_"):
            yield item


def test_assignments_are_named_after_their_variable() -> None:
    assert list(keys(step("x := *; v := *; x := *; x := *;"))) == [
        "assign_x",
        "assign_v",
        "assign_x_1",
        "assign_x_2",
    ]


def test_two_decisions_never_share_a_name() -> None:
    found = list(keys(step("x := *; x := *; x_1 := *; x_1 := *;", variables="Real x; Real x_1;")))
    assert len(set(found)) == 4 and found[:2] == ["assign_x", "assign_x_1"]


def test_a_program_called_twice_decides_twice() -> None:
    assert shape_of(step("c; c;", "HP c ::= { x := *; { v := 1; ++ v := 2; } };")) == [
        "assign_x",
        ["choice_0", ["Assign"], ["Assign"]],
        "assign_x_1",
        ["choice_1", ["Assign"], ["Assign"]],
    ]


# Annotations in programs ------------------------------------------------------


def only_choice(program: str, definitions: str = "") -> Choice:
    (choice,) = [s for s in step(program, definitions) if isinstance(s, Choice)]
    return choice


@pytest.mark.parametrize(
    "program",
    [
        '/* @choice: name="gear" */ {x := 1; ++ x := 2;}',
        '/* @choice: name="gear" */ x := 1; ++ x := 2;',
        '// @choice: name="gear"\n{ { x := 1; } ++ x := 2; }',
        '/* @choice:\n * name="gear"\n */ /* a comment */ // another\n { /* here */ x := 1; ++ x := 2; }',
        '{ /* @choice: name="gear" */ {x := 1; ++ x := 2;} } v := 1;',
        '{ /* @choice: name="gear" */ {x := 1; ++ {v := 1; ++ v := 2;} x := 2;} }',
    ],
)
def test_an_annotation_belongs_to_the_choice_that_follows(program: str) -> None:
    assert only_choice(program).name == "gear"
    assert only_choice("c;", f"HP c ::= {{ {program} }};").name == "gear"


def test_an_annotation_belongs_to_the_outermost_choice_that_begins_there() -> None:
    outer = only_choice('/* @choice: name="gear" */ { {x := 1; ++ x := 2;} v := 1; ++ x := 3; }')
    inner = outer.alternatives[0].body[0]
    assert isinstance(inner, Choice)
    assert (outer.name, inner.name) == ("gear", "")


def test_fallback_marks_the_alternative_that_follows() -> None:
    for mark in ("/* @fallback */", "// @fallback\n", "/* @fallback */ /* brake */ // hard\n"):
        choice = only_choice(f"{{x := 1;}} ++ {mark} {{x := 2;}} ++ x := 3;")
        assert [a.fallback for a in choice.alternatives] == [False, True, False]


@pytest.mark.parametrize(
    "program",
    ['/* @choice: name="a" */ x := 1;', f'/* @choice: name="a" */ {IF}', "/* @fallback */ x := 1; v := 2;"],
)
def test_an_annotation_that_belongs_to_nothing_is_refused(program: str) -> None:
    with pytest.raises(CompileError) as refused:
        step(program)
    assert codes(refused.value) == ["misplaced-annotation"]


def test_annotations_of_programs_that_do_not_run_are_ignored() -> None:
    assert step("x := 1;", "HP unused ::= { /* @fallback */ x := 1; };")


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


def test_the_printed_step_reads_like_the_program() -> None:
    assert list(print_block(step("?x > 0; {x := 1; ++ /* @fallback */ v := *;} if (v > 0) {x := 2;}"))) == [
        "?x > 0;",
        "choice_0 /* agent */",
        "0:",
        "  x := 1;",
        "1:  /* fallback */",
        "  v := *;  /* assign_v, agent */",
        "if (v > 0)",
        "  x := 2;",
        "else",
    ]


def test_lowering_is_a_function_of_the_text() -> None:
    text = model_text("true -> [{x := v;}*] x > 0")
    assert text == model_text("true -> [{x := v;}*] x > 0")
    assert lowered("true -> [{x := v;}*] x > 0") == lowered("true -> [{x := v;}*] x > 0")


def test_formulas_lower_alone() -> None:
    atom = tree.Compare(">", tree.Variable("x"), tree.Variable("v"))
    assert print_formula(lower_formula(tree.Not(tree.Imply(atom, tree.Truth(False))), SCOPE)) == "x > v"
