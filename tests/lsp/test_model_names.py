"""What the language server knows of names: occurrences, renaming, what is said of them. No server here."""

import re
from pathlib import Path

import pytest
from conftest import REPOSITORY, shared
from corpus_table import SUFFIXES

from dl2c.lint.check import examined
from dl2c.lint.edits import Edit
from dl2c.lsp.analysis import Analysis, analyse
from dl2c.lsp.hover import hover
from dl2c.lsp.names import Occurrence
from dl2c.lsp.rename import Refused, renamable, rename
from dl2c.options import Options
from dl2c.pipeline import Compilation
from dl2c.source import Source

EXAMPLES = sorted((REPOSITORY / "examples").rglob("*.kyx"))
NAMES = {path.relative_to(REPOSITORY / "examples").as_posix(): path for path in EXAMPLES}
WORDS = {
    *("Real", "Bool", "HP", "implicit", "import", "true", "false", "if", "else", "forall", "exists"),
    *("invariant", "variant", "kyx", "math"),
}

MODEL = """SharedDefinitions
  Real g;
  Real twice(Real x) = 2 * x;
  Bool above(Real x) <-> x >= y & \\forall z (z > x | g = z);
End.

ArchiveEntry "One"
Definitions
  Real c;
  /* @progress: reward={twice(x) - c}, shape=-x, on_success=terminate */
  Bool near(Real x) <-> x <= twice(c);
  implicit Real co(Real s), si(Real s) = {{s := 0; co := 1; si := 0;} {s' = 1, co' = -si, si' = co}};
  HP ctrl ::= { x := twice(x); };
End.
ProgramVariables
  /* @var: bound=[0:1], unit="m", def="place" */
  Real x;
  Real y;
End.
Problem
  x = 0 -> [{ ctrl; {x' = c & above(x)}@invariant(old(x) <= x) }*@invariant(x >= c)] near(x)
End.
End.

ArchiveEntry "Two"
ProgramVariables
  Real w, y;
End.
Problem
  above(w) -> [{ w := w + g; }*] above(w)
End.
Tactic "Proof" loop("y >= g", 1) End.
End.
"""


def analysed(text: str, name: str = "model.kyx") -> Analysis:
    return analyse(Source(name, text), Options())


def at(analysis: Analysis, mark: str, within: int = 0) -> int:
    return analysis.source.text.index(mark) + within


def lines_of(analysis: Analysis, mark: str, within: int = 0) -> list[int]:
    """The lines of all occurrences of the name at a place."""
    (occurrence,) = analysis.names.at(at(analysis, mark, within))
    places = analysis.names.of(occurrence.symbol)
    return [analysis.source.position(o.start)[0] for o in places]


def renamed(analysis: Analysis, offset: int, new: str) -> str:
    text = analysis.source.text
    for edit in reversed(rename(analysis, offset, new).edits):
        text = text[: edit.start] + edit.text + text[edit.end :]
    return text


def pattern(analysis: Analysis) -> list[tuple[int, str]]:
    """Which names are the same: of every occurrence the number of the first of its symbol, and its use."""
    first: dict[int, int] = {}
    found = analysis.names.occurrences
    for number, o in enumerate(found):
        first.setdefault(id(o.symbol), number)
    return [(first[id(o.symbol)], o.use) for o in found]


def declared(analysis: Analysis) -> list[Occurrence]:
    """An occurrence of every symbol that can be renamed."""
    found: dict[int, Occurrence] = {}
    for o in analysis.names.occurrences:
        if o.symbol.kind != "library":
            found.setdefault(id(o.symbol), o)
    return list(found.values())


@pytest.mark.parametrize("path", NAMES.values(), ids=NAMES)
def test_every_name_of_an_example_is_known(path: Path) -> None:
    analysis = analysed(Source.read(path).text)
    assert analysis.code is not None and analysis.readable
    known = {o.start for o in analysis.names.occurrences}
    for section in analysis.sections:
        if section.kind in ("Definitions", "ProgramVariables", "Problem"):
            words = re.finditer(r"(?<![\w.])[A-Za-z]\w*", analysis.code.text[section.begin : section.end])
            missing = [w.group() for w in words if section.begin + w.start() not in known]
            assert not set(missing) - WORDS


