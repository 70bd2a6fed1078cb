"""Names that nothing declares are what KeYmaera X takes them for."""

from pathlib import Path
from typing import Any

import pytest
from conftest import shared
from corpus_table import files

import dl2c
from dl2c.commands.check import annotated
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.lint.check import examine
from dl2c.lint.fix import fix_file
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import Compilation, check_model
from dl2c.resolve.infer import inferred
from dl2c.source import Source

PROGRAM = "[{ {a := A(); ++ a := -b;} t := 0; {x'=v, v'=a, t'=1 & v >= 0 & t <= 1} }*] x >= 0"
PROBLEM = f"Problem\n  x >= 0 & A() > 0 & b > 0 -> {PROGRAM}\nEnd.\n"
BARE = f"/* @episode: max_steps=20 */\n{PROBLEM}"
NAMED = f'Theorem "named"\n{PROBLEM}End.\n'
DEFINED = f'Theorem "defined"\nDefinitions Real A; End.\n{PROBLEM}End.\n'
OLD = f"Functions. R A(). End.\n{PROBLEM.replace('Problem', 'Problem.')}"
DECLARED = "Definitions Real A; Real b; End.\nProgramVariables Real x; Real v; End."
WRITTEN = f'Theorem "written"\n{DECLARED}\n{PROBLEM}End.\n'
OPTIONS: dict[str, Any] = {"default_bound": "-10:10"}


def entry_of(text: str) -> Any:
    return parse_archive(Source("model.kyx", text))[0].entries[0]


def warned(text: str) -> list[str]:
    found = examine(Source("model.kyx", text), resolve_options(OPTIONS))
    assert all(d.severity == "warning" for d in found), found
    return [d.label for d in found if d.code == "undeclared-names"]


@pytest.mark.parametrize("text", [BARE, NAMED, DEFINED, OLD], ids=["bare", "named", "defined", "old"])
def test_without_variables_what_is_only_read_is_a_constant(text: str) -> None:
    env: Any = dl2c.make(text, **OPTIONS, constants={"b": 2})
    assert {q.name for q in env.manifest.variables} == {"a", "t", "x", "v"}
    assert {q.name: q.value for q in env.manifest.constants} == {"A": None, "b": 2}
    env.reset(seed=1)
    assert env.step(0)[4]["duration"] >= 0
    assert len(warned(text)) == 1


def test_the_warning_can_be_silenced() -> None:
    assert warned(BARE) == ["`a`, `t`, `x`, `v` are taken as variables, `A`, `b` are taken as constants"]
    assert warned(BARE.replace("max_steps=20", "allow=undeclared-names")) == []


def test_what_is_written_is_a_variable() -> None:
    assert warned(WRITTEN) == ["`a`, `t` are taken as variables"]


def test_names_that_are_only_read_are_mistakes_where_variables_are_declared() -> None:
    text = WRITTEN.replace("Real b;", "")
    with pytest.raises(CompileError) as refused:
        check_model(Source("model.kyx", text), resolve_options(OPTIONS))
    (found,) = refused.value.diagnostics
    assert (found.code, found.span.text) == ("undeclared-variable", "b")
    assert found.notes == ("also at 5:54",)


def test_quantified_names_parameters_and_library_names_are_none_of_them() -> None:
    text = """Theorem "q"
    Definitions
      import kyx.math.e;
      Real twice(Real y) = 2*y;
    End.
    Problem \\exists z z > x & x < e -> [{x' = twice(x)}] x > 0 End.
    End."""
    found = inferred(entry_of(text))
    assert [d.name for d in found.variables] == ["x"] and not found.constants


DEFINITIONS = "Definitions Real r; Bool p() <-> q(); Bool q() <-> x > 1; End."
QUANTIFIED = """Theorem "quantified"
ProgramVariables Real x; Real v; Real t; End.
Problem
  \\forall d (d > 0 -> \\forall x (x = 0 & v = 0 ->
    [{ {v := d; ++ v := -d;} t := 0; {x'=v, t'=1 & t <= 1} }*] x >= -100))
End.
End.
"""


def test_universal_quantifiers_around_the_program_declare_constants() -> None:
    env: Any = dl2c.make(QUANTIFIED, **OPTIONS, constants={"d": 3})
    assert [q.name for q in env.manifest.constants] == ["d"]
    assert {q.name for q in env.manifest.variables} == {"x", "v", "t"}
    env.reset(seed=0)
    env.step(0)
    assert env.state["x"] == 3.0
    assert warned(QUANTIFIED) == []


STABLE = """Theorem "stable"
Definitions
  Bool near(Real x, Real y, Real r) <-> x^2 + y^2 < r^2;
  Bool stable() <-> \\forall eps (eps > 0 -> \\exists del (del > 0 & del < 4 & \\forall x \\forall y (
    near(x, y, del) -> [{x' = -x + y, y' = -x - y}] near(x, y, eps))));
End.
ProgramVariables Real x; Real y; End.
Problem stable() End.
End.
"""


