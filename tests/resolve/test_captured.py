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
