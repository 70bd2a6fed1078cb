"""For every code of `dl2c check` one model that has the fault and one that has not.

A model is the text below with parts exchanged.
"""

MODEL = """Theorem "drive"
Definitions
  Real ep = 1;
  /* @const: bound=[1:2], unit="m/s^2" */
  Real A;
  /* @safety: penalty=-1, on_failure=terminate:failure */
  Bool safe(Real x) <-> x <= 9;
  /* @progress: reward=1, on_success=terminate:success */
  Bool there(Real x) <-> x = 5;
  HP ctrl ::= { {a := A; ++ a := -A;} };
  HP drive ::= { t := 0; {x' = v, v' = a, t' = 1 & t <= ep & v >= 0} };
End.
ProgramVariables
  /* @var: bound=[0:10], unit="m" */
  Real x;
  /* @var: bound=[0:3], unit="m/s" */
  Real v;
  /* @var: bound=[-2:2], unit="m/s^2" */
  Real a;
  Real t;
End.
Problem
  x <= 1 & A > 0 -> [{ctrl; drive;}*@invariant(safe(x) & v >= 0)]safe(x)
End.
End.
"""
"""Nothing to complain of."""

CTRL, EVENT = "{a := A; ++ a := -A;}", "t := 0; {x' = v, v' = a, t' = 1 & t <= ep & v >= 0}"
WHOLE = "x <= 1 & A > 0 -> [{ctrl; drive;}*@invariant(safe(x) & v >= 0)]safe(x)"

Parts = tuple[tuple[str, str], ...]

