"""What the parser reads: KeYmaera X's own test pairs, its results on public models, and dl2c's rules."""

from fractions import Fraction

import pytest

from dl2c.diagnostics import CompileError
from dl2c.env.opening import source_of
from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term, parse_value
from dl2c.parse.tree import (
    And,
    Archive,
    Choice,
    Compare,
    Compose,
    DifferentialProgramConst,
    Divide,
    Dual,
    Expression,
    FuncOf,
    Imply,
    Loop,
    Neg,
    Not,
    Number,
    ODESystem,
    PredOf,
    ProgramConst,
    Test,
    Times,
    Truth,
    Variable,
)
from dl2c.resolve.unreadable import entry_of
from dl2c.source import Source, Span

READERS = {"term": parse_term, "formula": parse_formula, "program": parse_program}


def read(text: str) -> Archive:
    archive, _ = parse_archive(Source("model.kyx", text))
    return archive


def model(definitions: str = "", variables: str = "Real x;", problem: str = "x >= 0") -> str:
    return (
        f'ArchiveEntry "M"\nDefinitions\n{definitions}\nEnd.\nProgramVariables\n{variables}\nEnd.\n'
        f"Problem\n{problem}\nEnd.\nEnd.\n"
    )


def codes(error: CompileError) -> list[str]:
    return [diagnostic.code for diagnostic in error.diagnostics]


# ---------------------------------------------------------------- terms and formulas


def test_numbers_are_exact() -> None:
    assert parse_term("0.1") == Number(Fraction(1, 10))
    assert parse_term("007") == Number(Fraction(7))


def test_a_minus_in_a_product_takes_the_rest_of_it_but_not_before_a_star_after_a_slash() -> None:
    x, y, z = Variable("x"), Variable("y"), Variable("z")
    assert parse_term("x/-y*z") == Times(Divide(x, Neg(y)), z)
    assert parse_term("x/-y/z") == Divide(x, Neg(Divide(y, z)))
    assert parse_term("x*-y*z") == Times(x, Neg(Times(y, z)))


def test_nested_tuples_of_arguments_are_flat() -> None:
    assert parse_term("f((a,(b,c)))") == parse_term("f(a,b,c)")
    assert parse_formula("p((a,b),c)") == parse_formula("p(a,b,c)")


def test_a_value_is_a_term_if_it_can_be_one() -> None:
    assert parse_value("safe") == Variable("safe")
    assert parse_value("(safe(x))") == FuncOf("safe", (Variable("x"),))
    assert parse_value("safe(x) & x > 0") == And(
        PredOf("safe", (Variable("x"),)), Compare(">", Variable("x"), Number(Fraction(0)))
    )
    assert parse_value("(x > 0)") == parse_formula("x > 0")


def test_backward_implication_is_implication_turned_round() -> None:
    assert parse_formula("p <- q") == Imply(PredOf("q", ()), PredOf("p", ()))


@pytest.mark.parametrize(
    ("unicode", "plain"),
    [
        ("x ≤ 1 ∧ x ≥ 0 ∨ x ≠ 2", "x <= 1 & x >= 0 | x != 2"),
        ("p → q", "p -> q"),
        ("p ↔ q", "p <-> q"),
        ("p ← q", "p <- q"),
        ("∀ x ∃ y x = y", "\\forall x \\exists y x = y"),
        ("[a; ∪ b;]p", "[a; ++ b;]p"),
        ("[a; ∩ b;]p", "[a; -- b;]p"),
        ("[{a;}×]p", "[{{{a;}^@}*}^@]p"),
    ],
)
def test_unicode_operators_mean_their_plain_forms(unicode: str, plain: str) -> None:
    assert parse_formula(unicode) == parse_formula(plain)


def test_comments_may_stand_between_any_two_symbols() -> None:
    assert parse_formula("x /* a */ >= // b\n 0") == parse_formula("x >= 0")


def test_spans_lie_in_the_source_that_a_span_is_part_of() -> None:
    source = Source("model.kyx", "first\n  x + y*2 last")
    term = parse_term(Span(source, 8, 15))
    assert term.span.text == "x + y*2"
    assert term.span.place == "model.kyx:2:3"


# ---------------------------------------------------------------- programs


def test_if_is_a_choice_between_complementary_tests() -> None:
    c, a, b = PredOf("c", ()), ProgramConst("a"), ProgramConst("b")
    assert parse_program("if (c) {a;} else {b;}") == Choice(Compose(Test(c), a), Compose(Test(Not(c)), b))
    assert parse_program("if (c) {a;}") == Choice(Compose(Test(c), a), Test(Not(c)))