def test_names_stand_for_what_their_scope_says() -> None:
    analysis = analysed(MODEL)
    assert not [d for d in analysis.diagnostics if d.severity == "error"]
    assert lines_of(analysis, "Real x) = 2", 5) == [3, 3]
    assert lines_of(analysis, "Real c;", 5) == [9, 10, 11, 21, 21]
    assert lines_of(analysis, "z (z", 0) == [4, 4, 4]
    assert lines_of(analysis, "near(Real x)", 10) == [10, 10, 11, 11]
    assert lines_of(analysis, "  Real x;", 7) == [13, 13, 17, *[21] * 7]
    assert lines_of(analysis, "  Real g;", 7) == [2, 4, 30]
    assert lines_of(analysis, "co(Real s)", 0) == [12] * 4
    assert lines_of(analysis, "co(Real s)", 8) == [12] * 4
    shared_y = analysis.names.at(at(analysis, "x >= y", 5))
    assert {o.symbol.name for o in shared_y} == {"y"} and len(shared_y) == 2


def test_what_shares_a_place_is_renamed_together() -> None:
    analysis = analysed(MODEL)
    text = renamed(analysis, at(analysis, "Real y;", 5), "height")
    assert re.findall(r"\by\b", text) == ["y"] and text.count("height") == 3  # the tactic stays
    assert pattern(analysed(text)) == pattern(analysis)
    assert rename(analysis, at(analysis, "Real g;", 5), "grow").tactics == ("Two",)


@pytest.mark.parametrize(
    ("mark", "within", "new", "why"),
    [
        ("Real c;", 5, "x", "another parameter"),
        ("Real c;", 5, "1c", "not a name"),
        ("Real c;", 5, "Real", "not a name"),
        ("Real c;", 5, "if", "not a name"),
        ("Real c;", 5, "c ", "not a name"),
        ("Real c;", 5, "x'", "not a name"),
        ("Real c;", 5, "a_01", "not a name"),
        ("Real c;", 5, "été", "not a name"),
        ("Real c;", 5, "max", "library"),
        ("Real c;", 5, "old", "library"),
        ("Real g;", 5, "z", "another quantified there"),
        ("Real g;", 5, "c", "another constant"),
        ("z (z", 0, "x", "another parameter"),
        ("z (z", 0, "g", "another constant"),
        ("twice(Real x", 11, "twice", ""),
        ("near(Real x", 10, "c", "another constant"),
        ("near(Real x", 10, "twice", "another function"),
        ("old(x)", 0, "new", "belongs to the library"),
        ("Problem", 0, "new", "no name of the model"),
    ],
)
def test_names_that_clash_or_are_none_are_refused(mark: str, within: int, new: str, why: str) -> None:
    analysis = analysed(MODEL)
    if not why:
        assert pattern(analysed(renamed(analysis, at(analysis, mark, within), new))) == pattern(analysis)
        return
    with pytest.raises(Refused, match=why):
        rename(analysis, at(analysis, mark, within), new)


def test_nothing_is_renamed_while_there_are_errors_of_syntax() -> None:
    broken = analysed(MODEL.replace("2 * x;", "2 * ;"))
    with pytest.raises(Refused, match="errors of syntax"):
        renamable(broken, at(broken, "Real c;", 5))


@pytest.mark.parametrize("path", NAMES.values(), ids=NAMES)
def test_each_name_of_an_example_can_be_renamed(path: Path) -> None:
    """All at once: then every name stands for the same as before, and the checks that need no solver find the
    same."""
    source = Source.read(path)
    analysis = analysed(source.text, source.name)
    edits: dict[int, Edit] = {}
    for number, occurrence in enumerate(declared(analysis)):
        if occurrence.start not in edits:
            found = rename(analysis, occurrence.start, f"renamed_{number}").edits
            edits |= {edit.start: edit for edit in found}
    text = source.text
    for edit in sorted(edits.values(), key=lambda e: e.start, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.end :]
    after = analysed(text, source.name)
    assert after.readable and pattern(after) == pattern(analysis)
    assert all(o.symbol.name.startswith("renamed_") for o in declared(after))
    codes = [
        [d.code for d in examined(model, Compilation(model, Options()), solving=False)]
        for model in (source, after.source)
    ]
    assert codes[0] == codes[1]


@pytest.mark.slow
@pytest.mark.parametrize("path", NAMES.values(), ids=NAMES)
def test_no_renaming_changes_what_check_says(path: Path) -> None:
    """Every name, to a new one, and to every other name of the model unless that is refused."""
    source = Source.read(path)
    analysis = analysed(source.text, source.name)
    wanted = [d.code for d in examined(source, Compilation(source, Options()))]
    others = sorted({o.symbol.name for o in declared(analysis)})
    for occurrence in declared(analysis):
        model = Source(source.name, renamed(analysis, occurrence.start, "another"))
        assert [d.code for d in examined(model, Compilation(model, Options()))] == wanted
        for other in others:
            try:
                text = renamed(analysis, occurrence.start, other)
            except Refused:
                continue
            assert pattern(analysed(text, source.name)) == pattern(analysis), (occurrence.symbol.name, other)