CASES: tuple[tuple[str, Parts, Parts], ...] = (
    (
        "agent-moves-world",
        (
            ("ctrl; drive", "{{x' = 1 & x <= 5} ++ {x' = -1 & x >= 5}}"),
            (EVENT, "?true;"),
            ("  Real t;\n", ""),
        ),
        (),
    ),
    ("constant-test", ((CTRL, "?A > 0; a := A;"),), ((CTRL, "?x < 10; a := A;"),)),
    ("constant-test", ((CTRL, "a := *; ?-A <= a & a <= A; ?a <= 2 * A;"),), ()),
    ("constant-test", ((CTRL, "if (v^2 < 0) {a := A;} else {a := -A;}"),), ((CTRL, "if (v < 1) {a := A;}"),)),
    ("constant-test", (("t <= ep & v", "t <= ep & v < 0 & v"),), (("t <= ep & v", "t <= ep & x <= 20 & v"),)),
    (
        "deprecated-option",
        (("Problem", "/* @episode: safety_check=auto */ Problem"),),
        (("Problem", "/* @episode: safety_check=continuous */ Problem"),),
    ),
    ("dead-alternative", (("a := -A;}", "?A < 1; a := -A;}"),), (("a := -A;}", "?A < 2; a := -A;}"),)),
    ("dead-alternative", ((CTRL, CTRL + " ?a > 0;"),), ((CTRL, CTRL + " ?a > -2;"),)),
    (
        "deadlock",
        ((CTRL, "{?x < 5; a := A; ++ ?x > 5; a := -A;}"),),
        ((CTRL, "{?x < 5; a := A; ++ ?x >= 5; a := -A;}"),),
    ),
    ("deadlock", ((CTRL, "a := *; ?v^2 / x <= a & a <= 5;"),), ((CTRL, "a := *; ?-A <= a & a <= A;"),)),
    ("decision-in-loop", ((CTRL, "{a := A; ++ a := -A;}*"),), ((CTRL, "a := 0; {a := a + 1;}*"),)),
    ("default-dt", ((" & t <= ep & v >= 0", " & v >= 0"),), ()),
    (
        "default-dt",
        ((" & t <= ep & v >= 0", " & v >= 0"),),
        ((" & t <= ep & v >= 0", " & v >= 0"), ("Problem", "/* @episode: dt=1 */ Problem")),
    ),
    (
        "if-in-choice",
        ((CTRL, "if (v < 1) {a := A;} else {a := -A;} ++ a := 0;"),),
        ((CTRL, "if (v < 1) {a := A; ++ a := 0;} else {a := -A; ++ a := 0;}"),),
    ),
    (
        "if-in-choice",
        ((CTRL, "{a := 0; ++ {if (v < 1) {a := A;}} ++ a := -A;}"),),
        ((CTRL, "{?v < 1; a := A; ++ ?v >= 1; a := -A; ++ a := 0;}"),),
    ),
    ("keymaera-rejects", (("x <= 1 & A", "x <= 1 && A"),), ()),
    (
        "minus-in-quotient",
        (("A > 0", "2 < -8/-A/2"),),
        (("A > 0", "2 < -8/(-A/2) & 2 < -8/(-(A/2)) & 2 < -8/-A*2"), (', unit="m/s^2"', "")),
    ),
    (
        "non-potential-shaping",
        (("reward=1,", "reward=1, shape={10 - x},"),),
        (("reward=1,", "reward=1, shape={x - 9},"),),
    ),
    ("positive-penalty", (("penalty=-1", "penalty=1"),), (("penalty=-1", "penalty=0"),)),
    (
        "postcondition-not-safe",
        (("]safe(x)", "](safe(x) & v <= 3)"),),
        (("]safe(x)", "](x <= 10 | v <= 3)"),),
    ),
    ("safety-after-steps", (("t <= ep & v >= 0}", "t <= ep & v >= 0} a := 0;"),), ()),
    ("strict-clock", (("t <= ep & v", "t < ep & v"),), (("t <= ep & v", "t < 9 & t <= ep & v"),)),
    ("truncate-on-failure", (("terminate:failure", "truncate:failure"),), ()),
    (
        "unbounded",
        (("[0:3]", "[0:inf]"), ("x <= 1", "x <= 1 & v <= 3")),
        (("[0:3]", "[0:inf], observe=false"), ("x <= 1", "x <= 1 & v <= 3")),
    ),
    ("unit-mismatch", (('"m/s"', '"km/h"'),), ()),
    ("unit-mismatch", (("x <= 1", "x + A <= 3"),), (("x <= 1", "2 * (x + v^2 / (2 * A)) + 1 <= 9"),)),
    ("unit-mismatch", (("a := A;", "a := v;"),), (("a := A;", "a := v^2 / x;"),)),
    (
        "unknown-lint",
        (("Problem", "/* @episode: allow=deadlocks */ Problem"),),
        (("Problem", "/* @episode: allow=deadlock */ Problem"),),
    ),
    (
        "existential-constant",
        (
            (WHOLE, f"\\exists e (0 < e & e < 1 & ({WHOLE}))"),
            ("Problem", "/* @episode: allow=unbounded */ Problem"),
        ),
        (
            (WHOLE, f"\\forall e (0 < e & e < 1 -> ({WHOLE}))"),
            ("Problem", "/* @episode: allow=unbounded */ Problem"),
        ),
    ),
    ("undeclared-names", (("Real t;", ""),), ()),
    (
        "unobserved-variable",
        (('/* @var: bound=[0:3], unit="m/s" */', ""), ("x <= 1", "x <= 1 & 0 <= v & v <= 3")),
        (),
    ),
    ("unsampled-precondition", (("x <= 1", "x <= 1 & x^3 + x^4 = 2 * x"),), ()),
    (
        "zero-duration",
        (("{ctrl; drive;}*", "{ctrl; {drive; ++ v := 1;}}*"), ("Real t;", "/* @var: bound=[0:1] */ Real t;")),
        (),
    ),
    (
        "zero-duration",
        ((" t := 0; {x'", " {x'"), ("Real t;", "/* @var: bound=[0:1] */ Real t;")),
        ((" t := 0; {x'", " t := -ep; {x'"),),
    ),
)
"""Code, what makes a model have the fault, and what makes another have none."""


def varied(parts: Parts) -> str:
    text = MODEL
    for old, new in parts:
        assert old in text, old
        text = text.replace(old, new)
    return text
