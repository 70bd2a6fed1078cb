"""What users are told about mistakes in syntax and annotations, word for word."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from selection import few_and_many_examples

from dl2c.diagnostics import CompileError
from dl2c.parse.annotations import decode_declaration, decode_problem, decode_program
from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term, parse_value
from dl2c.source import Source

BAD = sorted((Path(__file__).parents[1] / "bad").glob("syntax_*.kyx"))


def read_everything(source: Source) -> None:
    """Parse an archive and decode its annotations."""
    archive, _ = parse_archive(source)
    problems: list[CompileError] = []
    for entry in archive.entries:
        tasks = [
            *(lambda d=d: decode_declaration(d, "definition") for d in entry.definitions),
            *(lambda d=d: decode_declaration(d, "variable") for d in entry.variables),
            lambda e=entry: decode_program(e.program_annotations),
            lambda e=entry: decode_problem(e.problem_annotations),
        ]
        for task in tasks:
            try:
                task()
            except CompileError as found:
                problems.append(found)
    if problems:
        raise CompileError(diagnostic for problem in problems for diagnostic in problem.diagnostics)


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_mistakes_are_explained(path: Path, golden: Callable[[Path, str], None]) -> None:
    with pytest.raises(CompileError) as refused:
        read_everything(Source(path.name, path.read_text(encoding="utf-8")))
    golden(path.with_name(path.name + ".expected"), f"{refused.value}\n")


def test_there_are_bad_files_for_many_mistakes() -> None:
    assert len(BAD) >= 40


CHARACTERS = st.sampled_from(
    [*"xy01 ()[]{}<>=!&|-+*/^;:?,.'@\\_\n\"", " x ", ":=", "->", "<-", "'=", "/*", "*/", "//"]
)
WORDS = st.sampled_from(
    [
        *(" x ", ":=", "->", "<-", "'=", "/*", "*/", "//"),
        *("\\forall x ", "if (", "else {", "Real ", "Bool ", "HP ", "true", "++", "--", "^@", "::=", "<->"),
        *('Theorem "T" ', "Definitions ", "ProgramVariables ", "Problem ", "Tactic ", "End."),
        *(
            "Functions. ",
            "SharedDefinitions ",
            "R x. ",
            "P a ::= {",
            "B p(R) <-> ",
            "._1",
            "implicit ",
            "{{f:=1;}",
        ),
        *("@var: ", "// @safety: ", "bound=[0:1]"),
    ]
)


@given(st.lists(st.one_of(CHARACTERS, WORDS), max_size=30).map("".join))
def test_no_text_crashes_the_parser(text: str) -> None:
    """Whatever is written, it is read or explained."""
    for read in (parse_term, parse_formula, parse_program, parse_value):
        try:
            read(text)
        except CompileError as refused:
            assert str(refused)
    try:
        read_everything(Source("any.kyx", text))
    except CompileError as refused:
        assert str(refused)


@few_and_many_examples(25, 100, st.text(max_size=40))
def test_no_characters_crash_the_parser(text: str) -> None:
    for source in (Source("any.kyx", text), Source("any.kyx", f'Theorem "T" Problem {text} End. End.')):
        try:
            read_everything(source)
        except CompileError as refused:
            assert str(refused)


@given(st.data())
def test_a_model_with_one_piece_cut_out_is_read_or_explained(data: st.DataObject) -> None:
    text = (
        'Theorem "T"\nDefinitions\n  // @const: bound=[0:1]\n  Real c;\n'
        "  HP a ::= { x := *; ?x<=c; };\nEnd.\n"
        "ProgramVariables Real x; End.\nProblem x >= 0 -> [{a; {x'=1 & x<9}}*@invariant(x>0)]x>0 End.\nEnd.\n"
    )
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 12)))
    try:
        read_everything(Source("cut.kyx", text[:start] + text[end:]))
    except CompileError as refused:
        assert str(refused)
