"""Arguments of definitions keep their meaning below programs."""

import pytest
from generators.kyx_builder import codes, resolved

from dl2c.diagnostics import CompileError


@pytest.mark.parametrize(
    ("argument", "definition"),
    [
        ("x", "Bool p(Real a) <-> [x := x + 1;] x > a;"),
        ("x + 1", "Bool p(Real a) <-> q(a) & [{x' = 1}] q(a); Bool q(Real a) <-> a > 0;"),
        ("x", "Bool p(Real a) <-> [b;] a > 0; HP b ::= { x := 1; };"),
        ("v", "Bool p(Real a) <-> [a := 1;] a > 0;"),
        ("x", "Bool p(Real a) <-> \\forall x [x := a;] x > 0;"),
    ],
    ids=["assigned", "in a nested call", "by a defined program", "parameter", "quantified"],
)
def test_programs_of_a_definition_do_not_capture_its_arguments(argument: str, definition: str) -> None:
    with pytest.raises(CompileError) as refused:
        resolved(f"true -> [v := 1;] p({argument})", definition)
    assert codes(refused.value) == ["captured-variable"]


def test_arguments_may_mention_what_programs_around_a_call_change() -> None:
    definitions = "Bool p(Real a) <-> q(a + 0) & \\exists x x > a; Bool q(Real a) <-> [v := a;] v >= a;"
    assert resolved("true -> [x := 1;] p(x)", definitions).shape.postcondition is not None


FAR = "x = 1 & p(x) -> [v := 1;] v > 0"


@pytest.mark.parametrize(
    "definitions",
    [
        "Bool p(Real y) <-> \\forall x (x > y -> [a;] false); HP a ::= { ?x > 5; };",
        "Bool p(Real y) <-> \\forall x (x > y -> [a;] v <= 5); HP a ::= { v := x; };",
        "Bool p(Real y) <-> \\forall x (x > y -> [a;] y < 0); HP a ::= { {x' = 1 & x <= v} };",
        "Bool p(Real y) <-> \\forall x (x > y -> q(x)); Bool q(Real u) <-> [a;] u < 0; HP a ::= { ?x > 5; };",
        "Bool p(Real y) <-> \\forall x (x > y -> q); Bool q <-> x <= 5;",
        "Bool p(Real y) <-> \\forall x (x > y -> c > 5); Real c = x;",
    ],
    ids=["test", "assignment", "equation", "two calls deep", "formula", "term"],
)
def test_a_quantifier_with_another_name_hides_its_variable_from_what_is_called(definitions: str) -> None:
    """The argument x makes the quantifier of p take another name: what it calls would read the outer x."""
    with pytest.raises(CompileError) as refused:
        resolved(FAR, definitions)
    assert {*codes(refused.value)} == {"captured-variable"}


def test_constants_are_not_what_quantifiers_bind() -> None:
    definitions = "Real A; Bool p(Real y) <-> \\exists A (A > y & q(A)); Bool q(Real u) <-> u > A;"
    assert resolved("A > 0 -> [x := 1;] p(x)", definitions).shape.postcondition is not None


@pytest.mark.parametrize(
    "after", ["[x := 5;] f(0) = 5", "[v := 1;] \\exists x f(0) = 7", "[x := 5;] f(0) = 1"]
)
def test_every_use_of_an_implicit_function_is_checked(after: str) -> None:
    """Not only the first: what its definition calls mentions x."""
    definitions = "Real c = x; implicit Real f(Real t) = {{f:=c; t:=0;} {f'=1, t'=1}};"
    with pytest.raises(CompileError) as refused:
        resolved(f"f(0) = 1 -> {after}", definitions)
    assert codes(refused.value) == ["captured-variable"]