def test_a_star_after_else_belongs_to_its_block() -> None:
    assert parse_program("if (c) {a;} else {b;}*") == parse_program("{?c; a;} ++ {?!c; {b;}*}")


def test_if_is_no_reserved_word() -> None:
    assert parse_formula("if > 0") == Compare(">", Variable("if"), Number(Fraction(0)))


def test_one_extra_semicolon_after_a_statement_is_read_over() -> None:
    assert parse_program("x:=1;; {a;}; {x'=1};") == parse_program("x:=1; {a;} {x'=1}")


def test_duals_may_stand_before_or_after_the_semicolon_of_a_call() -> None:
    assert parse_program("a^@;") == parse_program("a;^@") == parse_program("a;^@;") == Dual(ProgramConst("a"))


def test_a_name_in_braces_without_semicolon_is_a_differential_program() -> None:
    assert parse_program("{c}") == ODESystem((DifferentialProgramConst("c"),), Truth(True))


def test_invariants_are_kept_beside_the_tree() -> None:
    loop = parse_program("{x:=1;}*@invariant(x >= old(x), x < 9)")
    assert isinstance(loop, Loop)
    assert loop.invariants == (parse_formula("x >= old(x)"), parse_formula("x < 9"))
    assert loop == parse_program("{x:=1;}*")
    ode = parse_program("{x'=1}@variant(x > 0)")
    assert isinstance(ode, ODESystem)
    assert ode.invariants == (parse_formula("x > 0"),)


@pytest.mark.parametrize("text", ["p && q", "p || q", "[x:=1]p", "[{?p}* {x:=1; ?q}]p", "p // comment"])
def test_what_keymaera_rejects_is_read_unless_strict(text: str) -> None:
    parse_formula(text)
    with pytest.raises(CompileError) as refused:
        parse_formula(text, strict=True)
    assert set(codes(refused.value)) == {"keymaera-rejects"}


def test_the_controller_of_the_paper_is_read() -> None:
    """Its first listing has `&&` and an assignment without `;`."""
    text = "if (v + A*ts < maxV && dist > stopDist(v + A*ts)) { a := A } else { a := -b; }"
    portable = "if (v + A*ts < maxV & dist > stopDist(v + A*ts)) { a := A; } else { a := -b; }"
    assert parse_program(text) == parse_program(portable, strict=True)


@pytest.mark.parametrize("hole", ["x > __________", "[{__________ & x > 0}]true", "[__________]__________"])
def test_holes_of_exercises_are_read_as_symbols(hole: str) -> None:
    assert "exercise" in repr(parse_formula(hole))


# ---------------------------------------------------------------- archives


def test_declarations_keep_sort_parameters_and_body() -> None:
    entry = read(
        model(
            "Real c, d; Real A = 5; Real f(Real x, Real y) = x + y; Bool p() <-> c > 0;"
            "HP ctrl ::= { x := c; }; HP plant ::= { x' = 1 & x < 2 }; HG g ::= { a;^@ };"
        )
    ).entries[0]
    shown = [
        (d.sort, d.name, d.parameters and tuple(p.name for p in d.parameters), d.body)
        for d in entry.definitions
    ]
    assert shown == [
        ("Real", "c", None, None),
        ("Real", "d", None, None),
        ("Real", "A", None, Number(Fraction(5))),
        ("Real", "f", ("x", "y"), parse_term("x + y")),
        ("Bool", "p", (), parse_formula("c > 0")),
        ("HP", "ctrl", None, parse_program("x := c;")),
        ("HP", "plant", None, parse_program("{x' = 1 & x < 2}")),
        ("HP", "g", None, parse_program("a;^@")),
    ]
    assert [d.span.text for d in entry.definitions] == [d.name for d in entry.definitions]


def test_imports_are_listed_in_full() -> None:
    entry = read(model("import kyx.math.abs; import kyx.math.{min, max}; import kyx.math.*;")).entries[0]
    assert entry.imports == ("kyx.math.abs", "kyx.math.min", "kyx.math.max", "kyx.math.*")


def test_sections_come_in_any_order_and_number() -> None:
    entry = read(
        'Theorem "T" ProgramVariables Real x; End. Definitions Real c; End. ProgramVariables Real y; End.'
        " Definitions Real d; End. Problem x = y End. End."
    ).entries[0]
    assert [d.name for d in entry.definitions] == ["c", "d"]
    assert [d.name for d in entry.variables] == ["x", "y"]


