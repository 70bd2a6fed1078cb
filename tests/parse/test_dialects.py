"""Files of KeYmaera X 4 are read like those of 5, with which they may be mixed."""

import re

import pytest
from parse.test_parse import model, read

from dl2c.diagnostics import CompileError
from dl2c.options import Options
from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term
from dl2c.pipeline import emit
from dl2c.source import Source

OLD = """
Functions.
  R c. R d(). T f(R x) = (x + 1).
  R g(R, R).
  F p(R x) <-> ( x > 0 ).
  P ctrl ::= { T := T + 1; }.
End.
Variables.
  R x.
  R T, y.
End.
Problem.
  p(x) -> [ctrl;]x > c
End.
"""

NEW = """
ArchiveEntry "model"
Definitions
  Real c; Real d(); Real f(Real x) = x + 1; Real g(Real x1, Real x2);
  Bool p(Real x) <-> x > 0;
  HP ctrl ::= { T := T + 1; };
End.
ProgramVariables
  Real x; Real T, y;
End.
Problem
  p(x) -> [ctrl;]x > c
End.
End.
"""


def test_both_dialects_read_to_one_tree() -> None:
    assert read(OLD) == read(NEW)
    named = OLD.replace("Functions.", 'ArchiveEntry "model".\nFunctions.') + "End.\n"
    assert read(named) == read(NEW)
    shared_first = OLD.replace("Functions.", "SharedDefinitions;").replace(
        "Variables.", 'Lemma "model". Variables.'
    )
    assert read(shared_first + "End.").entries[0].definitions == read(NEW).entries[0].definitions


def test_an_annotated_model_means_the_same_in_both_dialects() -> None:
    old = """
    Functions.
      /* @const: bound=[1:2] */
      R A.
      /* @safety: penalty=-1, on_failure=terminate:failure */
      B safe(R y) <-> ( y >= -5 ).
    End.
    ProgramVariables.
      R x. /* where it is */
      /* @var: role=agent */
      R a.
    End.
    Problem.
      x = 0 -> [{a := *; ?-1 <= a & a <= A; {x' = a & x < 9}}*]safe(x)
    End.
    """
    new = re.sub(r"(?m)\.( /\*.*)?$", ";", old.replace("R ", "Real ").replace("B ", "Bool "))
    new = new.replace("Functions;", 'Theorem "cart" Definitions').replace("End;", "End.") + "End."
    new = new.replace("ProgramVariables;", "ProgramVariables").replace("Problem;", "Problem")
    found = [emit(Source("cart.kyx", text), "ir", Options()) for text in (old, new)]
    assert found[0] == found[1]
    assert parse_archive(Source("cart.kyx", new))[1] == ()


def test_a_mixture_of_dialects_is_read() -> None:
    mixed = OLD.replace("R c.", "Real c.").replace("R d().", "Real d();").replace("F p", "Bool p")
    assert read(mixed.replace("Variables.", "ProgramVariables")) == read(NEW)


def test_arguments_without_name_are_dots() -> None:
    definitions = read(
        model("R f(R) = (. + x1). B p(R, R x) <-> ( ._0 > ._1 + x ). Real g(Real) = 5;")
    ).entries[0]
    shown = [(d.name, [p.name for p in d.parameters or ()], d.body) for d in definitions.definitions]
    assert shown == [
        ("f", ["x1_1"], parse_term("x1_1 + x1")),
        ("p", ["x1", "x"], parse_formula("x1 > x + x")),
        ("g", ["x1"], parse_term("5")),
    ]


def test_a_file_in_the_old_dialect_is_warned_about_once() -> None:
    _, warnings = parse_archive(Source("model.kyx", OLD))
    assert [(w.code, w.span.text) for w in warnings] == [("keymaera-rejects", "Functions")]
    _, warnings = parse_archive(Source("model.kyx", NEW))
    assert warnings == ()


def test_a_bare_file_is_named_after_itself() -> None:
    archive, _ = parse_archive(Source("models/car.kyx", OLD))
    assert [entry.name for entry in archive.entries] == ["car"]


def test_letters_that_are_sorts_stay_names() -> None:
    entry = read(
        OLD.replace("P ctrl ::= { T := T + 1; }.", "P ctrl ::= { x := T;\n T := x; {T' = 1 & T\n > 0} }.")
    )
    body = entry.entries[0].definitions[-1].body
    assert body == parse_program("x := T; T := x; {T' = 1 & T > 0}")


def test_entries_of_one_name_are_chosen_by_number() -> None:
    source = Source(
        "two.kyx", model(problem="x >= 0") + model(problem="x >= 1") + model().replace('"M"', '"2"')
    )
    assert emit(source, "expanded", Options(entry="1")) == "x >= 0\n"
    assert emit(source, "expanded", Options(entry="2")) == "x >= 0\n"
    with pytest.raises(CompileError, match="several entries `M`: give its number"):
        emit(source, "expanded", Options(entry="M"))
    with pytest.raises(CompileError, match="no entry `4`"):
        emit(source, "expanded", Options(entry="4"))
