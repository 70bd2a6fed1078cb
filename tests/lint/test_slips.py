"""Every typical slip is named in words of dL, at its place, with advice; several in one run."""

import re

import pytest

from dl2c.diagnostics import CompileError
from dl2c.options import Options
from dl2c.pipeline import step_model
from dl2c.source import Source

MODEL = """ArchiveEntry "M"
Definitions
  Real A;
  Real half(Real y) = y/2;
  Bool p(Real y) <-> y > 0;
  HP ctrl ::= { v := 1; };
  DEFINITIONS
End.
ProgramVariables
  Real x, v, t;
  VARIABLES
End.
Problem
  START -> [{ PROGRAM }*]AFTER
End.
End.
"""
OLD = """Functions.
  R A.
  R half(R y) = (y/2).
  B p(R y) <-> (y > 0).
  P ctrl ::= { v := 1; }.
  DEFINITIONS
End.
ProgramVariables.
  R x. R v. R t.
  VARIABLES
End.
Problem.
  START -> [{ PROGRAM }*]AFTER
End.
"""
PARTS = {"DEFINITIONS": "", "VARIABLES": "", "START": "x = 0", "PROGRAM": "{x' = v}", "AFTER": "x >= 0"}

MARK = "¦"
"""In a slip it stands where the message points."""