def existential(text: str) -> list[str]:
    found = examine(Source("model.kyx", text), resolve_options(OPTIONS))
    return [d.label for d in found if d.code == "existential-constant"]


def test_existential_quantifiers_declare_constants_with_a_warning() -> None:
    """What stands beside the rest of the problem limits them."""
    env: Any = dl2c.make(STABLE, **OPTIONS)
    assert {q.name for q in env.manifest.constants} == {"eps", "del"}
    for seed in range(20):
        env.reset(seed=seed)
        state = env.state
        assert 0 < state["del"] < 4 and state["eps"] > 0
        assert state["x"] ** 2 + state["y"] ** 2 < state["del"] ** 2
    assert existential(STABLE) == [
        "`del` is a constant here, with any value; a violation says nothing of others"
    ]
    assert existential(STABLE.replace("\\exists", "\\forall").replace("4 &", "4 ->")) == []
    assert existential(STABLE.replace("Problem", "/* @episode: allow=existential-constant */ Problem")) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\\forall x (x = 0", "p() -> \\forall x (x = 0"),
        ("\\forall d", "\\forall r"),
        ("\\forall d (d > 0", "d > 1 -> \\forall d (d > 0"),
        ("\\forall x (x = 0", "x > 1 -> \\forall x (x = 0"),
        ("\\forall d (d > 0 ->", "\\forall d (d > 0 |"),
        ("\\forall d (d > 0 ->", "\\exists d ([v := 0;] v = d &"),
    ],
)
def test_other_quantifiers_around_it_are_refused(old: str, new: str) -> None:
    """Those of names that something else means, or under which it is not one program that runs."""
    with pytest.raises(CompileError) as refused:
        text = QUANTIFIED.replace(old, new).replace("ProgramVariables", f"{DEFINITIONS}\nProgramVariables")
        check_model(Source("model.kyx", text), resolve_options(OPTIONS))
    assert {d.code for d in refused.value.diagnostics} <= {"quantifier", "undeclared-variable"}


def test_definitions_that_call_themselves_are_told_so() -> None:
    text = STABLE.replace(
        "near(x, y, eps))));", "near(x, y, eps)))); Bool p() <-> q() & p(); Bool q() <-> p();"
    )
    for problem in ("p()", "\\forall z p()", "stable() & p()", "x > 0 -> \\exists z (z > 0 & q())"):
        with pytest.raises(CompileError) as refused:
            changed = text.replace("Problem stable()", f"Problem {problem}")
            check_model(Source("model.kyx", changed), resolve_options(OPTIONS))
        assert {d.code for d in refused.value.diagnostics} == {"recursive-definition"}


@pytest.mark.parametrize("text", [QUANTIFIED, BARE, f"Problem {QUANTIFIED.split('Problem')[1][:-5]}"])
def test_what_has_no_declaration_is_not_annotated(tmp_path: Path, text: str) -> None:
    path = tmp_path / "model.kyx"
    path.write_text(text)
    path.write_bytes(annotated(str(path), OPTIONS))
    again = Compilation(Source.read(path), resolve_options(OPTIONS)).resolved.problem
    assert all(a is not None for d, a in again.variables if d.name == "v")
    assert parse_archive(Source.read(path))[0].entries[0].problem == entry_of(text).problem


@pytest.mark.parametrize("text", [BARE, NAMED, DEFINED, OLD, WRITTEN])
def test_fix_declares_them(tmp_path: Path, text: str) -> None:
    path = tmp_path / "model.kyx"
    path.write_text(text)
    before = Compilation(Source.read(path), resolve_options(OPTIONS)).lowered.model
    assert fix_file(path) == 1
    assert warned(path.read_text()) == []
    after = Compilation(Source.read(path), resolve_options(OPTIONS)).lowered.model
    assert (after.variables, after.constants, after.body) == (before.variables, before.constants, before.body)
    assert fix_file(path) == 0


@pytest.mark.slow  # reads all public models; test_fix_declares_them is about models of each form
def test_public_models_without_declarations_can_be_fixed(tmp_path: Path) -> None:
    shared("corpus")
    mended = 0
    for path in files():
        try:
            archive, _ = parse_archive(Source.read(path))
        except CompileError:
            continue
        if not any(inferred(e).warnings() for e in archive.entries):
            continue
        copy = tmp_path / "model.kyx"
        copy.write_bytes(path.read_bytes())
        fix_file(copy)
        again, _ = parse_archive(Source.read(copy))
        for old, new in zip(archive.entries, again.entries, strict=True):
            assert not inferred(new).warnings(), path
            assert old.problem == new.problem, path
        mended += 1
    assert mended > 15
