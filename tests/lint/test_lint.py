"""What `dl2c check` finds, silences and corrects."""

import json
import re
from pathlib import Path
from random import Random
from typing import Any

import pytest
from commands.test_cli import run
from generators.ir_builder import formula
from generators.lint_models import CASES, MODEL, Parts, varied
from hypothesis import given
from hypothesis import strategies as st
from selection import few_and_many_examples
from test_model_errors import mutated

from dl2c.commands.check import table_of_codes
from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.ir.model import Symbol
from dl2c.lint.check import examine
from dl2c.lint.codes import CODES, LINTS
from dl2c.lint.edits import Edit, edited
from dl2c.lint.fix import edits_of
from dl2c.lint.suggest import suggestions
from dl2c.lint.units import shown, unit_of
from dl2c.options import Options
from dl2c.smt.query import Impossible, Oracle
from dl2c.source import NOWHERE, Source

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").rglob("*.kyx"))

SLIPS = MODEL.replace("x <= 1 & A > 0", "x <= 1 && A > 0 // as\n  & 2 < -8/-A/2").replace(
    "a := -A;}", "{a := -A} }  // brake:\n     // at once\n"
).replace(', unit="m/s^2"', "").removesuffix("End.\n")  # fmt: skip
"""Everything that can be corrected."""


def found(text: str, **options: Any) -> tuple[Diagnostic, ...]:
    return examine(Source("model.kyx", text), resolve_options(options))


def codes(text: str, **options: Any) -> set[str]:
    return {d.code for d in found(text, **options)}


@pytest.mark.parametrize(("code", "faulty", "faultless"), CASES, ids=[c for c, _, _ in CASES])
def test_each_fault_is_found_where_it_is(code: str, faulty: Parts, faultless: Parts) -> None:
    wrong = [d for d in found(varied(faulty)) if d.code == code]
    assert wrong and codes(varied(faultless)) == set()
    for diagnostic in wrong:
        assert diagnostic.severity == "warning" and diagnostic.span != NOWHERE
        assert diagnostic.help and not diagnostic.help.endswith(".")


def test_every_code_has_a_model() -> None:
    assert list(CODES) == sorted(set(CODES))
    elsewhere = {"undecided-precondition", "no-annotations"}
    assert {code for code, _, _ in CASES} | elsewhere == set(CODES)


def test_a_model_without_annotations_is_told_so_once() -> None:
    text = re.sub(r"/\* @.*\*/", "", MODEL).replace("x <= 1", "0 <= x & x <= 1 & v = 1 & a = 0 & A < 2")
    assert codes(text) == {"no-annotations"}
    assert codes(text, observation_bounds="unbounded") == set()


def test_an_undecided_precondition_is_a_warning() -> None:
    text = MODEL.replace("x <= 1", "x <= 1 & exp(v) = 2").replace(
        "Real ep = 1;", "import kyx.math.exp; Real ep = 1;"
    )
    assert codes(text) & {"undecided-precondition", "unsampled-precondition"}


@pytest.mark.parametrize(("code", "faulty", "faultless"), CASES, ids=[c for c, _, _ in CASES])
def test_every_code_can_be_allowed(code: str, faulty: Parts, faultless: Parts) -> None:
    text = varied(faulty)
    if "@episode" not in text:
        text = text.replace("Problem", f"/* @episode: allow=deadlock|{code} */\nProblem")
        assert code not in codes(text)


def test_errors_cannot_be_allowed() -> None:
    text = MODEL.replace("x <= 1", "x <= -1").replace(
        "Problem", "/* @episode: allow=unsatisfiable-precondition */\nProblem"
    )
    assert [(d.severity, d.code) for d in found(text)] == [("error", "unsatisfiable-precondition")]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_have_no_faults(path: Path) -> None:
    assert examine(Source.read(path), Options(), portable=True) == ()


def test_the_table_has_every_code() -> None:
    assert re.findall(r"^\| `([a-z-]+)` \|", table_of_codes(), flags=re.M) == [lint.code for lint in LINTS]


def test_a_deadlock_is_shown() -> None:
    (faulty,) = [c[1] for c in CASES if c[0] == "deadlock" and "?x < 5" in str(c[1])]
    (diagnostic,) = found(varied(faulty))
    assert "x = 5" in diagnostic.notes[0] and diagnostic.span.text == "safe(x) & v >= 0"