PROGRAMS = {
    "x := 1¦ v := 2;": "missing `;`",
    "x := 1¦\n v := 2;": "missing `;`",
    "x := 1¦ ++ v := 2;": "missing `;`",
    "?x > 0¦ v := 1;": "missing `;`",
    "{ctrl¦}*": "missing `;`",
    "x ¦= 1;": "an assignment is written `:=`",
    "{x ¦= v & x < 9}": "an assignment is written `:=`",
    "?x ¦:= 1;": "`:=` assigns, it does not compare",
    "t := 0; x' ¦= 1;": "a differential equation needs its own braces",
    "{x' = v¦; t' = 1 & t < 1}": "differential equations are separated by `,`",
    "{x' = v & x < 9¦;}": "no `;` ends a differential equation",
    "{x' = v ¦t' = 1}": "`,` is missing between differential equations",
    "{¦& x < 1}": "a domain follows differential equations",
    "{x' = v, ¦& x < 1}": "a differential equation is missing after `,`",
    "{x' = v,¦}": "a differential equation is missing after `,`",
    "{x' = v ¦& }": "the domain is missing after `&`",
    "{x' = v, x ¦< 9}": "the domain follows `&`",
    "{x' = v ¦| x < 9}": "the domain follows `&`",
    "{x' = v, t ¦= 1}": "a differential equation needs its `'`",
    "{x' ¦== v}": "`==` is not an operator of dL",
    "{x' = v, ¦x' = 1}": "`x'` is declared twice",
    "{x¦' >= v}": "only differential equations can be run",
    "{x¦’ = v}": "this is not the prime `'`",
    "{¦}": "this program is empty",
    "{x := 1; ++ ¦}": "this program is empty",
    "x := 1; ++ ¦++ v := 2;": "a choice needs a program on both sides of `++`",
    "x := 1; ¦|| v := 2;": "a choice is written `++`",
    "x := 1; ¦+ v := 2;": "a choice is written `++`",
    "x := 1;¦*": "only a block can be repeated",
    "{x' = v}¦*": "only a block can be repeated",
    "¦(x := 1; ++ v := 2;)": "programs are grouped by braces",
    "¦while (x > 0) {x := 1;}": "dL has no `while`",
    "¦for (x := 0; x < 1; x++) {v := 1;}": "dL has no `for`",
    "if (x > 0) ¦x := 1;": "`if` needs braces",
    "¦if x > 0 {x := 1;}": "the condition of `if` needs parentheses",
    "if (x > 0) ¦then x := 1; else x := 2; fi": "dL has no `then`",
    "if (x > 0) {x := 1;} ¦else if (x < 0) {x := 2;}": "`else if` needs braces",
    "if (x > 0) {x := 1;} ¦elif (x < 0) {x := 2;}": "`else if` needs braces",
    "if (x > 0) {x := 1;} ¦else x := 2;": "`else` needs braces",
    "x := ¦if (v > 0) 1 else 2;": "`if` chooses a program, not a value",
    "x := v > 0 ¦? 1 : 2;": "dL has no `? :`",
    "x¦++;": "`++` chooses between programs, it does not count",
    "x¦--;": "`--` does not count",
    "x ¦+= 1;": "this is not an assignment of dL",
    "¦int x;": "a program declares no variables",
    "¦Real q;": "a program declares no variables",
    "¦return x;": "dL has no `return`",
    "ctrl¦();": "a program has no arguments",
    "x ¦> 0;": "a test begins with `?`",
    "x := 1¦, v := 2;": "assignments end with `;`",
    "¦else {x := 1;}": "`else` without `if`",
    "t := 0; ¦x' := 1;": "an assignment to a differential cannot be executed",
    "t := 0; ¦A := 1;": "a constant cannot change",
    "t := 0; ¦half := 1;": "expected a program variable",
    "t := 0; ¦skip;": "undefined program",
    "t := 0; ¦ctlr;": "undefined program",
    "x := ¦vv;": "undeclared variable",
    "x := ¦f(1);": "undeclared function",
    "x := ¦pow(v, 2);": "undeclared function",
    "x := ¦half(1, 2);": "wrong number of arguments",
    "x := ¦max(1, 2, 3);": "wrong number of arguments",
    "x := ¦A(1);": "expected a function",
    "x := ¦p(v);": "expected a function",
    "x := ¦true;": "expected a term, found a formula",
    "?¦v + 1;": "expected a formula, found a term",
    "?¦v;": "expected a formula",
}
FORMULAS = {
    "x ¦== 0": "`==` is not an operator of dL",
    "x = 0 ¦and v = 0": "`and` is not an operator of dL",
    "x = 0 ¦or v = 0": "`or` is not an operator of dL",
    "¦not x = 0": "`not` is not an operator of dL",
    "x ¦<> 0": "`<>` is not an operator of dL",
    "x ¦=! 0": "`=!` is not an operator of dL",
    "x ¦=< 5": "`=<` is not an operator of dL",
    "x = 0 ¦=> v = 0": "`=>` is not an operator of dL",
    "x = 0 ¦<=> v = 0": "`<=>` is not an operator of dL",
    "x¦<-5": "`<-` needs blanks around it",
    "0 <= x ¦<= 1": "comparisons do not chain",
    "x ¦:= 0": "`:=` assigns, it does not compare",
    "x = 0¦, v = 0": "conditions are joined by `&`",
    "x = 0¦;": "no `;` follows this",
    "¦(x = 0 & v = 0": "`(` is never closed",
    "x = 0 & v = 0¦)": "`)` closes nothing",
    "x = 0 & ¦& v = 0": "unexpected `&`",
    "x = ¦1e3": "numbers have no exponent",
    "x = ¦.5": "digits must precede the point of a number",
    "x = ¦5.": "digits must follow the point of a number",
    "x = ¦1,5": "numbers have a point, no comma",
    "x = ¦2v": "a product needs its `*`",
    "x = v ¦t": "an operator is missing",
    "x¦**2 = 1": "`**` is not an operator of dL",
    "x = ¦+1": "numbers have no sign `+`",
    "x = ¦|v|": "absolute values have no bars in dL",
    "x = v ¦mod 2": "dL has no remainder of a division",
    "x = 1 ¦− 2": "this is not the minus sign `-`",
    "x ¦⩽ 1": "this is not a comparison of dL",
    "x ¦· 2 = 1": "this is not the product sign `*`",
    "x¦² = 1": "powers are written `^`",
    "x¦₁ = 1": "an index is written `_`",
    "¦xα = 1": "names consist of the letters A to Z and digits",
    "¦my_var = 1": "`my_var` is not a name of dL",
    "¦x_01 = 1": "`x_01` is not a name of dL",
    "x¦’ = 1": "this is not the prime `'`",
    "x = ¦“a”": "dL has no text",
    "¦x.y = 1": "names have no `.`",
    "¦x[0] = 1": "dL has no arrays",
    "¦True": "undeclared predicate",
    "¦\\forall(y > 0)": "a blank must follow a quantifier",
    "¦∀y (y > 0)": "a blank must follow a quantifier",
    "¦\\forall y. y > 0": "no `.` follows a quantifier",
    "¦\\forall y:Real y > 0": "quantified variables have no sort",
    "¦forall y (y > 0)": "quantifiers start with a backslash",
    "[ctrl¦]x = 1": "missing `;`",
    "x + (¦v > 0) = 1": "expected a term, found a formula",
    "x = 0 & ¦v": "expected a formula",
    "¦half(x)": "expected a formula",
    "¦p": "wrong number of arguments",
    "¦X = 1": "undeclared variable",
    "¦# x = 1": "this character is not part of dL",
    "x = 0 ¦/* a": "comment is never closed",
}
DEFINITIONS = {
    "Real c = 1¦, d = 2;": "a declaration defines one name",
    "Real c = 5¦\n  Real d = 6;": "missing `;`",
    "Real c¦": "missing `;`",
    "HP a ::= { x := 1; }¦": "missing `;`",
    "¦Bool q = x > 0;": "`Bool` is not defined with `=`",
    "¦Real c <-> 1;": "`Real` is not defined with `<->`",
    "Real c ¦:= 1;": "`Real` is not defined with `:=`",
    "HP a ¦= { x := 1; };": "`HP` is not defined with `=`",
    "HP a ¦{ x := 1; };": "`HP` is not defined with `{`",
    "HP a ::= ¦x := 1;": "the definition of a program needs braces",
    "HP ¦a() ::= { x := 1; };": "programs have no parameters",
    "HP ¦a;": "program `a` has no definition",
    "¦int c;": "unexpected `int`",
    "¦const Real c = 5;": "unexpected `const`",
    "¦c = 5;": "unexpected `c`",
    "Real c, ¦Real d;": "the sort is written once",
    "Real c ¦d;": "names are separated by `,`",
    "Real f(¦y) = y;": "a parameter needs its sort",
    "Real f¦(Real y = y;": "`(` is never closed",
    "Real ¦my_var;": "`my_var` is not a name of dL",
    "Real ¦End;": "`End` is a reserved word",
    "Real c¦';": "derivatives are not declared",
    "Real c = ¦1e3;": "numbers have no exponent",
    "Real ¦A;": "`A` is declared twice",
    "¦import math;": "malformed import",
    "Real c = 5; ¦}": "unexpected `}`",
}
VARIABLES = {
    "¦Real y = 5;": "a program variable has no definition",
    "Real y¦": "missing `;`",
    "¦int y;": "unexpected `int`",
    "Real y ¦:= 5;": "`Real` is not defined with `:=`",
    "Real ¦x;": "`x` is declared twice",
    "¦HP h;": "program variables are of sort Real",
}
SECTIONS = (
    ("End.\nProgram", "¦End\nProgram", "`End` is not `End.`"),
    ("End.\nProgram", "¦END.\nProgram", "`END.` is not `End.`"),
    ("\nDefinitions", "\n¦definitions", "unexpected `definitions`"),
    ("\nProgramVariables", "\n¦ProgramVariable", "unexpected `ProgramVariable`"),
    ("Definitions\n", "Definitions¦:\n", "unexpected `:`"),
    ("Problem\n", "Problem¦:\n", "no `:` follows a section word"),
    ("AFTER\nEnd.\nEnd.\n", "AFTER", "Problem is not ended"),
    ('ArchiveEntry "M"', "¦ArchiveEntry M", "the name of an entry needs quotes"),
    ("AFTER", "x >= 0 & ¦v >= 0", "a condition beside the program is not part of an environment"),
    ("}*]", "}¦+]", "a choice is written `++`, a loop `{ ... }*`"),
    ("[{", "¦{", "unexpected `{`"),
)
PLACES = {"PROGRAM": PROGRAMS, "START": FORMULAS, "DEFINITIONS": DEFINITIONS, "VARIABLES": VARIABLES}
SLIPS = [
    *((part, slip, title) for part, slips in PLACES.items() for slip, title in slips.items()),
    *SECTIONS,
]
CODES = (
    ("chained", r"comparisons do not chain"),
    ("never-closed", r".* is never closed"),
    ("bad-name", r"`.*` is (not a name of dL|a reserved word)"),
    ("wrong-sort", r"expected a .*|`.*` is not defined with `.*`|program.* (parameters|of sort Real)"),
    ("wrong-arity", r"wrong number of arguments"),
    ("undefined-program", r"undefined program|program `.*` has no definition"),
    ("undeclared-variable", r"undeclared variable"),
    ("undeclared-function", r"undeclared function"),
    ("undeclared-predicate", r"undeclared predicate"),
    ("duplicate-declaration", r"`.*` is declared twice"),
    ("defined-variable", r"a program variable has no definition"),
    ("constant-written", r"a constant cannot change"),
    ("differential", r"an assignment to a differential cannot be executed"),
    ("section-not-ended", r".* is not ended"),
    ("condition-beside-program", r"a condition beside the program .*"),
    ("syntax", r".*"),
)
"""Codes and the titles that have them; the first that fits counts."""


