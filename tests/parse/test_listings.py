"""The paper's listings: what each one does, fixed in advance.

Short snippets stand here in models around them. The two long listings are taken from the text of
the paper where that is at hand; each correction that they need is named.
"""

import re
from collections import Counter
from collections.abc import Callable

import pytest
from conftest import shared
from generators.kyx_builder import model_text

from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.pipeline import check_model, emit
from dl2c.source import Source

Outcome = Counter[str]


def outcome(text: str, **options: object) -> tuple[str, Outcome, tuple[Diagnostic, ...]]:
    """`builds` with the codes of warnings, or `error` with the codes of errors."""
    source, chosen = Source("listing.kyx", text), resolve_options(options)
    try:
        found = check_model(source, chosen)
    except CompileError as refused:
        found = refused.diagnostics
        return "error", Counter(d.code for d in found), found
    assert emit(source, "c", chosen)
    return "builds", Counter(d.code for d in found), found


def printed(beginning: str) -> str:
    """A numbered listing of the paper, from the line that begins so to the last of its blocks.

    Line numbers are dropped, broken lines (marked with an arrow) joined.
    """
    text = shared("paper/gymnasium-dl.txt").read_text(encoding="utf-8")
    start = re.search(rf"^1 +{beginning}", text, re.MULTILINE)
    assert start is not None
    lines: list[str] = []
    for line in text[start.start() :].split("\n"):
        numbered = re.match(r"\d+ ?(.*)", line)
        if "↪" in line:
            lines[-1] += " " + line.split("↪", 1)[1].strip()
        elif numbered:
            lines.append(numbered.group(1))
        elif line.strip() not in ("", "```"):
            break
    return "\n".join(lines) + "\n"


# Section 4.1 ------------------------------------------------------------------

VARIABLES = model_text(
    "x >= 0 -> [{ {x' = mu, t' = 1 & t <= 1} t := 0; }*] x >= 0",
    '// @const: bound=[0.8:1.2], def="friction coefficient"\nReal mu;',
    '// @var: bound=[0:100], plot=line, def="vehicle position"\nReal x;\n// @var: bound=[0:1]\nReal t;',
)

PREDICATES = model_text(
    "safeDist(gx - x) -> [{ v := *; ?0 <= v & v <= 1; {x' = v} }*] safeDist(gx - x)\n"
    "& <{ v := *; ?0 <= v & v <= 1; {x' = v} }*> atGoal(x, gx)",
    "// @safety: penalty=-1000, shape=d, on_failure=truncate:failure\n"
    "Bool safeDist(Real d) <-> d > 0;\n\n"
    "// @progress: reward=500, shape={-abs(x - gx)}, on_success=terminate:success\n"
    "Bool atGoal(Real x, Real gx) <-> abs(x - gx) < 0.5;",
    "// @var: bound=[0:10]\nReal x;\n// @var: bound=[0:10]\nReal gx;\nReal v;",
)

# Test 1 -----------------------------------------------------------------------

CONTROL = """HP controlFunc ::= {
  if (v + A*ts < maxV && dist > stopDist(v + A*ts)) { a := A }
  else { a := -b; } // Fallback to braking
};"""


def first_test(control: str) -> str:
    """Its predicate and controller as printed, in a model of straight driving."""
    return model_text(
        "v >= 0 & isSafe(x, y, v, xo, yo) -> [{ dist := max(abs(x-xo), abs(y-yo)); controlFunc; t := 0;\n"
        "  {x' = v, v' = a, t' = 1 & t <= ts & v >= 0} }*] isSafe(x, y, v, xo, yo)",
        "Real A = 2; Real b = 3; Real ts = 0.1; Real maxV = 10;\n"
        "Real stopDist(Real v) = v^2 / (2 * b);\n"
        "// @safety: penalty=-1000, shape={(abs(x-xo) - stopDist(v)) +\n"
        "//   (abs(y-yo) - stopDist(v))}, on_failure=truncate:status=failure,\n"
        "//   on_success=continue:status=none\n"
        "Bool isSafe(Real x, Real y, Real v, Real xo, Real yo) <-> (abs(x-xo) >\n"
        "  stopDist(v) | abs(y-yo) > stopDist(v));\n" + control,
        "\n".join(f"// @var: bound=[0:9]\nReal {x};" for x in ("x", "y", "v", "xo", "yo"))
        + "\nReal a; Real t; Real dist;",
    )


