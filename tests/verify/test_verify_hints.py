"""What tactics and comments name is tried, and proves nothing by itself."""

from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_formula, print_term
from dl2c.source import Source
from dl2c.verify.hints import Hints
from dl2c.verify.prove import Limits, prove
from dl2c.verify.theorem import theorem_of

OLD = """
Functions. R b. R ep. End.
ProgramVariables. R x. R y. R v. R dx. R dy. R w. R a. R t. R m. End.
Problem.
  v >= 0 & b > 0 & ep > 0 & dx^2 + dy^2 = 1 & x + v^2/(2*b) < m -> [
    {
      { a := -b; ++ ?v = 0; a := 0; w := 0; ++
        w :=*; a := 0; ?x + ep*v + v^2/(2*b) < m; }
      t := 0;
      { x' = v*dx, y' = v*dy, dx' = -w*dy, dy' = w*dx, v' = a, t' = 1 & t <= ep & v >= 0 }
      /*@invariant(
        dx^2 + dy^2 = 1
        v = v0 + a*t,
        x - x0 <= t*(v - a/2*t)
      )*/
    }*
    /*@invariant(%s & dx^2 + dy^2 = 1 & x + v^2/(2*b) < m)*/
  ] (x < m)
End.
"""


def hints(text: str) -> Hints:
    return theorem_of(parse_archive(Source("h.key", text))[0].entries[0], {}).hints


def test_invariants_in_comments_are_hints() -> None:
    found = hints(OLD % "v >= 0")
    assert [print_formula(f) for f in found.loops] == ["v >= 0 & dx^2 + dy^2 = 1 & x + v^2/(2*b) < m"]
    assert [print_formula(f) for f in found.flows] == [
        "dx^2 + dy^2 = 1",
        "v = old(v) + a*t",
        "x - old(x) <= t*(v - a/2*t)",
    ]


def test_they_prove_what_they_can() -> None:
    assert prove(Source("h.key", OLD % "v >= 0"), Options(), Limits(5.0, 40.0)).answer == "proved"


def test_a_wrong_one_proves_nothing() -> None:
    wrong = (OLD % "v >= 0").replace("?x + ep*v", "?x").replace("x - x0 <= t*(v", "x - x0 <= 0*(v")
    assert prove(Source("h.key", wrong), Options(), Limits(2.0, 8.0)).answer not in (
        "proved",
        "proved-if-defined",
    )


def test_terms_of_cuts_may_be_lyapunov_functions() -> None:
    text = (
        'ArchiveEntry "F" ProgramVariables Real x, y; End.\n'
        "Problem x = 0 -> [{x' = -x}] x = 0 End.\n"
        'Tactic "T" cut("\\exists k (k > 0 & (x^2 + y^2 >= k & 2*x^2 + y^2 >= k))") End.\nEnd.'
    )
    names = [tuple(print_term(f) for f in functions) for functions in hints(text).functions]
    assert names == [("x^2 + y^2", "2*x^2 + y^2"), ("x^2 + y^2",), ("2*x^2 + y^2",)]