def test_a_flow_ends_in_its_domain() -> None:
    """States outside it are neither deadlocks nor violations."""
    text = MODEL.replace("@invariant(safe(x) & v >= 0)", "@invariant(safe(x))")
    assert codes(text) == codes(text.replace("]safe(x)", "](safe(x) & v >= 0)")) == set()
    assert codes(text.replace("HP ctrl ::= {", "HP ctrl ::= { ?v > 0;")) == {"deadlock"}


def test_units_are_read_and_shown() -> None:
    assert unit_of("m/s^2") == unit_of("m s^-2") == {"m": 1, "s": -2}
    assert unit_of("1/s") == {"s": -1} and unit_of("rad") == {} and unit_of("m^") is None
    assert [shown(unit_of(t) or {}) for t in ("kg*m/s^2", "1/min", "rad")] == ["kg*m/s^2", "1/min", "no unit"]


# What Z3 is asked --------------------------------------------------------------


def test_questions_have_true_answers() -> None:
    oracle = Oracle()
    x, u = Symbol("x", "variable"), Symbol("u", "variable")
    assert oracle.exists([formula("x > 1 and x < 1")]).verdict == "no"
    assert oracle.exists([formula("x*x == 4 and x > 0")], shown=["x"]).witness == {"x": 2}
    assert oracle.exists([formula("exp(x) > 0")]).verdict == "unknown"
    assert (
        oracle.exists([formula("exp(x) > 0 and x > 0"), formula("x < 0"), formula("x > 0")]).verdict == "no"
    )
    squares = Impossible((u,), formula("u*u == x"))
    assert oracle.exists([formula("x > 3")], [squares]).verdict == "no"
    assert oracle.exists([], [squares], ["x"]).witness["x"] < 0
    assert oracle.exists([], [Impossible((x,), formula("sqrt(x) > 1"))]).verdict == "unknown"
    assert oracle.exists([formula("x < 5")], [Impossible((), formula("sqrt(x) > 1"))]).verdict == "yes"


def test_values_that_double_are_forgotten() -> None:
    double = "x := x + x; t := 0; {t' = 1 & t <= 0.01} "
    assert "constant-test" not in codes(
        MODEL.replace("{ctrl; drive;}*", "{" + 60 * double + "?x < 5; drive;}*")
    )


def test_questions_end_in_time() -> None:
    oracle = Oracle(each=0.2, total=0.4)
    hard = formula("x**5*y**3 + y**7 - x*z**4 == 3 and x**3 - y**5*z**3 > 1 and z**7 + x**5*y == 2.5")
    for _ in range(5):
        oracle.exists([hard])
    assert oracle.spent < 3
    assert Oracle(total=0).exists([]).verdict == "unknown"


# Portability and corrections ---------------------------------------------------


def test_portability_is_an_error_on_demand(capsys: Any, tmp_path: Path) -> None:
    path = tmp_path / "slips.kyx"
    path.write_text(SLIPS)
    code, out, _ = run(capsys, "check", "--json", str(path))
    assert code == 0 and {d["severity"] for d in json.loads(out)} == {"warning"}
    code, out, _ = run(capsys, "check", "--json", "--portable", str(path))
    wrong = [d for d in json.loads(out) if d["severity"] == "error"]
    assert code == 1 and {d["code"] for d in wrong} == {"keymaera-rejects"}
    assert len([d for d in wrong if d["text"].startswith("//")]) == 3


@pytest.mark.parametrize(
    ("old", "new", "title"),
    [
        ("Real t;", "Real t; /* Gr\u00f6\u00dfe */", "this character"),
        ("x <= 1", "abs(x) <= 1", "`abs` without an import"),
        ("Real ep", "import keyx.math.abs; Real ep", "`keyx`"),
    ],
)
def test_what_5_0_2_refuses_is_found(old: str, new: str, title: str) -> None:
    wrong = examine(Source("m.kyx", MODEL.replace(old, new)), Options(), portable=True)
    assert {title in d.title for d in wrong if d.severity == "error"} == {True}