# The table --------------------------------------------------------------------

OUR_MODELS: dict[str, tuple[Callable[[], str], str, Outcome]] = {
    "4.1, variables": (lambda: VARIABLES, "builds", Counter()),
    "4.1, predicates": (lambda: PREDICATES, "builds", Counter()),
    "Test 1 as printed": (
        lambda: first_test(CONTROL),
        "builds",
        Counter({"keymaera-rejects": 3}),
    ),
    "Test 1 in the syntax of KeYmaera X": (
        lambda: first_test(
            CONTROL.replace("&&", "&")
            .replace("{ a := A }", "{ a := A; }")
            .replace("// Fallback to braking", "")
        ),
        "builds",
        Counter(),
    ),
}


@pytest.mark.parametrize("name", OUR_MODELS)
def test_snippets(name: str) -> None:
    text, verdict, codes = OUR_MODELS[name]
    assert outcome(text())[:2] == (verdict, codes)


def appendix_a() -> str:
    return printed("ArchiveEntry")


def bounded(text: str) -> str:
    """The benchmark with limits for what it starts from."""
    text = text.replace("Real b;", "\n/* @const: bound=[1:4] */ Real b;")
    return re.sub(r"( +)Real ([xv]);", r"/* @var: bound=[0:10] */\n Real \2;", text)


def test_appendix_a_lacks_limits() -> None:
    verdict, codes, found = outcome(appendix_a())
    assert (verdict, codes) == ("error", Counter({"unbounded-variable": 1}))
    assert "`x`, `v`, `b`" in found[0].title


def test_appendix_a_with_limits_builds() -> None:
    verdict, codes, found = outcome(bounded(appendix_a()))
    assert (verdict, codes) == ("builds", Counter({"keymaera-rejects": 1}))
    assert found[0].title == "KeYmaera X has no package `keyx`"


def waypoint() -> str:
    return printed("Theorem")


def with_brace(text: str) -> str:
    """One `{` is missing before the loop: the braces of dwppdl do not match."""
    return text.replace("{ controlFunc;", "{ { controlFunc;")


def test_listing_1_as_printed_lacks_a_brace() -> None:
    verdict, codes, found = outcome(waypoint())
    assert (verdict, codes) == ("error", Counter({"syntax": 1}))
    assert "}*@invariant" in found[0].span.source.line(found[0].span.line)


def test_listing_1_calls_a_program_that_it_does_not_define() -> None:
    verdict, codes, found = outcome(with_brace(waypoint()))
    assert (verdict, codes) == ("error", Counter({"undefined-program": 2}))
    assert {(d.label, d.help) for d in found} == {("`dwwpdl` is not defined", "did you mean `dwppdl`?")}


def test_listing_1_with_the_name_put_right_builds() -> None:
    verdict, codes, found = outcome(with_brace(waypoint()).replace("dwwpdl", "dwppdl"))
    assert (verdict, codes) == ("builds", Counter({"keymaera-rejects": 2}))
    assert ["comments" in d.title for d in found] == [True, False], "comments are mentioned once"
    assert "`End.`" in found[1].title


def test_listing_1_with_portable_comments_builds_silently() -> None:
    text = with_brace(waypoint()).replace("dwwpdl", "dwppdl")
    text = re.sub(r"// (.*)$", r"/* \1 */", text, flags=re.MULTILINE)
    assert outcome(text + "\nEnd.\n")[:2] == ("builds", Counter())