@pytest.mark.slow
def test_names_of_public_models_can_be_renamed() -> None:
    """One of each file that can be read: what is found in the text afterwards has the same codes."""
    for path in sorted(p for p in shared("corpus").rglob("*") if p.suffix in SUFFIXES):
        analysis = analysed(Source.read(path).text)
        if not analysis.readable:
            continue
        for occurrence in declared(analysis)[:: max(1, len(declared(analysis)) // 3)]:
            after = analysed(renamed(analysis, occurrence.start, "renamed_7"))
            assert pattern(after) == pattern(analysis), path
            assert [d.code for d in after.diagnostics] == [d.code for d in analysis.diagnostics], path


def test_a_function_of_the_library_may_be_declared() -> None:
    text = MODEL.replace("  Real g;", "  Real g;\n  Real max(Real x, Real y);")
    analysis = analysed(text.replace("2 * x", "max(x, x)"))
    assert not [d for d in analysis.diagnostics if d.severity == "error"]
    (found,) = analysis.names.at(at(analysis, "max(x, x)"))
    assert found.symbol.place is not None and found.symbol.place.line == 3
    with pytest.raises(Refused, match="library"):
        rename(analysis, at(analysis, "max(x, x)"), "largest")


def test_a_parameter_without_call_is_renamed_with_its_variable() -> None:
    path = NAMES["rewards/distance.kyx"]
    analysis = analysed(Source.read(path).text)
    text = renamed(analysis, at(analysis, "Real x;", 5), "place")
    assert "home(Real place)" in text and not analysed(text).diagnostics


@pytest.mark.parametrize(
    ("mark", "within", "said"),
    [
        ("ctrl; {x'", 0, ("HP ctrl ::=", "program", "expanded", "x := 2*x;")),
        ("  Real x;", 7, ("program variable", "unit `m`", "place", "bound `[0:1]`", "`ctrl` (line 13)")),
        ("near(x)", 0, ("Bool near(Real x) <-> x <= twice(c)", "x <= 2*c", "@progress", "reward")),
        ("co(Real", 0, ("Real co(Real s) =", "function")),
        ("Real c;", 5, ("Real c", "constant")),
        ("Real x) = 2", 5, ("parameter of `twice`",)),
        ("z (z", 0, ("quantifier",)),
        ("old(x)", 0, ("in an invariant",)),
        ("@var:", 1, ("above a program variable",)),
        ("unit=", 1, ("unit",)),
        ("HP ctrl", 0, ("hybrid program",)),
    ],
)
def test_what_is_said_of_a_name(mark: str, within: int, said: tuple[str, ...]) -> None:
    analysis = analysed(MODEL)
    found = hover(analysis, at(analysis, mark, within))
    assert found is not None and [words for words in said if words not in found[0]] == []


def test_a_variable_that_nothing_writes_says_so() -> None:
    analysis = analysed(Source.read(NAMES["static_safety.kyx"]).text)
    found = hover(analysis, at(analysis, "Real gx;", 5))
    assert found is not None and "nothing writes it" in found[0]


@pytest.mark.parametrize(
    ("change", "kept"),
    [
        (("2 * x;", "2 * ;"), "near"),
        (("x := twice(x);", "x := ;"), "ctrl"),
        (("near(x)\nEnd.", "near(x\nEnd."), "near"),
        (("Problem\n  x = 0", "Problem\n  x = = 0"), "twice"),
        (("/* @var", "/* unclosed\n/* @var"), "near"),
        (("\n  Real y;\nEnd.\nProblem\n  x", "\n  Real y;\nEnd.\n/* @ep\nProblem\n  x"), "near"),
        (('unit="m"', 'unit="m'), "near"),
        (("Real c;", "Real c; \x00"), "near"),
        (("Problem\n  above(w) -> [{ w := w + g; }*] above(w)\nEnd.", ""), "above"),
    ],
)
def test_a_syntax_error_does_not_silence_the_rest(change: tuple[str, str], kept: str) -> None:
    assert change[0] in MODEL
    broken = analysed(MODEL.replace(*change, 1))
    assert broken.diagnostics and {o.symbol.name for o in broken.names.occurrences} >= {kept, "x", "y", "g"}
    wrong = analysed(MODEL.replace(*change, 1).replace("-x, on_success", "-x, on_sucess"))
    assert [
        d.code for d in wrong.diagnostics if d not in broken.diagnostics and "sucess" in d.title + d.label
    ]