def test_shared_definitions_are_part_of_every_entry() -> None:
    shared_first = "package my.models\nDefinitions Real c; import kyx.math.abs; End.\n"
    archive = read(shared_first + 'Lemma "A" Problem true End. End. ' + model("Real d;"))
    assert [[d.name for d in entry.definitions] for entry in archive.entries] == [["c"], ["c", "d"]]
    assert [entry.imports for entry in archive.entries] == [("kyx.math.abs",)] * 2
    assert [entry.kind for entry in archive.entries] == ["Lemma", "ArchiveEntry"]


def test_labels_metadata_and_tactics_are_passed_over() -> None:
    entry = read(
        'Theorem thm1 : "The \\"name\\""\nDescription "of // it".\nProblem true End.\n'
        'Tactic "t" implyR(\'R) ; <( "x": QE, `foo` ) # /* End. */ "End." End.\n'
        'Citation "a book".\nEnd thm1.'
    ).entries[0]
    assert entry.name == 'The "name"'
    assert entry.problem == Truth(True)


def test_a_missing_last_end_is_a_warning() -> None:
    _, warnings = parse_archive(Source("m.kyx", 'Theorem "T" Problem true End.'))
    assert [warning.code for warning in warnings] == ["keymaera-rejects"]


def test_a_line_comment_inside_a_formula_is_warned_about_once() -> None:
    text = model(
        "// fine\nHP a ::= { // fine\n x:=1; };\nBool p() <-> ( // first\n true & // second\n true );"
    )
    _, warnings = parse_archive(Source("m.kyx", text))
    assert [warning.span.text for warning in warnings] == ["// first"]


def test_the_misspelt_package_of_the_paper_is_read_with_a_warning() -> None:
    archive, warnings = parse_archive(Source("m.kyx", model("import keyx.math.abs;")))
    assert archive.entries[0].imports == ("kyx.math.abs",)
    assert [warning.code for warning in warnings] == ["keymaera-rejects"]


# ---------------------------------------------------------------- bounds


@pytest.mark.parametrize(
    "text",
    [
        "(" * 10_000 + "x" + ")" * 10_000,
        "-" * 10_000 + "x",
        "^".join(["x"] * 5000),
        "+".join(["x"] * 5000),
        "*-".join(["x"] * 5000),
        "9" * 401,
    ],
)
def test_huge_terms_are_refused_not_crashed_on(text: str) -> None:
    with pytest.raises(CompileError) as refused:
        parse_term(text)
    assert codes(refused.value)[0] in ("too-deep", "too-many-digits")


@pytest.mark.parametrize(
    "text",
    [
        "!" * 10_000 + "p",
        "&".join(["p"] * 5000),
        "[a;]" * 5000 + "p",
        "[" + "a;" * 5000 + "]p",
        "[" + "{" * 5000,
    ],
)
def test_huge_formulas_are_refused_not_crashed_on(text: str) -> None:
    with pytest.raises(CompileError):
        parse_formula(text)


def test_trees_at_the_limit_can_be_compared_and_shown() -> None:
    text = "&".join(["p"] * 190)
    assert parse_formula(text) == parse_formula(text)
    nested: Expression = parse_term("(" * 90 + "x" + ")" * 90)
    assert repr(nested) == "Variable(name='x')"


def test_control_characters_are_only_a_warning_where_nothing_is_read() -> None:
    text = 'Theorem "c" /* a\x03b\x04 */\nProblem x>0 -> [x:=1;] x>0 End.\nTactic "t" a\x03 End.\nEnd.'
    archive, warnings = parse_archive(Source("c.kyx", text))
    assert [(d.severity, d.code, d.span.start) for d in warnings] == [("warning", "control-character", 16)]
    assert archive.entries[0].name == "c"
    with pytest.raises(CompileError) as refused:
        parse_archive(Source("c.kyx", text.replace("x:=1", "x:=\x031")))
    assert [d.code for d in refused.value.diagnostics] == ["control-character"]


def test_a_byte_order_mark_is_no_part_of_a_text() -> None:
    assert source_of("\ufeffTheorem\n").text == "Theorem\n"


def test_numbers_of_entries_are_told() -> None:
    archive, _ = parse_archive(Source("c.kyx", 'Theorem "c" Problem x>0 -> [x:=1;] x>0 End. End.'))
    with pytest.raises(CompileError, match="or its number, from 1 to 1"):
        entry_of(archive, "0")