def diagnostics(text: str) -> list[tuple[str, str, int]]:
    """Code, title and offset of every message."""
    with pytest.raises(CompileError) as refused:
        step_model(Source("slip.kyx", text), Options())
    assert all(d.label or d.help for d in refused.value.diagnostics), str(refused.value)
    return [(d.code, d.title, d.span.start) for d in refused.value.diagnostics]


def filled(model: str, **parts: str) -> str:
    for name, text in (PARTS | parts).items():
        model = model.replace(name, text)
    return model


@pytest.mark.parametrize(("part", "slip", "title"), SLIPS)
def test_a_slip_is_named_at_its_place_with_advice(part: str, slip: str, title: str) -> None:
    text = filled(MODEL.replace(part, slip))
    place = text.find(MARK)
    (code, found, at), *others = diagnostics(text.replace(MARK, ""))
    assert found == title
    assert code == next(code for code, titles in CODES if re.fullmatch(titles, title))
    assert place in (-1, at)
    assert not others, "one slip, one message"


def test_there_are_many_slips() -> None:
    assert len({title for _, _, title in SLIPS}) >= 100


@pytest.mark.parametrize("slip", [slip for slip in PROGRAMS if PROGRAMS[slip] != "missing `;`"])
def test_a_slip_hides_no_later_one(slip: str) -> None:
    """Reading goes on at the end of the statement."""
    first = diagnostics(filled(MODEL, PROGRAM=slip.replace(MARK, "")))
    code, title, _ = first[0]
    later = "x := 1; ?0 <= v <= 1; {x' = v; t' = 1} v := 1e3;"
    if code in ("syntax", "bad-name", "chained"):
        found = [
            title for _, title, _ in diagnostics(filled(MODEL, PROGRAM=f"{slip.replace(MARK, '')} {later}"))
        ]
        assert found == [
            title,
            "comparisons do not chain",
            "differential equations are separated by `,`",
            "numbers have no exponent",
        ]


@pytest.mark.parametrize("model", [MODEL, OLD], ids=["new", "old"])
def test_slips_everywhere_are_told_in_one_run(model: str) -> None:
    declared = "Real c = 1e3; Real d == 2; HP a ::= { x = 1; v := my_var; }; Bool q <-> true and true;"
    if model is OLD:
        declared = re.sub(
            r"Real|Bool|HP", lambda sort: {"Real": "R", "Bool": "B", "HP": "P"}[sort.group()], declared
        )
        declared = re.sub(r";(?= [RBP] |$)", ".", declared)
    text = filled(
        model,
        DEFINITIONS=declared,
        START="x == 0 & 0 <= v <= 1",
        PROGRAM="while (x > 0) {x := 1;} {x' = v; t' = 1}",
        AFTER="x >= 0 or v >= 0",
    )
    assert [title for _, title, _ in diagnostics(text)] == [
        "numbers have no exponent",
        "`==` is not an operator of dL",
        "an assignment is written `:=`",
        "`my_var` is not a name of dL",
        "`and` is not an operator of dL",
        "`==` is not an operator of dL",
        "comparisons do not chain",
        "dL has no `while`",
        "differential equations are separated by `,`",
        "`or` is not an operator of dL",
    ]