@pytest.mark.parametrize("text", ['Real t; // "after"', "// above\n  Real t;", 'Real t; /* "\\forall" */'])
def test_what_5_0_2_reads_is_not_found(text: str) -> None:
    assert examine(Source("m.kyx", MODEL.replace("Real t;", text)), Options(), portable=True) == ()


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_fixing_leaves_nothing_to_fix(capsys: Any, tmp_path: Path, ending: str, mark: bytes) -> None:
    path = tmp_path / "slips.kyx"
    path.write_bytes(mark + SLIPS.replace("\n", ending).encode())
    path.chmod(0o640)
    code, out, _ = run(capsys, "check", "--fix", "--portable", str(path))
    assert code == 0 and out.startswith(f"{path}: 7 corrections, no errors, 0 warnings\n")
    text = path.read_bytes()
    assert text.startswith(mark) and text.count(ending.encode()) == text.count(b"\n")
    for piece in (
        b"& 2 < -8/(-(A/2))",
        b"{a := -A;}",
        b"x <= 1 & A > 0 /* as */",
        b"/* brake:",
        b"at once */",
        b"End.",
    ):
        assert piece in text
    assert path.stat().st_mode & 0o777 == 0o640 and [p.name for p in tmp_path.iterdir()] == [path.name]
    code, out, _ = run(capsys, "check", "--fix", str(path))
    assert "0 corrections" in out and path.read_bytes() == text


def test_an_annotation_over_several_line_comments_survives_correction(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "choice.kyx"
    choice = '// @choice: name="pedal",\n  //   role=env\n  {a := A;'
    path.write_text(MODEL.replace("{a := A;", "a := 0; " + choice))
    before = run(capsys, "emit", "--stage", "ir", str(path))[1]
    assert "env" in before
    run(capsys, "check", "--fix", str(path))
    assert "//" not in path.read_text() and run(capsys, "emit", "--stage", "ir", str(path))[1] == before


def test_files_that_cannot_be_corrected_stay_as_they_are(capsys: Any, tmp_path: Path) -> None:
    path = tmp_path / "broken.kyx"
    path.write_text("Theorem // no\n")
    code, _, err = run(capsys, "check", "--fix", str(path))
    assert code == 1 and "error" in err and path.read_text() == "Theorem // no\n"
    assert run(capsys, "check", "--fix", "example:acc")[0] == 1


pieces = st.lists(st.sampled_from(["a", "b", "\u00e4", "\n", "\r\n"]), max_size=20)
ranges = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 3)), max_size=3)


@given(st.sampled_from(["", "\ufeff"]), pieces, ranges)
def test_edits_leave_all_other_bytes(mark: str, parts: list[str], places: list[tuple[int, int]]) -> None:
    content = (mark + "".join(parts)).encode()
    plain = "".join(parts).replace("\r\n", "\n")
    edits = [Edit(min(a, len(plain)), min(a + n, len(plain)), "") for a, n in places]
    kept = list(plain)
    done = 0
    for edit in sorted(edits, key=lambda e: (e.start, e.end)):
        if edit.start >= done:
            kept[edit.start : edit.end] = [""] * (edit.end - edit.start)
            done = max(done, edit.end)
    assert edited(content, []) == content
    result = edited(content, edits).decode()
    assert result.startswith(mark) and result.replace("\r\n", "\n") == mark + "".join(kept)


def test_codes_are_listed(capsys: Any) -> None:
    assert run(capsys, "check", "--list-codes") == (0, table_of_codes() + "\n", "")
    fixable = {lint.code for lint in LINTS if lint.fixable}
    assert fixable == {"keymaera-rejects", "minus-in-quotient", "undeclared-names"}


# Whatever is written -----------------------------------------------------------


@few_and_many_examples(15, 60, st.integers(0, 10**9))
def test_any_model_is_examined_corrected_and_annotated(seed: int) -> None:
    source = Source("any.kyx", mutated(MODEL, Random(seed)))
    examined = examine(source, Options(), portable=True)
    assert all(d.code in CODES for d in examined if d.severity == "warning")
    try:
        corrected = edited(source.text.encode(), edits_of(source)).decode()
        assert not tuple(edits_of(Source("any.kyx", corrected)))
        suggestions(source, Options())
    except CompileError as refused:
        assert str(refused)
