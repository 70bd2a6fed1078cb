"""Programs and formulas of a step: normal forms, numbers, branches, decisions and their annotations."""

import math
from collections.abc import Iterator
from fractions import Fraction

import pytest
from generators.kyx_builder import codes, holds, lowered
from hypothesis import given, settings
from resolve.test_resolve import BODIES, expansion, formulas, points

from dl2c.diagnostics import CompileError
from dl2c.ir.evaluate import truth
from dl2c.ir.model import Assign, AssignAny, Block, Choice, If, Number, Symbol, Test
from dl2c.ir.printer import print_block, print_formula, print_term
from dl2c.lower.terms import lower_formula
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


def test_imported_constants_are_their_nearest_doubles() -> None:
    for name, value in (("pi", math.pi), ("e", math.e)):
        (statement,) = step(f"x := {name};", "import kyx.math.{pi, e};")
        assert isinstance(statement, Assign) and isinstance(statement.term, Number)
        assert float(statement.term.value) == value


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
        lowered("true -> [{x := v;}*] p(x)", "/* @safety: shape={false} */\nBool p(Real y) <-> y > 0;")
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


def test_annotations_before_a_call_are_before_what_is_called() -> None:
    calls = '/* @choice: name="gear" */ { c; ++ /* @fallback */ { {d;} x := 3; } }'
    choice = only_choice(calls, "HP c ::= { x := 1; }; HP d ::= { x := 2; };")
    assert (choice.name, [a.fallback for a in choice.alternatives]) == ("gear", [False, True])
    chosen, plain = step('{ /* @choice: name="gear" */ c; } c;', "HP c ::= { { x := 1; ++ x := 2; } };")
    assert isinstance(chosen, Choice) and isinstance(plain, Choice)
    assert (chosen.name, plain.name) == ("gear", "")


def test_fallback_before_a_branch_marks_both_ways() -> None:
    choice = only_choice(f"x := 1; ++ /* @fallback */ {IF} ++ x := 3;")
    assert [a.fallback for a in choice.alternatives] == [False, True, True, False]


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


def test_formulas_lower_alone() -> None:
    atom = tree.Compare(">", tree.Variable("x"), tree.Variable("v"))
    assert print_formula(lower_formula(tree.Not(tree.Imply(atom, tree.Truth(False))), SCOPE)) == "x > v"
