"""Printing is the inverse of parsing."""

import re
from fractions import Fraction

import pytest
from generators.syntax_strategies import archives, formulas, programs, terms
from hypothesis import given, settings

from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term
from dl2c.parse.printer import decimal, print_archive, print_formula, print_program, print_source, print_term
from dl2c.parse.tree import Archive, Formula, Number, Program, Term
from dl2c.source import Source


@given(terms())
def test_parse_inverts_print_of_terms(term: Term) -> None:
    assert parse_term(print_term(term), strict=True) == term


@given(formulas())
def test_parse_inverts_print_of_formulas(formula: Formula) -> None:
    assert parse_formula(print_formula(formula), strict=True) == formula


@given(programs())
def test_parse_inverts_print_of_programs(program: Program) -> None:
    assert parse_program(print_program(program), strict=True) == program


@given(archives())
@settings(max_examples=50)
def test_parse_inverts_print_of_archives(archive: Archive) -> None:
    read, warnings = parse_archive(Source("printed.kyx", print_archive(archive)))
    assert read == archive
    assert not warnings


@given(archives())
@settings(max_examples=50)
def test_parse_inverts_print_of_archives_with_short_lines(archive: Archive) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dl2c.parse.printer.WIDTH", 12)
        text = print_archive(archive)
    assert parse_archive(Source("printed.kyx", text))[0] == archive


TOLD = """/* What it is about,
 * in two lines. */
// And a third.
ArchiveEntry "long"
ProgramVariables Real position; Real velocity; End.
/* @episode: max_steps=7 */ /* Nor this. */
Problem position >= 0 & velocity >= 0 & position <= 100 & velocity <= 20 -> [{
  /* not kept */ { ?velocity <= 10; velocity := velocity + 1; ++ velocity := velocity - 1; }
  { position' = velocity & velocity >= 0 }
}*] position >= 0 End.
End.
/* Of another one. */
Theorem "short" ProgramVariables Real x; End. Problem x >= 0 -> [x := 1;] x >= 0 End. End.
"""

PRINTED = """\
/* What it is about,
 * in two lines. */
// And a third.
ArchiveEntry "long"

ProgramVariables
  Real position;
  Real velocity;
End.

/* @episode: max_steps=7 */
Problem
  position >= 0 & velocity >= 0 & position <= 100 & velocity <= 20
  -> [{
    {?velocity <= 10; velocity := velocity + 1; ++ velocity := velocity - 1;}
    {position' = velocity & velocity >= 0}
  }*](position >= 0)
End.

End.

/* Of another one. */
Theorem "short"

ProgramVariables
  Real x;
End.

Problem
  x >= 0 -> [x := 1;](x >= 0)
End.

End.
"""


def test_a_file_is_printed_with_its_comments_and_in_short_lines() -> None:
    source = Source("told.kyx", TOLD)
    assert print_source(source) == PRINTED
    assert parse_archive(Source("printed.kyx", PRINTED))[0] == parse_archive(source)[0]
    assert print_source(Source("printed.kyx", PRINTED)) == PRINTED


SORTS = {"Real": "R", "Bool": "B", "HP": "P"}
HEADERS = {"Definitions": "Functions.", "ProgramVariables": "Variables;", "Problem": "Problem."}


def in_old_dialect(text: str) -> str:
    """A printed archive as KeYmaera X 4 would have it."""
    lines: list[str] = []
    for line in text.split("\n"):
        if line in HEADERS:
            lines.append(HEADERS[line])
        elif re.match(r"  (implicit )?(Real|Bool|HP) ", line):
            old = re.sub(r"(?<=[ (])(Real|Bool|HP)(?= )", lambda sort: SORTS[sort.group()], line)
            lines.append(f"{old[:-1]}.")
        else:
            lines.append(f"{line}." if line.endswith('"') else line)
    return "\n".join(lines)


@given(archives())
@settings(max_examples=50)
def test_both_dialects_read_to_one_tree(archive: Archive) -> None:
    text = in_old_dialect(print_archive(archive))
    assert parse_archive(Source("old.kyx", text))[0] == archive


@given(terms())
@settings(max_examples=30)
def test_spans_cover_the_text_that_a_term_was_read_from(term: Term) -> None:
    text = print_term(term)
    assert parse_term(f"  {text} ").span.text == text


@pytest.mark.parametrize(
    "text",
    [
        "x - (y - z)",
        "-x*y",
        "(-x)*y",
        "x*(-y)",
        "x/(y*z)",
        "x/y*z",
        "(x + y)*z",
        "x^y^z",
        "(x^y)^z",
        "-x^2",
        "(-x)^2",
        "(- 0)^2",
        "f(x, -y)",
        "0.125",
        "(x*y)'",
    ],
)
def test_print_keeps_only_the_parentheses_that_matter(text: str) -> None:
    assert print_term(parse_term(text)) == text


@pytest.mark.parametrize(
    "text",
    [
        "x >= 0 & y < 1 -> p() | q(x)",
        "(p() -> q()) -> r()",
        "(p() <-> q()) <-> r()",
        "!(x > 0) & !p()",
        "\\forall x \\exists y (x = y)",
        "[x := 1; {y := *; ++ ?p();}](x > 0)",
        "<{x' = v, v' = a & v >= 0}>p()",
        "[{{a; b;} c;}*]true",
    ],
)
def test_print_shows_formulas_as_one_would_write_them(text: str) -> None:
    assert print_formula(parse_formula(text)) == text


def test_numbers_print_as_exact_decimals() -> None:
    assert decimal(Fraction(1, 8)) == "0.125"
    assert decimal(Fraction(10**21)) == "1" + 21 * "0"
    assert decimal(Fraction(1, 10**9)) == "0.000000001"


def test_numbers_without_a_decimal_print_as_quotients() -> None:
    assert print_term(Number(Fraction(1, 3))) == "1/3"
